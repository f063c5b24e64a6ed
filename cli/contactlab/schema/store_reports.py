"""Reports of commands that plan, check and copy stores, and of runs that are simulated again."""

from pathlib import Path
from typing import Literal

from contactlab.schema.comparison import ComparisonReport
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import Model, about


class PlannedAxis(Model):
    """An axis of a planned sweep."""

    name: str
    role: str
    count: int = about("Number of its values.")
    values: str = about("Its values; of many, the first two and the last.")


class SweepForecast(ReportModel):
    """The expected cost of a sweep of distinct runs, and warnings about suspicious settings.

    Wall time and size of the traces are estimated from below and above, by recording some of the
    runs. They are null if the runs execute code that is not allowed. Parts of the time are for
    references and errors, and for times and work.
    """

    forecast_version: Literal[2] = 2
    axes: tuple[PlannedAxis, ...]
    start: str = about("Keyframes that the runs start from; qpos0 is the default pose.")
    drive: str = about("What moves the runs, in words.")
    seeds: int = about("Number of seeds.")
    runs: int = about("Number of distinct runs, at most.")
    least_runs: int | None = about(
        "Number of runs, at least, of a sweep that refines; null otherwise.", default=None
    )
    steps: int = about("Steps of all runs.")
    cores: int = about("Cores that the time assumes to be idle.", default=1)
    seconds: tuple[float, float] | None = about("Wall time of all runs, least and most [s].")
    checks_share: float = about("Part of the time of the runs that checks take.", default=0.0)
    accuracy_seconds: float
    timing_seconds: float
    memory_bytes: float | None = about("Memory of all processes, at most.")
    bytes: tuple[float, float] | None = about(
        "Size of the traces, least and most; 0 without traces."
    )
    scene_bytes: int = about("Size of the scene's files, which the store copies.", default=0)
    table_bytes: int = about("Size of the table of all runs.", default=0)
    bytes_by_format: dict[str, tuple[float, float]] = about("The same for every `trace_format`.")
    trace: str = about("The rule that chooses the runs that keep a trace.")
    trace_format: str
    warnings: tuple[str, ...] = ()


class StoreVerification(ReportModel):
    """Whether a store is intact, and the extent of the check."""

    store: str
    sound: bool
    problems: tuple[str, ...] = ()
    unverified: tuple[str, ...] = about("Parts that could not be checked here.", default=())
    simulated: int = about("Runs that were simulated again.", default=0)
    simulation_asked: int = about("Runs that should be simulated again.", default=0)
    runs: int
    traces: int
    traces_left_out: bool = about("Whether the store is a baseline, without its traces.")
    digest: str
    physics: str = about("Digest of the results without clocks; empty for a damaged store.")


class RunReplay(ReportModel):
    """A stored run, simulated again, which should reproduce it bit for bit."""

    run_id: str
    equal: bool
    stored_hash: str | None
    hash: str
    step: int | None = about(
        "The first step that ends in different states; null if they are equal, without a trace, "
        "or if the trace is equal although its hash is not."
    )
    difference: float | None = about(
        "Largest difference of a coordinate there [m, rad, m/s or rad/s]."
    )
    stored_engine: str
    damage: str | None = about(
        "Damage of the stored trace; the replay does not use it.", default=None
    )


class ChangingRelease(Model):
    """Two releases with different outcomes, and the number of releases that were run."""

    before: str
    after: str
    skipped: dict[str, str] = about("Releases between them that do not run, with the reason.")
    steps: int = about("Number of releases between the ends that were run.")


class Bisection(ChangingRelease, ReportModel):
    """The release of MuJoCo that changed an outcome."""

    comparison: ComparisonReport | None = about("With the release before; null for a test.")
    folder: Path = about("Folder of the results of each release.")


class WrittenLock(ReportModel):
    """A written lock, and the store of its outcomes."""

    file: Path
    store: Path
    runs: int
    check: str = about("Command line that checks the lock.")


class WrittenBaseline(ReportModel):
    """A baseline: a store without its traces."""

    store: str = about("The store that it is a copy of.")
    baseline: str = about("Folder of the baseline.")
    runs: int
    bytes: int
    digest: str


class ExpandedTraces(ReportModel):
    """Traces that were written as messages."""

    folder: Path
    traces: int
    bytes: int


class WrittenBundle(ReportModel):
    """Runs that were written for an engine on another machine."""

    folder: Path
    runs: int
    refused: dict[str, str] = about("Refused runs, with the reason of each.")
