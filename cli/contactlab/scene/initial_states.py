"""Initial states: the model's or a keyframe's, set by initial values, perturbed by a seed."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, RecordedControls
from contactlab.contact.trace_setup import Joints
from contactlab.expression import Expression
from contactlab.numerical_tolerance import ROUNDING
from contactlab.scene.keyframes import start_data
from contactlab.scene.model_names import (
    STATE_PARTS,
    free_body_heights,
    match_coordinates,
    part_starts,
    start_coordinates,
)
from contactlab.scene.timed_inputs import (
    ControlProfile,
    Signals,
    control_signals,
    evaluate_formula,
    read_control,
    read_formula,
)
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.vocabulary import DROP_HEIGHT, RECORDED_RUN

if TYPE_CHECKING:
    from contactlab.scene.recording import RecordedRuns


class InitialStates(NamedTuple):
    """Initial states and inputs of n runs; the arrays are in the order of `PARTS`.

    The inputs are the controls, then `applied`, then `mocap`. Signals drive some of them over time;
    the others are constant.
    """

    qpos: Floats  # (n, nq) configuration
    qvel: Floats  # (n, nv) velocity
    act: Floats  # (n, na) actuator activations at the start
    ctrl: Floats  # (n, nu) control at the start
    # (n, 6 nbody) force [N] and torque [N m] on each body at the start, world frame.
    applied: Floats
    mocap: Floats  # (n, 7 nmocap) positions [m], then quaternions, of mocap bodies at the start
    signals: tuple[Signals, ...]  # (n) the signals that drive each run

    @property
    def driven_inputs(self) -> NDArray[np.intp]:
        """Indices of the inputs that are driven in any of the runs."""
        driven = set(itertools.chain(*[signal.places.tolist() for signal in self.signals]))
        return np.array(sorted(driven), np.intp)

    def select_run(self, run: int) -> "InitialStates":
        """Return the initial state of one run (n is 1)."""
        selected_parts = {name: getattr(self, name)[run : run + 1] for name in STATE_PARTS}
        return self._replace(**selected_parts, signals=(self.signals[run],))

    def select_runs(self, runs: Sequence[int]) -> "InitialStates":
        """Return the initial states of some runs."""
        selected_parts = {name: getattr(self, name)[list(runs)] for name in STATE_PARTS}
        return self._replace(**selected_parts, signals=tuple(self.signals[run] for run in runs))

    def with_recorded_inputs(self, controls: Sequence[RecordedControls]) -> "InitialStates":
        """Return these states with recorded inputs, one for each run, in place of all others."""
        signals: list[Signals] = []
        for recorded, own in zip(controls, self.signals, strict=True):
            times, levels = recorded.knots
            places = np.array(recorded.places or range(self.ctrl.shape[1]), np.intp)
            signals.append(Signals(places, times[None], levels).merge_signals(own))
        return at_begin(self._replace(signals=tuple(signals)))

    def recorded_inputs_until(self, end: float) -> RecordedControls | None:
        """Return the inputs of one run (n is 1) until `end` [s]: its signals and constant controls.

        The signals are held levels, such as those of a task's excitation. The result is None if
        there are no inputs.
        """
        signals = self.signals[0]
        if not (signals.places.size or self.ctrl.any()):
            return None
        places = np.union1d(np.arange(self.ctrl.shape[1]), signals.places)
        within = np.unique(signals.times[(signals.times > 0) & (signals.times < end)])
        times = np.array([0.0, *within, end])
        held_levels = np.concatenate([self.ctrl[0], self.applied[0], self.mocap[0]])[places]
        levels = np.tile(held_levels, (len(times), 1))
        levels[:-1, np.searchsorted(places, signals.places)] = signals.values_at(times[:-1])
        levels[-1] = levels[-2]
        alone = len(places) == self.ctrl.shape[1]
        return RecordedControls(times, levels, () if alone else tuple(places.tolist()))

    @classmethod
    def concatenate(cls, starts: Sequence["InitialStates"]) -> "InitialStates":
        """Return several initial states, one after the other."""
        arrays = {
            name: np.concatenate([getattr(one, name) for one in starts]) for name in STATE_PARTS
        }
        return starts[0]._replace(
            **arrays, signals=tuple(itertools.chain(*[start.signals for start in starts]))
        )

    def input_rows(
        self, run: int, timestep: float, steps: np.ndarray, width: int | None = None
    ) -> Floats:
        """Return (T, nu + 6 nbody + 7 nmocap) the inputs of one run during some steps.

        Step k has the inputs at time k * timestep [s]; k may be fractional. If `width` is set, only
        the first `width` inputs are returned; they must include all driven inputs.
        """
        constant = np.concatenate([self.ctrl[run], self.applied[run], self.mocap[run]])[:width]
        signals = self.signals[run]
        if np.array_equal(signals.places, np.arange(len(constant))):
            return signals.values_at(steps * timestep)
        inputs = np.tile(constant, (len(steps), 1))
        inputs[:, signals.places] = signals.values_at(steps * timestep)
        return inputs

    def control_ranges(self, run: int, end: float) -> Floats:
        """Return (nu, 2) the least and greatest value of each control of a run until `end` [s].

        Levels just before a jump between two steps count, too.
        """
        ranges, signals = np.stack([self.ctrl[run]] * 2, axis=1), self.signals[run]
        own = signals.places < len(ranges)
        if own.any():
            ends = signals.values_at(np.array([0.0, end])).T
            passed = (signals.times >= 0) & (signals.times <= end)
            levels = np.hstack([ends, np.where(passed, signals.levels, ends[:, :1])])[own]
            ranges[signals.places[own]] = np.stack([levels.min(axis=1), levels.max(axis=1)], axis=1)
        return ranges


def apply_inputs(model: mujoco.MjModel, data: mujoco.MjData, inputs: Floats) -> None:
    """Write one row of `InitialStates.inputs` into a state."""
    pushes, poses = model.nu, model.nu + 6 * model.nbody
    data.ctrl[:], data.xfrc_applied.flat[:] = inputs[:pushes], inputs[pushes:poses]
    if model.nmocap:
        turns = poses + 3 * model.nmocap
        data.mocap_pos.flat[:], data.mocap_quat.flat[:] = inputs[poses:turns], inputs[turns:]


# Offset of a joint's quaternion within its part of qpos.
_QUATERNION_OFFSETS = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}


@dataclass(frozen=True)
class InitialStateRule:
    """Rule that makes the initial states of one structure."""

    state: Floats  # one state of `InitialStates` in a row, of a keyframe or of `QPOS0`
    starts: Mapping[str, int]  # the start index of each part
    # Expressions over the initial values, with the indices that each sets.
    formulas: tuple[tuple[Expression, tuple[int, ...]], ...]
    profiles: tuple[ControlProfile, ...]  # the inputs over time
    # Indices that a seed perturbs, with the largest change [m, rad, m/s or rad/s].
    perturbed: Mapping[int, float]
    quaternions: tuple[int, ...]  # start indices of unit quaternions
    # Indices of coordinates and velocities that an axis of their name sets, after the formulas.
    coordinates: Mapping[str, int]
    heights: tuple[int, ...]  # indices of the heights of free bodies, raised by `DROP_HEIGHT`
    recorded: "RecordedRuns | None" = None  # runs that start as recorded
    first_as_written: bool = False  # whether the seed 0 perturbs nothing

    @classmethod
    def from_model(
        cls, model: mujoco.MjModel, manifest: SceneManifest | None, keyframe: str
    ) -> "InitialStateRule":
        """Return the rule for initial states from a keyframe or `QPOS0`.

        A SceneError names coordinates of the manifest that the model lacks.
        """
        data = start_data(model, keyframe)
        own_values = manifest.initial if manifest else {}
        formulas = tuple(
            (
                read_formula(text, f"initial value '{name}' sets {pattern}", own_values),
                tuple(match_coordinates(model, pattern)),
            )
            for name, entry in own_values.items()
            for pattern, text in entry.sets.items()
        )
        poses = np.concatenate([data.mocap_pos.ravel(), data.mocap_quat.ravel()])
        fields = (data.qpos, data.qvel, data.act, data.ctrl, data.xfrc_applied.ravel(), poses)
        return cls(
            state=np.concatenate(fields),
            starts=part_starts(model),
            formulas=formulas,
            profiles=read_control(model, manifest),
            perturbed=_perturbed_coordinates(model, manifest),
            quaternions=quaternion_indices(model),
            coordinates={
                name: index
                for name, index in start_coordinates(model).items()
                if name not in own_values
            },
            heights=() if DROP_HEIGHT in own_values else tuple(free_body_heights(model)),
            first_as_written=manifest is None,
        )

    def start_off_rest(self, model: mujoco.MjModel) -> "InitialStateRule":
        """Return the rule with a perturbation by each seed, so that no run starts exactly at rest.

        A loop that starts in an unstable equilibrium would stay there.
        """
        perturbed = self.perturbed or _perturbed_coordinates(model, None)
        return replace(self, perturbed=perturbed, first_as_written=False)

    @property
    def qpos(self) -> Floats:
        """(nq,) the configuration, before initial values set it."""
        return self.state[: self.starts["qvel"]]

    @property
    def held_ctrl(self) -> Floats | None:
        """(nu,) the keyframe's controls; None if it has none."""
        ctrl = self.state[self.starts["ctrl"] : self.starts["applied"]]
        return ctrl if ctrl.any() else None

    @property
    def driven_inputs(self) -> set[int]:
        """Indices of the controls that the scene itself sets, at the start or over time."""
        first = self.starts["ctrl"]
        places = {place for profile in self.profiles for place in profile.inputs}
        places |= {place - first for _, indices in self.formulas for place in indices}
        return places & set(range(self.starts["applied"] - first))

    def nominal_configuration(self, initial: Mapping[str, float]) -> Floats:
        """Return the (nq,) unperturbed configuration for some initial values."""
        return initial_states(self, [(initial, 0, 0.0)]).qpos[0]


def initial_states(
    rule: InitialStateRule, runs: Sequence[tuple[Mapping[str, float], int, float]]
) -> InitialStates:
    """Return the initial states from each run's initial values, seed, and perturbation factor."""
    states = np.tile(rule.state, (len(runs), 1))
    places, sizes = [*rule.perturbed], np.array([*rule.perturbed.values()])
    formulas = [(formula, list(indices)) for formula, indices in rule.formulas]
    for row, (initial, seed, factor) in zip(states, runs, strict=True):
        if rule.recorded:
            start = rule.recorded.start_state(initial[RECORDED_RUN])
            np.copyto(row[: len(start)], start, where=np.isfinite(start))
        for formula, indices in formulas:
            row[indices] = evaluate_formula(formula, initial)
        for name in initial.keys() & rule.coordinates.keys():
            row[rule.coordinates[name]] = initial[name]
        row[list(rule.heights)] += initial.get(DROP_HEIGHT, 0.0)
        if places and factor and (seed or not rule.first_as_written):
            row[places] += sizes * factor * np.random.default_rng(seed).uniform(-1, 1, len(places))
    # Dividing by a norm of exactly 1 is harmless, but dividing by 1 + 1e-16 would change bits.
    edited = rule.formulas or rule.perturbed or any(initial for initial, _, _ in runs)
    for address in rule.quaternions if edited else ():
        part = states[:, address : address + 4]
        norm = np.linalg.norm(part, axis=1, keepdims=True)
        np.divide(part, norm, out=part, where=np.abs(norm - 1) > ROUNDING)
    signals = tuple(control_signals(rule.profiles, initial) for initial, _, _ in runs)
    if rule.recorded:
        commands = [rule.recorded.command_signals(initial[RECORDED_RUN]) for initial, _, _ in runs]
        signals = tuple(a.merge_signals(b) for a, b in zip(signals, commands, strict=True))
    parts = np.split(states, list(rule.starts.values())[1:], axis=1)
    return at_begin(InitialStates(*parts, signals=signals))


def at_begin(starts: InitialStates) -> InitialStates:
    """Return initial states with driven inputs set to their values at time 0."""
    if not starts.driven_inputs.size:
        return starts
    inputs = np.concatenate([starts.ctrl, starts.applied, starts.mocap], axis=1)
    for row, signals in zip(inputs, starts.signals, strict=True):
        row[signals.places] = signals.values_at(np.zeros(1))[0]
    ends = np.cumsum([starts.ctrl.shape[1], starts.applied.shape[1]])
    parts = zip(("ctrl", "applied", "mocap"), np.split(inputs, ends, axis=1), strict=True)
    return starts._replace(**dict(parts))


def nudged_states(
    rule: InitialStateRule, states: InitialStates, seeds: Sequence[int]
) -> InitialStates:
    """Return initial states up to 1e-6 m or rad away; quaternions are unchanged."""
    turning = {address + part for address in rule.quaternions for part in range(4)}
    moving = [index for index in range(states.qpos.shape[1]) if index not in turning]
    qpos = states.qpos.copy()
    nudge_size = 1e-6  # moves a symmetric start off its symmetry, and no result that is stable
    for row, seed in zip(qpos, seeds, strict=True):
        # Use a separate random stream: the seed's first one perturbs the start itself.
        row[moving] += nudge_size * np.random.default_rng([seed, 1]).uniform(-1, 1, len(moving))
    return states._replace(qpos=qpos)


def perturbed_copy(start: InitialStates, joints: Joints, seed: int) -> InitialStates:
    """Return an initial state up to 1e-8 away in every position and velocity [m, rad, m/s, rad/s].

    Quaternions are unchanged: angular velocities separate them soon enough.
    """
    generator = np.random.default_rng([seed, 2])
    qpos, qvel = start.qpos.copy(), start.qvel.copy()
    places = [*joints.scalars, *(point + axis for point in joints.points for axis in range(3))]
    copy_distance = 1e-8  # from the run at the start [m, rad, m/s, rad/s]
    qpos[:, places] += copy_distance * generator.uniform(-1, 1, len(places))
    qvel += copy_distance * generator.uniform(-1, 1, qvel.shape[1])
    return start._replace(qpos=qpos, qvel=qvel)


def quaternion_indices(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the indices in qpos where a unit quaternion starts."""
    joints = zip(model.jnt_type.tolist(), model.jnt_qposadr.tolist(), strict=True)
    return tuple(
        start + _QUATERNION_OFFSETS[kind] for kind, start in joints if kind in _QUATERNION_OFFSETS
    )


def _perturbed_coordinates(
    model: mujoco.MjModel, manifest: SceneManifest | None
) -> Mapping[int, float]:
    """Return the state indices that a seed perturbs, each with the largest change.

    Without a manifest these are the horizontal position of free bodies, and every slide and hinge.
    Seed 0 perturbs nothing then and starts as the model is written.
    """
    if manifest:
        if (perturb := manifest.perturb) is None:
            return {}
        coordinates = perturb.coordinates
        sizes = coordinates if isinstance(coordinates, dict) else dict.fromkeys(coordinates, 1.0)
        every = [(element, size * perturb.scale) for element, size in sizes.items()]
        return {
            coordinate: size
            for name, size in every
            for coordinate in match_coordinates(model, name)
        }
    joints = zip(model.jnt_type.tolist(), model.jnt_qposadr.tolist(), strict=True)
    # Two coordinates of a free joint, none of a ball joint, and one of another joint.
    counts = {int(mujoco.mjtJoint.mjJNT_FREE): 2, int(mujoco.mjtJoint.mjJNT_BALL): 0}
    places = [start + place for kind, start in joints for place in range(counts.get(kind, 1))]
    perturbation = 1e-4  # [m, rad]: smaller than any measured start, larger than rounding
    return dict.fromkeys(places, perturbation)


def joint_directions(model: mujoco.MjModel, seed: int) -> Floats:
    """Return (nv,) the velocities of joints at unit speed, each in a random direction.

    A hinge turns at 1 rad/s. A ball joint turns at 1 rad/s about a random axis, and so does a free
    body without other joints; a base with joints is at rest. A slide moves as fast as the tip of a
    body of the model's mean size would at 1 rad/s.
    """
    generator = np.random.default_rng([seed, 3])
    velocity = np.zeros(model.nv)
    free_dofs = 6  # of a tree of a single free body
    for kind, dof in zip(model.jnt_type, model.jnt_dofadr, strict=True):
        axis = generator.normal(size=3)
        axis /= np.linalg.norm(axis)
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            alone = model.tree_dofnum[model.dof_treeid[dof]] == free_dofs
            velocity[dof + 3 : dof + 6] = axis * alone
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            velocity[dof : dof + 3] = axis
        else:
            length = model.stat.meansize if kind == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
            velocity[dof] = np.copysign(length, axis[0])
    return velocity
