"""Keep stores to compare with."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, command
from contactlab.command_line.terminal import echo, print_json
from contactlab.printable import shell_word

if TYPE_CHECKING:
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


class WrittenBaseline(NamedTuple):
    """A baseline: a store without its traces."""

    baseline: str  # its folder
    runs: int
    bytes: int
    digest: str


def _text(done: WrittenBaseline, given: Given) -> None:
    store, folder = opt.address_of(given["store"]), done.baseline
    size = f"{done.bytes / 1e6:.2g} MB"
    echo(f"{folder} holds the {done.runs} runs of {store} without traces: {size}")
    echo(f"digest {done.digest}")
    digest = f"--baseline-digest {done.digest}"
    echo(f"compare with it: contactlab compare {shell_word(folder)} STORE {digest}")


def _json(done: WrittenBaseline, given: Given) -> None:
    del given
    print_json(done._asdict())


@command(
    "gate",
    name="baseline update",
    examples=("baseline update results/grasp baselines/grasp",),
    codes="0 written, 2 bad input, 3 bad or damaged store",
    formats={"text": _text, "json": _json},
)
def update(
    store: Annotated[
        "Store | Address | str", Argument("STORE", "Store to take as the baseline.", kind=str)
    ],
    dest: Annotated[
        str | Path,
        Argument("DEST", "Folder of the baseline, created or replaced.", kind=Path),
    ],
    *,
    baseline_digest: opt.BaselineDigest = None,
) -> WrittenBaseline:
    """Write a store without its traces, small enough to commit.

    Raises:
        StoreError: the store is damaged, or the replaced baseline has another digest.
        OutputError: the folder cannot be written.
    """
    from contactlab.store.verify_store import write_baseline

    folder = Path(dest)
    written = write_baseline(opt.address_of(store), folder, baseline_digest)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return WrittenBaseline(str(folder), written.manifest.runs, size, written.digest)
