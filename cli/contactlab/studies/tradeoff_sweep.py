"""What accuracy costs in time: a sweep that measures errors and times, then its analysis.

The analysis of a stored sweep stands by itself in `contactlab.pareto`, without an engine.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from contactlab import resources
from contactlab.pareto.analysis import analyse
from contactlab.pareto.criteria import Criteria, chosen_error, find_store
from contactlab.plan.overrides import Overrides
from contactlab.run.sweep_request import SceneLoader, SweepRequest, read_request, starter_sweep
from contactlab.scene.scene_source import MODEL_SUFFIXES, is_menagerie
from contactlab.schema.drive import Drive
from contactlab.schema.evidence import ERRORS
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store
from contactlab.store.store_address import Address
from contactlab.studies.session import Session


@dataclass(frozen=True)
class TradeoffRequest:
    """Which configurations to evaluate, and by what.

    Attributes:
        source: a store, a sweep file, the name of a shipped sweep; or a model file or
            menagerie:ROBOT, for the sweep that `init` writes for it.
        criteria: which error stands for accuracy, and tolerances over the sweep's.
        store: where the store of a sweep goes; if None, under its name in the session's folder.
        drive: what drives the runs of a sweep, whatever it and its scene say.
    """

    source: str
    criteria: Criteria
    store: Address | None = None
    drive: Drive | None = None


def run(request: TradeoffRequest, session: Session) -> TradeoffReport:
    """Evaluate the configurations of a store, after running the sweep if it is one.

    A sweep is run with errors and times measured, and with the scene as written beside, even if its
    file does not ask for them. The session is notified of what looks wrong in it.

    Raises:
        SweepFileError: the sweep holds mistakes, or the criteria name what it does not measure.
        StoreError: the store has no error to evaluate.
        StoppedError: the session was stopped.
    """
    stored = find_store(request.source, request.store)
    if stored is not None:
        return analyse(Store.open(stored), request.criteria)
    sweep = _sweep(request, session)
    for warning in sweep.plan.warnings:
        session.notify(str(warning))
    return analyse(session.run(sweep), request.criteria)


def _sweep(request: TradeoffRequest, session: Session) -> SweepRequest:
    source, name, folder = _source(request.source)
    read = partial(
        read_request,
        source,
        name,
        request.store or session.folder / name,
        folder=folder,
        workers=session.workers,
        drive=request.drive,
    )
    added = _added(read().plan.sweep, request.criteria)
    return read(overrides=Overrides(assign=tuple(added)))


def _source(reference: str) -> tuple[Path | str, str, Path]:
    """Return the file or the text of a sweep, its name, and where its relative paths start."""
    if is_menagerie(reference) or Path(reference).suffix in MODEL_SUFFIXES:
        loader = SceneLoader(Path())
        return starter_sweep(reference, loader), loader.open(reference).name, Path()
    path = resources.find_sweep(reference)
    return path, path.stem, path.parent


def _added(sweep: Sweep, criteria: Criteria) -> Iterator[str]:
    """Yield what a sweep is to measure that its file leaves out.

    Runs against a reference cost more than all others; they are left out where the error is of
    another kind.
    """
    error = criteria.error or chosen_error({**sweep.tolerances, **criteria.tolerances})
    if (error is None or error in ERRORS) and sweep.accuracy is None:
        yield "accuracy={error: auto}"
    if not sweep.baseline:
        yield "baseline=true"
    if sweep.timing is None:
        yield "timing={rounds: 3}"
