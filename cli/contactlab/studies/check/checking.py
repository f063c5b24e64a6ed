"""All checks of a model, and the files that they leave."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

from contactlab.errors import SweepFileError, did_you_mean
from contactlab.run.job import Begin, Progress
from contactlab.run.provenance import engine, provenance
from contactlab.run.stop import Stop
from contactlab.schema import CheckName, CheckReport, CheckResult, TaskKind
from contactlab.store import atomic_write, write_error
from contactlab.studies.check.bench import Bench
from contactlab.studies.check.flat_contact import check_flat_contact
from contactlab.studies.check.free_motion import check_free_motion
from contactlab.studies.check.hold import check_hold
from contactlab.studies.check.page import page
from contactlab.studies.check.repeat import check_repeat, reference_of
from contactlab.studies.check.shells import check_shells
from contactlab.studies.check.target import open_target
from contactlab.studies.check.timestep import check_timestep, kind_of

CHECKS: tuple[CheckName, ...] = get_args(CheckName)
REPORT, PAGE, REFERENCE = "check.json", "check.md", "reference.json"


@dataclass(frozen=True)
class CheckAsk:
    """Which model to check, and how.

    Attributes:
        model: a shipped scene, a folder, a model file or another reference to a scene.
        folder: where stores, report and page go.
        assign: `NAME=VALUE`, as typed.
        only: names of checks; all if empty.
        kind: of task; told from the model if None.
        workers: processes.
    """

    model: str
    folder: Path
    assign: Sequence[str] = ()
    only: Sequence[str] = ()
    kind: TaskKind | None = None
    workers: int = 0


def check_model(
    ask: CheckAsk, begin: Begin, progress: Progress, stop: Stop | None = None
) -> CheckReport:
    """Check a model; write `check.json`, `check.md` and `reference.json` beside the stores.

    Args:
        ask: what to check.
        begin: told how many runs a store has, and how many of them are done already.
        progress: told of runs as they finish.
        stop: set when it should end soon.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: an option is wrong.
        OutputError: the folder cannot be written.
        StoppedError: it was told to stop.
    """
    names = _chosen(ask.only)
    target = open_target(ask.model, ask.assign)
    kind, why = kind_of(target, ask.kind)
    bench = Bench(target, ask.folder, ask.workers, begin, progress, stop)
    checks: dict[CheckName, Callable[[Bench], CheckResult]] = {
        "timestep": lambda bench: check_timestep(bench, kind),
        "free_motion": check_free_motion,
        "flat_contact": check_flat_contact,
        "hold": check_hold,
        "repeat": check_repeat,
        "shells": check_shells,
    }
    results = tuple(checks[name](bench) for name in names)
    report = CheckReport(
        model=ask.model,
        scene=target.scene.name,
        scene_hash=target.scene.hash,
        overrides=target.given,
        keyframe=target.keyframe,
        kind=kind,
        kind_reason=why,
        settings=target.resolved.values,
        engine=engine(),
        provenance=provenance(),
        passed=all(each.verdict != "fail" for each in results),
        checks=results,
    )
    _write(ask.folder, report, bench)
    return report


def _chosen(only: Sequence[str]) -> list[CheckName]:
    for name in only:
        if name not in CHECKS:
            hint = did_you_mean(name, CHECKS)
            raise SweepFileError(f"no check '{name}'{hint}; there are {', '.join(CHECKS)}")
    chosen = [name for name in CHECKS if name in only or not only]
    return cast("list[CheckName]", chosen)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_error(folder, error) from error


def _write(folder: Path, report: CheckReport, bench: Bench) -> None:
    _make(folder)
    files = {REPORT: report.model_dump_json(indent=2) + "\n", PAGE: page(report)}
    if bench.has_own and bench.own.record.trajectory_hash is not None:
        files[REFERENCE] = reference_of(bench.own).model_dump_json(indent=2) + "\n"
    for name, text in files.items():
        with atomic_write(folder / name) as path:
            path.write_text(text, encoding="utf-8")
