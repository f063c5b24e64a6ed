"""What drives the runs of one structure: servos in their models, controls and signals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.scene.drive.hold import (
    Posture,
    Servos,
    Support,
    find_servos,
    find_support,
    hold_posture,
    unheld,
)
from contactlab.scene.drive.recorded import DriveTable, RecordedInputs, read_recorded
from contactlab.scene.drive.signals import (
    ControlRoom,
    control_room,
    exercise_signals,
    noise_signals,
)
from contactlab.scene.initial_states import (
    InitialStateRule,
    InitialStates,
    at_begin,
    initial_states,
)
from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.drive import Drive, FileDrive, NoiseDrive, PolicyDrive

_HOLDING = 0.1
"""Share of an exercise in which it holds first."""
_TURN, _SHIFT = 1.0, 0.2
"""Speeds with which what has no actuators starts an exercise [rad/s, m/s]."""


def is_driven(drive: Drive) -> bool:
    """Return whether a drive decides starts and signals; a policy does not, before its run."""
    return drive != "none" and not isinstance(drive, PolicyDrive)


@dataclass(frozen=True)
class Driving:
    """Drives the runs of one structure that start from one keyframe.

    Attributes:
        model: the structure's model, as written.
        drive: what drives them.
        rule: how their initial states are made.
        servos: springs of the actuators that are held.
        held: actuators that are held; others are driven by a file or by the scene itself.
        recorded: what the drive's file says, if it has one.
    """

    model: mujoco.MjModel
    drive: Drive
    rule: InitialStateRule
    servos: Servos
    held: frozenset[int]
    recorded: RecordedInputs | None
    _postures: dict[tuple[float, ...], tuple[Posture, ControlRoom]] = field(
        default_factory=dict[tuple[float, ...], tuple[Posture, ControlRoom]]
    )
    _shared: dict[tuple[float, ...], Signals] = field(
        default_factory=dict[tuple[float, ...], Signals]
    )

    @classmethod
    def of(
        cls, model: mujoco.MjModel, drive: Drive, rule: InitialStateRule, table: DriveTable | None
    ) -> "Driving":
        """Return what drives the runs of a model.

        Raises:
            SceneError: the drive's file does not suit the model.
        """
        recorded = None
        if isinstance(drive, FileDrive) and table is not None:
            recorded = read_recorded(model, table, held=drive.interpolation == "hold")
        own = rule.driven_inputs | set(recorded.signals.places.tolist() if recorded else ())
        held = frozenset(range(model.nu)) - own
        return cls(
            model=model,
            drive=drive,
            rule=rule,
            servos=find_servos(model, rule.qpos).of(held),
            held=held,
            recorded=recorded,
        )

    @cached_property
    def _support(self) -> Support:
        """How a robot stands, found once: for its start as written."""
        return find_support(self.model, self.servos, self.rule.qpos, self.rule.held_ctrl)

    def starts(self, runs: Sequence[ResolvedRun]) -> InitialStates:
        """Return the initial states of runs, driven.

        Raises:
            SceneError: a run is too long for the drive's file, or its steps too long for the noise.
        """
        starts = initial_states(self.rule, [(run.initial, run.seed) for run in runs])
        fields, signals = starts._asdict(), list(starts.signals)
        held = np.array(sorted(self.held), np.intp)
        addresses = np.asarray(self.model.actuator_actadr)[held]
        addresses = addresses[addresses >= 0]
        for place, run in enumerate(runs):
            posture, room = self._posture(run.initial)
            fields["ctrl"][place, held] = posture.ctrl[held]
            fields["act"][place, addresses] = posture.act[addresses]
            own, driven = signals[place], self._signals(posture, room, run)
            if own.places.size:
                driven = own.joined(driven.without(np.isin(driven.places, own.places)))
            signals[place] = driven
        for coordinate, value in self.recorded.start if self.recorded else ():
            fields[coordinate.field][:, coordinate.index] = value
        if self.drive == "exercise" and not self.model.nu and not starts.qvel.any():
            fields["qvel"][:] = _free_motion(self.model)
        return at_begin(starts._replace(signals=tuple(signals)))

    def _posture(self, initial: Mapping[str, float]) -> tuple[Posture, ControlRoom]:
        """Return what holds the start of some initial values, before any seed perturbs it."""
        key = tuple(initial.values())
        if key not in self._postures:
            start = self.rule.nominal(initial), self.rule.held_ctrl
            posture = hold_posture(self.model, self.servos, *start, self._support.forces)
            self._postures[key] = posture, control_room(self.model, self.servos, posture)
        return self._postures[key]

    def unheld(self, run: ResolvedRun) -> str:
        """Return what of a run's start is not held, though nothing else drives it."""
        if self.recorded or (self.drive == "exercise" and not self.model.nu):
            return ""
        qpos = self.rule.nominal(run.initial)
        return unheld(self.model, hold_posture(self.model, self.servos, qpos, self.rule.held_ctrl))

    def _signals(self, posture: Posture, room: ControlRoom, run: ResolvedRun) -> Signals:
        if isinstance(self.drive, NoiseDrive):
            if self.drive.rate * run.timestep > 0.5:
                raise SceneError(
                    f"drive: noise up to {self.drive.rate:g} Hz needs timesteps of at most "
                    f"{0.5 / self.drive.rate:g} s, but one is {run.timestep:g} s; "
                    "write a lower `rate`"
                )
            span = min(self._support.settling, run.duration / 2), run.duration
            return self._of_held(noise_signals(posture, room.half, self.drive, span, run.seed))
        key = (run.timestep, run.duration, *run.initial.values())
        if key not in self._shared:
            self._shared[key] = self._seedless(posture, room, run)
        return self._shared[key]

    def _seedless(self, posture: Posture, room: ControlRoom, run: ResolvedRun) -> Signals:
        if self.recorded is not None:
            self.recorded.require(run.duration)
            return self.recorded.snapped(run.timestep)
        if self.drive != "exercise" or not self.model.nu:
            return Signals.none()
        begin = min(max(self._support.settling, _HOLDING * run.duration), 0.4 * run.duration)
        return self._of_held(exercise_signals(self.model, posture, room, begin, run.duration))

    def _of_held(self, signals: Signals) -> Signals:
        if len(self.held) == len(signals.places):
            return signals
        return signals.without(~np.isin(signals.places, list(self.held)))


def _free_motion(model: mujoco.MjModel) -> np.ndarray:
    """Return (nv,) moderate speeds, of alternating signs, at which everything is in motion."""
    speeds = np.where(np.arange(model.nv) % 2, -1.0, 1.0)
    kinds = np.asarray(model.jnt_type)[model.dof_jntid]
    slides = kinds == int(mujoco.mjtJoint.mjJNT_SLIDE)
    free = kinds == int(mujoco.mjtJoint.mjJNT_FREE)
    first = np.arange(model.nv) - np.asarray(model.jnt_dofadr)[model.dof_jntid] < 3
    return speeds * np.where(slides | (free & first), _SHIFT, _TURN)
