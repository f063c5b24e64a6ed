"""Time that accuracy costs: a sweep that measures errors and times, then its analysis.

The analysis of a stored sweep is in `contactlab.pareto`, and needs no engine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from contactlab import resources
from contactlab.errors import SceneError, StoreError
from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.criteria import Criteria, find_error_metric, find_store
from contactlab.plan.overrides import FlagSetting, Overrides
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.planned_runs import open_store_scene
from contactlab.run.stored_runs import canonical_values
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.scene.parameters import PARAMETERS
from contactlab.schema.evidence import ERRORS
from contactlab.schema.tradeoff_report import Recommendation, TradeoffReport
from contactlab.store.finished_store import Store
from contactlab.store.store_files import Address
from contactlab.tasks.session import Session
from contactlab.tasks.task_verdict import records_of, refuse_lengths, task_verdict
from contactlab.temporary_folders import temporary_folder


@dataclass(frozen=True)
class TradeoffRequest:
    """The configurations to evaluate, and the criteria."""

    source: str  # a store, a sweep file, or the name of a shipped sweep
    criteria: Criteria  # which error stands for accuracy, and tolerances over the sweep's
    # Where the store of a sweep goes; if None, under its name in the session's folder.
    store: Address | None = None
    # Options that replace parts of the task of a sweep and its scene.
    task: TaskOptions = AS_INFERRED
    model: Path | None = None  # folder to write the model with the recommendation into


def sweep_settings(request: TradeoffRequest, session: Session) -> TradeoffReport:
    """Evaluate the configurations of a store, after running the sweep if it is one.

    A sweep is run with errors, times and a baseline of the scene as written, even if its file does
    not request them. The session is notified of likely mistakes in it. The recommendation is
    written into the store's copy of the model; a note names settings that cannot be. Raises a
    SweepFileError if the sweep holds mistakes, or lacks a metric of the criteria; a StoreError if
    the store has no error to evaluate; a StoppedError if the session was stopped.
    """
    refuse_lengths(request.task)
    stored = find_store(request.source, request.store)
    task = verdict = None
    if stored is not None:
        store = Store.open(stored)
    else:
        sweep = _read_sweep(request, session)
        for warning in sweep.plan.warnings:
            session.notify(str(warning))
        store = session.run(sweep)
        seeds, duration = sweep.plan.sweep.seed_values, sweep.plan.sweep.duration
        watch, within = request.task.observe, request.task.tolerance
        # The task is that of the model as written, in the first scenario.
        first = next(sweep.plan.iterate_runs()).values
        scenario = sweep.plan.sweep.scenario
        values = {name: value for name, value in first.items() if name in scenario}
        task = sweep.scene.task(values, duration, watch=watch, within=within, seeds=tuple(seeds))
        records = records_of(store, sweep.scene, values, task)
        verdict = task_verdict(task, sweep.scene, values, records, session)
    report = analyze_tradeoff(store, request.criteria)
    with temporary_folder() as folder:
        chosen, notes = _write_choice(
            report, report.recommendation, request.model or Path(folder), store
        )
        robust, _ = _write_choice(report, report.robust, Path(folder), store)
    recommendation_fields = {
        "recommendation": chosen,
        "robust": robust,
        "notes": (*report.notes, *notes),
    }
    return report.model_copy(update={**recommendation_fields, "task": task, "verdict": verdict})


def _write_choice(
    report: TradeoffReport, pick: Recommendation | None, folder: Path, store: Store
) -> tuple[Recommendation | None, Sequence[str]]:
    """Return the recommendation with its changes of the model, written into a folder; notes."""
    if pick is None:
        return None, ()
    own = report.baseline.configuration if report.baseline else {}
    changed = [knob for knob in report.knobs if own.get(knob, ...) != pick.configuration[knob]]
    settings = {name for name in changed if name in PARAMETERS or name in EFFECTS or "[" in name}
    other = {name: pick.configuration[name] for name in changed if name not in settings}
    try:
        scene = open_store_scene(store)
        values = canonical_values(scene, store.record(pick.run_id).axes)
        edits = ModelEdits({setting: values[setting] for setting in settings if setting in values})
        lines = write_model(scene, edits, folder).lines
    except (SceneError, StoreError) as error:
        return pick, (f"what is recommended is in no file of the model: {error}",)
    return pick.model_copy(update={"mjcf": lines, "other": other}), ()


def _read_sweep(request: TradeoffRequest, session: Session) -> SweepRequest:
    """Return the sweep, with the measurements that the analysis needs and its file leaves out."""
    path = resources.find_sweep(request.source)
    read_with = partial(
        read_request,
        path,
        path.stem,
        request.store or session.folder / path.stem,
        folder=path.parent,
        workers=session.workers,
        drive=request.task.drive,
    )
    sweep, criteria, added = read_with().plan.sweep, request.criteria, list[str | FlagSetting]()
    # Runs against a reference cost more than all others; other errors are measured without them.
    error = criteria.metric or find_error_metric({**sweep.tolerances, **criteria.tolerances})
    if (error is None or error in ERRORS) and sweep.accuracy is None:
        added.append("accuracy={error: auto}")
    if not sweep.baseline:
        added.append("baseline=true")
    if sweep.timing is None:
        added.append("timing={contenders: true}")
    elif "contenders" not in sweep.timing.model_fields_set:
        added.append("timing.contenders=true")
    if request.task.seeds is not None:
        added.append(FlagSetting(f"seeds={request.task.seeds}", "--seeds"))
    return read_with(overrides=Overrides(assign=(*added, *request.task.settings)))
