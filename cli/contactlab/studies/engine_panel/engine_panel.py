"""The panel of engines: each task of `sweeps/engines` by every installed engine.

A task is run by each engine into a store of its own, at three steps; by an engine that chooses its
own steps, at three accuracies, recorded at the middle step. Stores that are complete are read, the
rest is run or resumed.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from contactlab.engines import ENGINES, find_engine
from contactlab.engines.engine import SimulationEngine
from contactlab.errors import EngineError, OtherSweepError, SceneError, SweepFileError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.plan.overrides import Overrides
from contactlab.resources import SWEEPS
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.schema.engine_panel import REPORT, EnginePanel, PanelRun, PanelTask
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.setting_values import as_number
from contactlab.schema.strict_model import finite_or_none
from contactlab.store.finished_store import Store
from contactlab.studies.engine_panel.closed_forms import TASK_ERRORS
from contactlab.tasks.session import REMOVE, Session

TASKS = {path.stem: path for path in sorted((SWEEPS / "engines").glob("*.yaml"))}
"""Sweep files by task."""
_MEASURES = {
    "billiards": "direction", "bounce": "restitution", "elastic": "restitution", "grasp": "fall, m",
    "gyroscope": "time of a turn", "oblique": "velocity, m/s", "pendulum": "period",
    "roll": "acceleration", "slide": "way", "slope": "way", "spin": "braking",
    "stack": "load of the lowest", "stick": "way that slides, m",
}  # fmt: skip


@dataclass(frozen=True)
class PanelRequest:
    """Names of tasks and engines; default: all tasks, and engines with their own contact laws."""

    tasks: Sequence[str] = ()
    engines: Sequence[str] = ()


def run_panel(request: PanelRequest, session: Session) -> EnginePanel:
    """Run the missing tasks, and measure all of them.

    The folder receives a store of each task and engine, and `panel.json`. Raises a SweepFileError
    if there is no such task; an EngineError if there is no such engine, or it is not installed; an
    OtherSweepError if a store is of other code, or of another version of an engine; an OutputError
    if the folder cannot be written; a StoppedError if the session was stopped.
    """
    for name in request.tasks:
        SweepFileError.unless_known(name, TASKS, f"no task '{name}'")
    requested = [find_engine(name) for name in dict.fromkeys(request.engines)]
    for engine in requested:
        if not engine.version:
            raise EngineError(_absence_reason(engine))
    own = [engine for engine in ENGINES.values() if engine.own_laws]
    engines = requested or [engine for engine in own if engine.version]
    refused = dict[str, list[str]]()  # tasks by reason
    tasks = list(dict.fromkeys(request.tasks or TASKS))
    session.claim("panel", "sweeps/engines")
    runs: list[PanelRun] = []
    panel_tasks: list[PanelTask] = []
    for task in tasks:
        for engine in engines:
            try:
                store = session.run(_read_sweep(task, engine, session))
            except SceneError as error:
                refused.setdefault(str(error), []).append(task)
                continue
            records = list(store.records())
            if stored_versions := {record.engine.version for record in records} - {engine.version}:
                raise OtherSweepError(
                    f"{session.folder / task / engine.name} holds runs of {engine.name} "
                    f"{', '.join(sorted(stored_versions))}, and {engine.version} is installed",
                    REMOVE,
                )
            runs += [_measure_run(task, store, record) for record in records]
        described = _read_sweep(task, ENGINES[MODEL_ENGINE], session).plan.sweep.description
        panel_tasks.append(
            PanelTask(name=task, description=described or "", measure=_MEASURES[task])
        )
    absent = [] if requested else [_absence_reason(engine) for engine in own if not engine.version]
    skipped = [f"{', '.join(without)}: {why}" for why, without in refused.items()]
    report = EnginePanel(
        engines={engine.name: engine.version for engine in engines},
        tasks=tuple(panel_tasks),
        runs=tuple(runs),
        skipped=(*skipped, *absent),
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _absence_reason(engine: SimulationEngine) -> str:
    return getattr(engine, "absence", "") or f"the {engine.name} engine is not installed"


def _read_sweep(task: str, engine: SimulationEngine, session: Session) -> SweepRequest:
    """Return the sweep of a task for an engine; a SceneError says that it cannot simulate it."""
    path = TASKS[task]

    def read(*more: str) -> SweepRequest:
        return read_request(
            path, path.stem, session.folder / task / engine.name, folder=path.parent, workers=0,
            overrides=Overrides(assign=[f"engine={engine.name}", *more]),
        )  # fmt: skip

    request = read()
    if not engine.controls_error:
        return request
    (steps,) = (axis.values for axis in request.plan.axes if axis.name == "timestep")
    accuracies = ",".join(f"{accuracy:g}" for accuracy in (1e-1, 1e-3, 1e-5))
    return read(f"timestep={steps[len(steps) // 2]}", f"tolerance={accuracies}")


def _measure_run(task: str, store: Store, record: EvidenceRecord) -> PanelRun:
    step, accuracy = as_number(record.settings["timestep"]), record.axes.get("tolerance")
    panel_run = PanelRun(
        task=task,
        engine=record.engine.name,
        step=step,
        accuracy=None if accuracy is None else as_number(accuracy),
        error=None,
        energy=None,
        depth=None,
        cost=None,
        label=record.label if record.status == "ok" else record.status_reason or record.status,
    )
    if record.status != "ok":
        return panel_run
    own, metrics = TASK_ERRORS.get(task), record.metrics
    error = own(store.trace(record), record) if own else metrics["oracle_error"]
    return panel_run.model_copy(
        update={
            "error": None if error is None else finite_or_none(abs(error)),
            "energy": metrics.get("energy_drift"),
            "depth": metrics.get("penetration_max"),
            "cost": record.cost.cpu_s / (record.steps * step) if record.cost else None,
        }
    )


def middle_run(panel: EnginePanel, task: str, engine: str) -> PanelRun | None:
    """Return the run of an engine at the middle step or accuracy of a task, or None."""
    runs = [each for each in panel.runs if (each.task, each.engine) == (task, engine)]
    return runs[len(runs) // 2] if runs else None


def better_runs(panel: EnginePanel) -> Iterator[tuple[PanelRun, PanelRun]]:
    """Yield the best run of each task and the run of MuJoCo, if MuJoCo is not the best."""
    better_ratio = 0.99  # a smaller difference is rounding of the same scheme
    for task in panel.tasks:
        measured_runs = [
            each for each in panel.runs if each.task == task.name and each.error is not None
        ]
        ours = [each for each in measured_runs if each.engine == MODEL_ENGINE]
        if ours:
            first, own = (min(some, key=_error_or_infinity) for some in (measured_runs, ours))
            if _error_or_infinity(first) < better_ratio * _error_or_infinity(own):
                yield first, own


def _error_or_infinity(run: PanelRun) -> float:
    return math.inf if run.error is None else run.error
