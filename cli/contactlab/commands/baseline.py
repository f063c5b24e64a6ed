"""Keep stores to compare with."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, command
from contactlab.command_line.report_formats import report_formats

if TYPE_CHECKING:
    from contactlab.schema.store_reports import WrittenBaseline
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


@command(
    "gate",
    name="baseline update",
    examples=("baseline update results/grasp baselines/grasp",),
    codes="0 written, 2 bad input, 3 bad or damaged store",
    formats=report_formats(),
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
) -> "WrittenBaseline":
    """Write a store without its traces, small enough to commit.

    Raises:
        StoreError: the store is damaged, or the replaced baseline has another digest.
        OutputError: the folder cannot be written.
    """
    from contactlab.schema.store_reports import WrittenBaseline
    from contactlab.store.verify_store import write_baseline

    folder = Path(dest)
    address = opt.address_of(store)
    written = write_baseline(address, folder, baseline_digest)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return WrittenBaseline(
        store=str(address),
        baseline=str(folder),
        runs=written.manifest.runs,
        bytes=size,
        digest=written.digest,
    )
