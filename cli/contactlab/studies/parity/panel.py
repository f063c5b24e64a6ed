"""The panel: the runs of a sweep, each for MuJoCo and for another engine."""

import json
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import (
    Buffers,
    PreparedRuns,
    Rollout,
    SimulationEngine,
    bytes_of_run,
)
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import SweepFileError
from contactlab.measure import assess_runs
from contactlab.plan.grid import Run
from contactlab.plan.overrides import Overrides
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.run_setup import make_setup
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.drive import Drive, PolicyDrive


@dataclass(frozen=True)
class PanelRun:
    """One run: its values, and its specification for MuJoCo and for the engine."""

    run: Run
    run_id: str
    ours: RunSpec
    theirs: RunSpec


@dataclass(frozen=True)
class Panel:
    """The runs of a sweep, once each."""

    request: SweepRequest
    scene: Scene
    runs: Sequence[PanelRun]

    @classmethod
    def read(
        cls,
        path: Path,
        engine: str,
        overrides: Overrides,
        changes: Sequence[str],
        drive: Drive | None,
    ) -> "Panel":
        """Read a sweep for an engine, with the changes for the engine alone.

        A SweepFileError or a SceneError says why it is wrong.
        """

        def read(more: Sequence[str]) -> SweepRequest:
            assign = [*overrides.assign, f"engine={engine}", *more]
            options = replace(overrides, assign=assign)
            return read_request(
                path, path.stem, path.parent, folder=path.parent, workers=0, overrides=options,
                drive=drive,
            )  # fmt: skip

        request, changed = read(()), read(changes)
        scene, duration = request.scene, request.plan.sweep.duration
        sizes = {
            math.prod(axis.count for axis in requested.plan.axes)
            for requested in (request, changed)
        }
        if len(sizes) > 1:
            raise SweepFileError(f"--with {' '.join(changes)}: give one value to each")
        runs: dict[str, PanelRun] = {}
        for pair in zip(request.plan.iterate_runs(), changed.plan.iterate_runs(), strict=True):
            ours, theirs = (scene.resolve(geom.values, geom.seed, duration) for geom in pair)
            if (ours.structure, ours.steps) != (theirs.structure, theirs.steps):
                raise SweepFileError(
                    f"--with {' '.join(changes)}: the engine must have the same bodies and steps; "
                    "change what acts between them"
                )
            run_id = scene.run_id(ours)
            runs.setdefault(run_id, PanelRun(pair[0], run_id, ours, theirs))
        if not runs:
            raise SweepFileError(f"sweep '{path.stem}' has no runs")
        return cls(request, scene, tuple(runs.values()))

    def find_refusals(self, refusal: Callable[[Scene, RunSpec], str | None]) -> dict[str, str]:
        """Return why runs cannot be simulated, by run id, as an engine's `refusal` says."""
        refusals: dict[str, str] = {}
        for run in self.runs:
            if isinstance(run.ours.drive, PolicyDrive):
                refusals[run.run_id] = (
                    "the drive is a policy; use a file of recorded controls instead"
                )
            elif why := refusal(self.scene, run.theirs):
                refusals[run.run_id] = why
        return refusals

    def group_runs(self, left_out: Collection[str]) -> Iterator[Sequence[PanelRun]]:
        """Yield runs of one structure and step count, as many as memory holds together.

        Those of some run ids are left out.
        """

        def key(member: PanelRun) -> str:
            run = member.ours
            return json.dumps([run.structure, sorted(run.without), run.steps], sort_keys=True)

        rest = [member for member in self.runs if member.run_id not in left_out]
        for _, group in groupby(sorted(rest, key=key), key):
            alike = list(group)
            first = alike[0].ours
            size = bytes_of_run(self.scene.base_of(first).model, first.steps)
            most_runs, most_bytes = 64, 64 << 20
            most = max(1, min(most_runs, most_bytes // size))
            yield from (alike[at : at + most] for at in range(0, len(alike), most))

    def measure_runs(self, runs: PreparedRuns, rollout: Rollout) -> list[dict[str, float | str]]:
        """Return the metrics of each run, its worst label, and the energy it ends with and had."""
        manifest, sweep = self.scene.source.manifest, self.request.plan.sweep
        trace = make_trace(runs.base, runs.prepared, rollout)
        setup = make_setup(runs.base, manifest, runs.resolved, runs.models, sweep.thresholds)
        setup = replace(setup, recorded=self.scene.recorded_motion(runs.resolved))
        measured_runs: list[dict[str, float | str]] = []
        for run, steps in enumerate(rollout.steps):
            if not steps:
                measured_runs.append({})
                continue
            alone = trace.select([run], steps)
            assessment = assess_runs(alone, setup.select([run]))
            energy = (alone.kinetic + alone.potential)[0]
            measured_runs.append(
                {name: float(values[0]) for name, values in assessment.metrics.items()}
                | {"label": assessment.labels[0][0].label}
                | {"energy_end": float(energy[-1]), "energy_range": float(np.ptp(energy))}
            )
        return measured_runs


def runs_from_states(
    runs: PreparedRuns, run: int, states: Floats, places: np.ndarray
) -> PreparedRuns:
    """Return one step from each of (K, nstate) states of a run, as its steps (K,) drive it."""
    model, count = runs.models[run], len(places)
    inputs = runs.starts.input_rows(run, model.opt.timestep, places)
    driven = np.split(inputs, [model.nu, model.nu + 6 * model.nbody], axis=1)
    parts = np.split(states[:, 1:], [model.nq, model.nq + model.nv], axis=1)
    return replace(
        runs,
        resolved=[runs.resolved[run]] * count,
        prepared=[runs.prepared[run]] * count,
        starts=InitialStates(*parts, *driven, signals=(Signals.no_signals(),) * count),
        steps=1,
    )


def roll_out(engine: SimulationEngine, runs: PreparedRuns) -> Rollout:
    """Return the rollout of runs by an engine."""
    return engine.roll_out(runs, Buffers())
