"""Drives of the runs of one structure: controls at rest, signals, and a holding load."""

from collections.abc import Sequence
from itertools import groupby

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.scene.drive.hold import Load, find_load, unheld_text
from contactlab.scene.drive.recorded import RecordedTable, read_recorded
from contactlab.scene.drive.signals import (
    control_ranges,
    excitation_signals,
    neutral_controls,
    noise_signals,
)
from contactlab.scene.initial_states import (
    InitialStateRule,
    InitialStates,
    at_begin,
    initial_states,
)
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.task import rest_time
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.drive import Drive, FileDrive, NoiseDrive, PolicyDrive


def is_driven(drive: Drive) -> bool:
    """Return whether a drive decides starts and signals; a policy does not before its run."""
    return drive != "none" and not isinstance(drive, PolicyDrive)


class Driving:
    """Drives the runs of one structure that start from one keyframe.

    No actuator is altered. Controls driven neither by a file nor by the scene itself rest: at the
    keyframe's values, or otherwise at neutral ones. `load` holds the start, if the drive does.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        drive: Drive,
        rule: InitialStateRule,
        table: RecordedTable | None,
    ) -> None:
        """Prepare the drive of runs of an unchanged model with initial states from a rule.

        Raises a SceneError if the drive's file does not fit the model.
        """
        self._model, self._drive, self._rule, self._recorded = model, drive, rule, None
        if isinstance(drive, FileDrive) and table is not None:
            self._recorded = read_recorded(model, table, is_held=drive.interpolation == "hold")
        own = rule.driven_inputs
        own |= set(self._recorded.signals.places.tolist() if self._recorded else ())
        self._resting = np.array(
            [actuator for actuator in range(model.nu) if actuator not in own], np.intp
        )
        held_ctrl = rule.held_ctrl
        self._rest = neutral_controls(model, rule.qpos) if held_ctrl is None else held_ctrl
        self._loads = dict[tuple[tuple[str, float], ...], Load]()
        self._shared = dict[tuple[object, ...], Signals]()

    def find_load(self, run: RunSpec) -> Load | None:
        """Return the load that holds a run's unperturbed start, if the drive holds it."""
        if self._drive != "hold":
            return None
        key = tuple(sorted(run.initial.items()))
        if key not in self._loads:
            start = initial_states(self._rule, [(run.initial, 0, 0.0)])
            ctrl = start.ctrl[0]
            ctrl[self._resting] = self._rest[self._resting]
            self._loads[key] = find_load(self._model, start.qpos[0], ctrl, start.act[0])
        return self._loads[key]

    def with_start_inputs(self, runs: Sequence[RunSpec]) -> InitialStates:
        """Return the initial states of runs, with their signals.

        Raises a SceneError if a run is too long for the drive's file, or its timestep too long for
        the noise.
        """
        starts = initial_states(self._rule, [run.start for run in runs])
        fields, signals = starts._asdict(), list(starts.signals)
        fields["ctrl"][:, self._resting] = self._rest[self._resting]
        for _, group in groupby(enumerate(runs), lambda numbered: _signal_key(numbered[1])):
            places, alike = zip(*group, strict=True)
            for place, driven in zip(places, self._group_signals(alike), strict=True):
                signals[place] = signals[place].merge_signals(driven)
        for part, index, value in self._recorded.start if self._recorded else ():
            fields[part][:, index] = value
        return at_begin(starts._replace(signals=tuple(signals)))

    def unheld_joints(self, run: RunSpec) -> str:
        """Return the joints of a run's start that a hold does not hold; empty for other drives."""
        load = self.find_load(run)
        return (
            unheld_text(self._model, self._rule.nominal_configuration(run.initial), load)
            if load
            else ""
        )

    def _group_signals(self, runs: Sequence[RunSpec]) -> Sequence[Signals]:
        """Return the signals of runs that differ only in their seeds; see `_signal_key`."""
        run = runs[0]
        if isinstance(self._drive, NoiseDrive):
            if self._drive.rate * run.timestep > 0.5:
                raise SceneError(
                    f"drive: noise up to {self._drive.rate:g} Hz needs timesteps of at most "
                    f"{0.5 / self._drive.rate:g} s, but one is {run.timestep:g} s; "
                    "write a lower `rate`"
                )
            half = np.ptp(control_ranges(self._model).reshape(-1, 2), axis=1) / 2
            seeds = [run.seed for run in runs]
            noise = noise_signals(self._rest, half, self._drive, run.duration, seeds)
            return [self._resting_only(setting) for setting in noise]
        if self._drive == "exercise":
            return [self._excitation_for(run) for run in runs]
        key = _signal_key(run)
        if key not in self._shared:
            recorded = self._recorded
            self._shared[key] = (
                recorded.signals_for(run.duration, run.timestep)
                if recorded
                else Signals.no_signals()
            )
        return [self._shared[key]] * len(runs)

    def _excitation_for(self, run: RunSpec) -> Signals:
        span = rest_time(run.duration), run.duration
        signals = excitation_signals(self._model, self._rest, span, run.seed)
        return self._resting_only(signals.at_steps(run.timestep))

    def _resting_only(self, signals: Signals) -> Signals:
        other = np.setdiff1d(np.arange(self._model.nu), self._resting)
        return signals.exclude_inputs(np.isin(signals.places, other)) if other.size else signals


def _signal_key(run: RunSpec) -> tuple[object, ...]:
    """Return the key of runs with signals that differ only by their seeds."""
    return run.timestep, run.duration, *sorted(run.initial.items())
