"""Parameters that several commands share, and how their values are read.

A value is text of the command line or data of Python: `{"slip": 1e-3}` for `["slip=1mm"]`.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

from contactlab.command_line.declaration import Argument, Option, flag
from contactlab.command_line.quantities import read_length
from contactlab.command_line.surroundings import say
from contactlab.errors import OutputError, SweepFileError

if TYPE_CHECKING:
    from contactlab.modifications.modification import ReductionName
    from contactlab.plan.task_options import TaskOptions
    from contactlab.plugins import Plugin
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address

Settings = Mapping[str, object] | Sequence[str]
"""Settings by name, such as `{"timestep": [1e-3, 2e-3]}`, or options as typed, `timestep=1e-3`."""
Tolerances = Mapping[str, float] | str | Sequence[str]
"""Largest magnitudes by metric in SI units, or options as typed: `10%`, `1mm`, `hold_slip=1mm`."""

StoreArgument = Annotated[
    "Store | Address | str", Argument("STORE", "Store: a folder or s3://BUCKET/PREFIX.", kind=str)
]
Run = Annotated[str, Argument("RUN", "Run id, or its first digits.")]
BaselineDigest = Annotated[
    str | None,
    Option("SHA256", "Digest that the baseline must have, as `--update` prints it."),
]
StoreOutput = Annotated[
    "Address | str | None",
    Option(
        "STORE",
        "Store to write: a folder or s3://BUCKET/PREFIX; by default under results/.",
        kind=str,
        short="-o",
    ),
]
StudyFolder = Annotated[
    str | Path | None,
    Option(
        "FOLDER",
        "Folder for report and evidence; by default under results/.",
        kind=str,
        short="-o",
    ),
]
ExaminationOutput = Annotated[
    str | Path | None,
    Option(
        "FOLDER|FILE",
        "Folder for page, report and evidence, by default under results/examine; or one file: "
        ".html, .json.",
        kind=str,
        short="-o",
    ),
]
Model = Annotated[
    str | Path,
    Argument(
        "MODEL|SCENE", "Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT.", kind=str
    ),
]
Set = Annotated[
    Settings,
    Option(
        "NAME=VALUE",
        "Replace an axis or a setting: timestep=1e-3; may be repeated.",
        kind=list[str],
    ),
]
Where = Annotated[
    Settings,
    Option("NAME=VALUE", "Run only these values: cone=elliptic; may be repeated.", kind=list[str]),
]
Limit = Annotated[int | None, Option("N", "Run only the first N runs.", least=1)]
Workers = Annotated[
    int | None,
    Option(None, "Worker processes; by default one per core. 0 runs in this process.", least=0),
]
Mujoco = Annotated[
    str | None,
    Option(
        "VERSION|PYTHON",
        "Run with another MuJoCo: a version, or the Python that has it.",
    ),
]
# The task, in every command that judges a model.
Keyframe = Annotated[
    str | None,
    Option("NAME", "Keyframe where runs start, or qpos0, the model's default pose."),
]
Drive = Annotated[
    str | None,
    Option(
        "DRIVE",
        "Controls: auto, none, hold, exercise, noise=0.3,rate=10, kp=400,kd=10,rate=500, a file or "
        "a policy.",
    ),
]
Duration = Annotated[
    float | str | None, Option("TIME", "Simulated time of a run: 2s, 500ms.", kind=str)
]
Observe = Annotated[
    Sequence[str],
    Option("BODY", "Observed body; all by default; may be repeated.", kind=list[str]),
]
Tolerance = Annotated[
    Tolerances,
    Option(
        "TOLERANCE",
        "Largest error: 10% or 1mm; of a metric, hold_slip=1mm; may be repeated.",
        kind=list[str],
    ),
]
Require = Annotated[
    Sequence[str],
    Option(
        "REQUIREMENT",
        "Requirement: 'still(box, 1 mm)', 'held(mug, by: hand)'; may be repeated.",
        kind=list[str],
    ),
]


Seeds = Annotated[
    int | None, Option("N", "Number of seeds, one run each; judged runs have 3 to 9.", least=1)
]


class TaskParameters(TypedDict, total=False):
    """Options that replace parts of a model's task; see `task_of`."""

    keyframe: Keyframe
    drive: Drive
    duration: Duration
    observe: Observe
    tolerance: Tolerance
    require: Require
    seeds: Seeds


AllowCode = Annotated[
    bool, flag("Run the code of policies and environments. Use it only if you trust them.")
]
Plugins = Annotated[
    Sequence[str | Path],
    Option(
        "FILE",
        "Python file that adds metrics, labels, oracles or engines; may be repeated.",
        kind=list[Path],
    ),
]
ErrorMetric = Annotated[
    str | None,
    Option("NAME", "Metric of accuracy: error_final, oracle_error or any other."),
]
MaxTime = Annotated[float | str, Option("TIME", "Limit of wall time: 90s, 5min.", kind=str)]
# Work is counted in simulated steps and priced by those of this machine: a busy one takes longer.
MaxCpu = Annotated[
    float | str, Option("TIME", "Limit of work, as CPU time of an idle core: 5min.", kind=str)
]
Figure = Annotated[
    str | Path | None, Option("FILE", "Draw the result: a .png or .svg file.", kind=Path)
]
ReportFiles = Annotated[
    Sequence[str | Path],
    Option(
        "FILE",
        "Report to write: .md, .json, .xml (JUnit), .sarif or .txt; may be repeated.",
        kind=list[Path],
        short="-o",
    ),
]
Policy = Annotated[
    str | Path | None,
    Option("FILE", "Policy file: tolerances, gates and waivers.", kind=Path),
]


def address_of(store: "Store | Address | str") -> "Address":
    """Return the address of a store; raise OutputError for other text."""
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import parse_address

    return store.address if isinstance(store, Store) else parse_address(store)


def folder_of(output: str | Path) -> Path:
    """Return the folder of commands that write several stores; raise OutputError for a bucket."""
    address = address_of(output)
    if not isinstance(address, Path):
        raise OutputError(f"{output}: this command writes into a folder; sweep -o takes addresses")
    return address


def study_folder(study: str, subject: object, output: str | Path | None) -> Path:
    """Return the folder of a study: as given, or `results/STUDY/NAME` for a subject's name.

    A number follows if the folder has the results of another subject.
    """
    from contactlab.resources import RESULTS
    from contactlab.tasks.session import own_folder

    return folder_of(output) if output is not None else own_folder(RESULTS / study, str(subject))


def path_next_to(store: "Address", ending: str) -> Path:
    """Return the path next to a store, its name with an ending; in this folder for a bucket."""
    if not isinstance(store, Path):
        return Path(f"{store.name}{ending}")
    target = store if store.name else store.resolve()
    return target.with_name(f"{target.name}{ending}")


def write_assignments(settings: Settings) -> list[str]:
    """Return settings in the form of the command line: `NAME=VALUE,VALUE`."""
    if not isinstance(settings, Mapping):
        return list(settings)
    values_by_name = {
        name: value if isinstance(value, list | tuple) else [value]
        for name, value in settings.items()
    }
    return [
        f"{name}={','.join(map(json.dumps, values))}" for name, values in values_by_name.items()
    ]


def load_plugins(files: Sequence[str | Path]) -> "Sequence[Plugin]":
    """Load installed plug-ins and those of `--plugin`; raise PluginError if one fails."""
    from contactlab import plugins

    return plugins.load_plugins([Path(file) for file in files])


def check_figure(path: str | Path | None, page: str = "") -> None:
    """Check that the figure of `--figure` can be drawn; an OutputError has the reason.

    `page` is another suffix that the command draws, such as `.html`.
    """
    if path is not None:
        from contactlab.charts import check_figure as check

        check(Path(path), page)


def mention_damage(store: "Store") -> None:
    """Name damaged traces, in a command that reads a store."""
    from contactlab.store.verify_store import trace_warning

    for warning in trace_warning(store):
        say(f"warning: {warning}")


def refuse_parts(task: "TaskOptions", parts: Sequence[str], instead: str) -> None:
    """Refuse the parts of a task that a command ignores; `instead` says what to write."""
    ignored = [name for name in parts if getattr(task, name) not in (None, ())]
    if ignored:
        raise SweepFileError(f"--{ignored[0]} would be ignored: {instead}")


def task_of(
    keyframe: str | None = None,
    drive: str | None = None,
    duration: float | str | None = None,
    observe: Sequence[str] = (),
    tolerance: Tolerances = (),
    require: Sequence[str] = (),
    seeds: int | None = None,
) -> "TaskOptions":
    """Read the task of a command's parameters; a SweepFileError names the wrong one."""
    from contactlab.plan.task_options import read_task_options

    if isinstance(tolerance, Mapping):
        tolerance = [f"{name}={value}" for name, value in tolerance.items()]
    task = read_task_options(
        keyframe,
        drive,
        None if duration is None else str(duration),
        [observe] if isinstance(observe, str) else observe,
        [tolerance] if isinstance(tolerance, str) else tolerance,
        [require] if isinstance(require, str) else require,
        seeds,
    )
    if any(task.units.values()):
        from contactlab.measure import METRICS

        # Limits of metrics have the units of these metrics.
        for name, unit in task.units.items():
            own = METRICS[name].unit if name in METRICS else "any"
            if unit and own not in (unit, "any"):
                like = "a plain number" if own == "1" else f"a number in {own}"
                raise SweepFileError(f"--tolerance {name}: write {like}, not in {unit}")
    return task


def read_reductions(
    words: Sequence[str], allowed: Sequence[str] = ()
) -> "dict[ReductionName, float | None]":
    """Return the distances [m] of reductions by name, from NAME or NAME=LENGTH each.

    `allowed` are names that a command takes; all by default.
    """
    from contactlab.modifications.catalogue import list_reductions

    inexact = {one.name: one for one in list_reductions() if not one.is_exact}
    names = [name for name in inexact if not allowed or name in allowed]
    lengths: dict[ReductionName, float | None] = {}
    for word in words:
        name, equals, length = word.partition("=")
        SweepFileError.unless_known(name, names, f"--apply: no '{name}'")
        reduction = inexact[name]
        if equals and reduction.distance is None:
            raise SweepFileError(f"--apply {word}: {name} has no length; write --apply {name}")
        length_m = read_length(length, f"--apply {name}, length", "5cm or 0.05") if equals else None
        lengths[reduction.name] = reduction.distance if length_m is None else length_m
    return lengths
