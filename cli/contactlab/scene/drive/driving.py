"""What drives the runs of one structure: servos in their models, controls and signals."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import groupby

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
from contactlab.scene.drive.recorded import RecordedTable, read_recorded
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
from contactlab.schema.drive import (
    Drive,
    FileDrive,
    HeldDrive,
    NoiseDrive,
    PolicyDrive,
    Springs,
    drive_word,
)

_HOLDING = 0.1  # share of an exercise in which it holds first
_TURN, _SHIFT = 1.0, 0.2  # speeds with which what has no actuators starts an exercise [rad/s, m/s]


def is_driven(drive: Drive) -> bool:
    """Return whether a drive decides starts and signals; a policy does not, before its run."""
    return drive != "none" and not isinstance(drive, PolicyDrive)


class Driving:
    """Drives the runs of one structure that start from one keyframe.

    Its `servos` are of the actuators that are held; a file or the scene itself drives the others.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        drive: Drive,
        rule: InitialStateRule,
        table: RecordedTable | None,
    ) -> None:
        """Find what drives the runs of a model, as written, whose initial states a rule makes.

        Raises a SceneError if the drive's file does not suit the model.
        """
        self._model, self._drive, self._rule, self._recorded = model, drive, rule, None
        self._word = drive_word(drive)
        if isinstance(drive, FileDrive) and table is not None:
            self._recorded = read_recorded(model, table, held=drive.interpolation == "hold")
        own = rule.driven_inputs
        own |= set(self._recorded.signals.places.tolist() if self._recorded else ())
        self._held = np.array([each for each in range(model.nu) if each not in own], np.intp)
        held = isinstance(drive, HeldDrive | NoiseDrive | FileDrive)
        self._given = drive.springs if held else None
        servos = self._given and _servos(model, self._given)
        self.servos = (servos or find_servos(model, rule.qpos)).of(self._held)
        self._postures = dict[tuple[float, ...], tuple[Posture, ControlRoom]]()
        self._shared = dict[tuple[float, ...], Signals]()

    @cached_property
    def _support(self) -> Support:
        """How a robot stands, found once: for its start as written."""
        if self._given:
            return Support(np.array(self._given.forces), self._given.settling)
        if not self._held.size:
            return Support(np.zeros(self._model.nu), 0.0)
        return find_support(self._model, self.servos, self._rule.qpos, self._rule.held_ctrl)

    @property
    def springs(self) -> Springs:
        """What holds the start, to be given to another model."""
        servos, support = self.servos, self._support
        return Springs(
            actuators=tuple(servos.actuators.tolist()),
            stiffness=tuple(servos.stiffness.tolist()),
            damping=tuple(servos.damping.tolist()),
            forces=tuple(support.forces.tolist()),
            settling=support.settling,
        )

    def starts(self, runs: Sequence[ResolvedRun]) -> InitialStates:
        """Return the initial states of runs, driven.

        Raises a SceneError if a run is too long for the drive's file, or its steps too long for the
        noise.
        """
        starts = initial_states(self._rule, [run.start for run in runs])
        fields, signals, held = starts._asdict(), list(starts.signals), self._held
        addresses = np.asarray(self._model.actuator_actadr)[held]
        addresses = addresses[addresses >= 0]
        for _, group in groupby(enumerate(runs), lambda each: _pace(each[1])):
            places, alike = zip(*group, strict=True)
            posture, room = self._posture(alike[0].initial)
            fields["ctrl"][np.ix_(places, held)] = posture.ctrl[held]
            fields["act"][np.ix_(places, addresses)] = posture.act[addresses]
            for place, driven in zip(places, self._signals(posture, room, alike), strict=True):
                signals[place] = signals[place].joined(driven)
        for part, index, value in self._recorded.start if self._recorded else ():
            fields[part][:, index] = value
        if self._word == "exercise" and not self._model.nu and not starts.qvel.any():
            fields["qvel"][:] = _free_motion(self._model)
        return at_begin(starts._replace(signals=tuple(signals)))

    def _posture(self, initial: Mapping[str, float]) -> tuple[Posture, ControlRoom]:
        """Return what holds the start of some initial values, before any seed perturbs it."""
        key = tuple(initial.values())
        if key not in self._postures:
            start = self._rule.nominal(initial), self._rule.held_ctrl
            posture = hold_posture(self._model, self.servos, *start, self._support.forces)
            self._postures[key] = posture, control_room(self._model, self.servos, posture)
        return self._postures[key]

    def unheld(self, run: ResolvedRun) -> str:
        """Return what of a run's start is not held, though nothing else drives it."""
        if self._recorded or (self._word == "exercise" and not self._model.nu):
            return ""
        posture, _ = self._posture(run.initial)
        return unheld(self._model, self.servos, self._rule.nominal(run.initial), posture)

    def _signals(
        self, posture: Posture, room: ControlRoom, runs: Sequence[ResolvedRun]
    ) -> Sequence[Signals]:
        """Return what drives runs that differ in their seeds only, as `_pace` says."""
        run = runs[0]
        if isinstance(self._drive, NoiseDrive):
            if self._drive.rate * run.timestep > 0.5:
                raise SceneError(
                    f"drive: noise up to {self._drive.rate:g} Hz needs timesteps of at most "
                    f"{0.5 / self._drive.rate:g} s, but one is {run.timestep:g} s; "
                    "write a lower `rate`"
                )
            span = min(self._support.settling, run.duration / 2), run.duration
            seeds = [each.seed for each in runs]
            noise = noise_signals(posture, room.half, self._drive, span, seeds)
            return [self._of_held(each) for each in noise]
        key = _pace(run)
        if key not in self._shared:
            self._shared[key] = self._seedless(posture, room, run)
        return [self._shared[key]] * len(runs)

    def _seedless(self, posture: Posture, room: ControlRoom, run: ResolvedRun) -> Signals:
        if self._recorded is not None:
            return self._recorded.during(run.duration, run.timestep)
        if self._word != "exercise" or not self._model.nu:
            return Signals.none()
        begin = min(max(self._support.settling, _HOLDING * run.duration), 0.4 * run.duration)
        return self._of_held(exercise_signals(self._model, posture, room, begin, run.duration))

    def _of_held(self, signals: Signals) -> Signals:
        if len(self._held) == len(signals.places):
            return signals
        return signals.without(~np.isin(signals.places, self._held))


def _servos(model: mujoco.MjModel, springs: Springs) -> Servos:
    """Return given springs for a model; a SceneError if they are of other actuators."""
    if len(springs.forces) != model.nu or any(each >= model.nu for each in springs.actuators):
        raise SceneError(
            f"drive: its springs are of a model with {len(springs.forces)} actuators, but this one "
            f"has {model.nu}; leave them out"
        )
    gains = np.array(springs.stiffness), np.array(springs.damping)
    return Servos.of_model(model, np.array(springs.actuators, np.intp), *gains)


def _pace(run: ResolvedRun) -> tuple[float, ...]:
    """Return what runs share whose signals differ by their seeds only."""
    return run.timestep, run.duration, *run.initial.values()


def _free_motion(model: mujoco.MjModel) -> np.ndarray:
    """Return (nv,) moderate speeds, of alternating signs, at which everything is in motion."""
    speeds = np.where(np.arange(model.nv) % 2, -1.0, 1.0)
    kinds = np.asarray(model.jnt_type)[model.dof_jntid]
    slides = kinds == int(mujoco.mjtJoint.mjJNT_SLIDE)
    free = kinds == int(mujoco.mjtJoint.mjJNT_FREE)
    first = np.arange(model.nv) - np.asarray(model.jnt_dofadr)[model.dof_jntid] < 3
    return speeds * np.where(slides | (free & first), _SHIFT, _TURN)
