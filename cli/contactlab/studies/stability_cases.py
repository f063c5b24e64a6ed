"""The catalogue of hard cases: shipped sweeps whose expectations say what holds and what fails."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from contactlab import resources
from contactlab.errors import SweepFileError, did_you_mean
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import ProgressCallback, Stop
from contactlab.scene import is_menagerie, menagerie_name
from contactlab.store import Store

FOLDER = "stability"
_MODELS = (".xml", ".urdf", ".mjcf")


@dataclass(frozen=True)
class Case:
    """One hard case: a sweep that expects something of its runs.

    Attributes:
        name: its name.
        source: the sweep file, or the text of a generic one.
        folder: where relative paths of its scene start.
    """

    name: str
    source: Path | str
    folder: Path


@dataclass(frozen=True)
class CaseResult:
    """What came of a case.

    Attributes:
        name: the case.
        runs: how many runs it has.
        asked: of how many of them something was expected.
        met: how many of these came out as expected.
        controls: runs that had to fail, and did.
        labels: runs by label.
        error: largest oracle error of the runs that had to hold; None without an oracle.
        step: earliest step at which a run failed that had to hold; None if none did.
        misses: what was missed, with the start of the run's id.
        seconds: wall time [s].
        store: its evidence.
        left_out: why runs were left out that only newer engines can do.
    """

    name: str
    runs: int
    asked: int
    met: int
    controls: int
    labels: dict[str, int]
    error: float | None
    step: int | None
    misses: tuple[str, ...]
    seconds: float
    store: Path
    left_out: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether everything expected came out."""
        return self.met == self.asked > 0


def find_cases(names: list[str]) -> list[Case]:
    """Return cases by name, a generic one for a model file, a scene's folder or a robot.

    Without names, return all.

    Raises:
        SweepFileError: there is no such case.
    """
    known = {path.stem: path for path in sorted((resources.sweeps() / FOLDER).glob("*.yaml"))}
    return [_case(name, known) for name in names or known]


def run_case(
    case: Case,
    results: Path,
    workers: int,
    begin: Callable[[int, int], None],
    progress: ProgressCallback,
    stop: Stop | None = None,
) -> CaseResult:
    """Run one case into a store of its own; one that was interrupted goes on.

    Args:
        case: the case.
        results: the folder of the stores.
        workers: processes.
        begin: told how many runs there are and how many of them are done already.
        progress: told of runs as they finish.
        stop: set when it should end soon.

    Raises:
        StoppedError: it was told to stop.
    """
    store = results / case.name
    started = time.monotonic()
    fresh = (store / "manifest.json").is_file()
    ask = read_request(
        case.source,
        case.name,
        store,
        folder=case.folder,
        workers=workers,
        fresh=fresh,
        partly=True,
    )
    rows: list[dict[str, Any]] = []
    if ask.plan.count:
        run_sweep(ask, begin, progress, stop)
        rows = Store.open(store).table.to_pylist()
    result = _result(case.name, rows, time.monotonic() - started, store)
    return replace(result, left_out=ask.left_out)


def _case(name: str, known: dict[str, Path]) -> Case:
    if name in known:
        return Case(name, known[name], known[name].parent)
    if is_menagerie(name):
        return Case(menagerie_name(name), _GENERIC.format(scene=name), Path())
    path = Path(name)
    if path.suffix in _MODELS or path.is_dir():
        text = _GENERIC.format(scene=str(path.resolve()))
        return Case(path.stem, text, Path())
    raise SweepFileError(
        f"no case '{name}'{did_you_mean(name, known)}; there are {', '.join(known)}, "
        "and any model file, folder of a scene or menagerie:ROBOT"
    )


_GENERIC = """\
version: 1
scene: "{scene}"
description: Generic checks of a model, from slightly different starts
seeds: 3
checks: all
trace: flagged
expect:
  - {{label: stable, reason: a sound model needs no excuse}}
"""


def _result(name: str, rows: list[dict[str, Any]], seconds: float, store: Path) -> CaseResult:
    asked = [row for row in rows if row["expectation_met"] is not None]
    held = [row for row in asked if "stable" in (row["expected"] or ["stable"])]
    failed = [row for row in held if not row["expectation_met"]]
    errors = [row["oracle_error"] for row in held if row["oracle_error"] is not None]
    steps = [row["label_step"] for row in failed if row["label_step"] is not None]
    return CaseResult(
        name=name,
        runs=len(rows),
        asked=len(asked),
        met=sum(row["expectation_met"] for row in asked),
        controls=sum(row["expectation_met"] for row in asked if row not in held),
        labels=dict(Counter(row["label"] for row in rows)),
        error=max(errors, default=None),
        step=min(steps, default=None),
        misses=tuple(
            f"{row['run_id'][:8]}: {row['expectation_reason']}"
            for row in asked
            if not row["expectation_met"]
        ),
        seconds=seconds,
        store=store,
    )
