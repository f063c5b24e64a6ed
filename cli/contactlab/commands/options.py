"""Options that several commands share, and how their values are read."""

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import typer

from contactlab.commands.terminal import say
from contactlab.errors import OutputError, SweepFileError, optional

if TYPE_CHECKING:
    from contactlab.pareto.criteria import Criteria
    from contactlab.plugins import Plugin
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address
else:
    # The parser turns text into an address. Its type, which typer wants to see at import time,
    # would load Arrow before any command is chosen.
    Address = str

_Command = TypeVar("_Command", bound=Callable[..., None])
Format = Literal["text", "json"]
TableFormat = Literal["text", "json", "csv"]


def store_at(text: str) -> "Address":
    """Return the address of a store; raise OutputError for what is none."""
    from contactlab.store.store_files import parse_address

    return parse_address(text)


def folder_at(text: str) -> Path:
    """Return a folder, for commands that write several stores; raise OutputError for a bucket."""
    address = store_at(text)
    if not isinstance(address, Path):
        raise OutputError(f"{text}: this command writes into a folder; sweep -o takes addresses")
    return address


def store_argument(metavar: str, help: str) -> Any:  # noqa: A002, ANN401 - as typer calls it
    """Return a positional argument that names a store."""
    return typer.Argument(..., parser=store_at, metavar=metavar, help=help)


def option(metavar: str, help: str, default: object = None, **rules: Any) -> Any:  # noqa: A002, ANN401
    """Return an option with a name for its value; the other rules are those of typer."""
    return typer.Option(default, metavar=metavar, help=help, **rules)


def end_of_help(examples: Sequence[str], codes: str) -> str:
    """Return what stands at the end of a command's help: examples and exit codes."""
    lines = "\n".join(f"  contactlab {each}" for each in examples)
    return f"\b\nExamples:\n{lines}\n\nExit codes: {codes}."


def helped(*examples: str, codes: str) -> "Callable[[_Command], _Command]":
    """Give a command of an installed package such an end of its help."""

    def give(command: _Command) -> _Command:
        command.__dict__["end_of_help"] = end_of_help(examples, codes)
        return command

    return give


def flag(name: str, help: str) -> Any:  # noqa: A002, ANN401 - as typer calls it
    """Return an option that takes no value, and is off by default."""
    return typer.Option(False, name, help=help)


def output_option(
    metavar: str,
    help: str,  # noqa: A002 - as typer calls it
    default: object = None,
    parser: Callable[[str], object] | None = None,
) -> Any:  # noqa: ANN401 - an option of any type
    """Return the option `-o`, which says what a command writes."""
    return typer.Option(default, "-o", "--output", parser=parser, metavar=metavar, help=help)


STORE = store_argument("STORE", "Store: a folder or s3://BUCKET/PREFIX.")
RUN = typer.Argument(..., metavar="RUN", help="Run id, or its first digits.")
BASELINE_DIGEST = option(
    "SHA256", "Digest that the baseline must have, as `baseline update` prints it."
)
SWEEP_STORE = output_option(
    "STORE",
    "Store to write: a folder or s3://BUCKET/PREFIX; by default under results/.",
    parser=store_at,
)
STUDY_FOLDER = output_option(
    "FOLDER", "Folder for report and evidence; by default under results/.", parser=folder_at
)
SET = typer.Option(
    None,
    "--set",
    metavar="NAME=VALUE",
    help="Replace an axis or a setting: timestep=1e-3; may be repeated.",
)
WORKERS = typer.Option(None, min=0, help="Worker processes; by default one per core, 0 for none.")
MUJOCO = option(
    "VERSION|PYTHON", "Run with another MuJoCo: a version, or the path of a Python that has one."
)
DRIVE = option(
    "DRIVE", "What drives the runs: none, hold, exercise, noise=0.3,rate=10, or a file of controls."
)
ALLOW_CODE = flag("--allow-code", "Run policies and environments, which are code: trust them.")
PLUGIN = option(
    "FILE", "Python file that adds metrics, labels, oracles or engines; may be repeated."
)
ERROR = option("METRIC", "Measure of accuracy: error_final, oracle_error or any metric.")
TOLERANCE = option(
    "METRIC=VALUE", "Replace a tolerance of the sweep: oracle_error=1%; may be repeated."
)
FIGURE = option("FILE", "Draw the result: a .png or .svg file.")
FORMAT = typer.Option("text", "--format", help="How results are printed.")


def beside(store: Address, ending: str) -> Path:
    """Return a path beside a store, of its name and an ending; for a bucket, in this folder."""
    if not isinstance(store, Path):
        return Path(f"{store.name}{ending}")
    named = store if store.name else store.resolve()
    return named.with_name(f"{named.name}{ending}")


def load_plugins(files: Sequence[Path] | None) -> "Sequence[Plugin]":
    """Load installed plug-ins and those of `--plugin`; raise PluginError for one that cannot be."""
    from contactlab import plugins

    return plugins.load_plugins(files or ())


def check_figure(path: Path | None) -> None:
    """Check that the figure of `--figure` can be drawn; an OutputError says why not."""
    if path is not None:
        with optional("figures", "a figure"):
            from contactlab.charts import check_figure as check
        check(path)


def mention_damage(store: "Store") -> None:
    """Name damaged traces, in a command that reads a store."""
    from contactlab.store.verify_store import trace_warning

    for warning in trace_warning(store):
        say(f"warning: {warning}")


def rerun_with_mujoco(version: str | None, store: "Address | None") -> None:
    """Run the same command with another MuJoCo, if `--mujoco` names one, and end with it.

    The version is added to the name of the store, which is None if `-o` was given. An EngineError
    says that there is no such version, or that it cannot be installed.
    """
    if version is None:
        return
    from contactlab.run.mujoco_environment import exec_with, find_interpreter, without_option

    other = find_interpreter(version, say)
    if other is None:
        return
    target = ["-o", f"{store}-{other.mujoco}"] if store else []
    exec_with(other, [*without_option(sys.argv[1:], "--mujoco"), *target])


def accuracy_criteria(error: str | None, tolerances: Sequence[str] | None) -> "Criteria":
    """Return what `--error` and `--tolerance` ask of a store."""
    from contactlab.pareto.criteria import Criteria

    return Criteria(
        error, dict(read_limit(text, "tolerance", "oracle_error=1%") for text in tolerances or ())
    )


def read_limit(text: str, what: str = "limit", like: str = "slip=1e-3") -> tuple[str, float]:
    """Return the metric and the value of `METRIC=VALUE`, where the value may be a percentage.

    Other text is a SweepFileError, which says `what` it is not, and that it is written `like`.
    """
    metric, _, value = text.partition("=")
    try:
        limit = float(value.removesuffix("%")) / (100 if value.endswith("%") else 1)
    except ValueError:
        limit = math.nan
    if not metric or not 0 <= limit < math.inf:
        raise SweepFileError(f"'{text}' is not a {what}; write METRIC=VALUE, such as {like}")
    return metric, limit
