"""Tests fixes of a grip: changes of the solver, of the pads and of the squeeze."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.budget.counted_time import count_step_seconds, sample_states
from contactlab.budget.motion import Motion
from contactlab.budget.time_ratios import measure_time_ratios
from contactlab.budget.windows import replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.mjcf import OPTIONS
from contactlab.modifications.catalogue import CATALOGUE
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.model_edits import read_option
from contactlab.schema.grip import GripVerdict
from contactlab.schema.time_ratio import TimeRatio
from contactlab.step_progress import count_steps
from contactlab.studies.grip.closing import Closing, Squeeze, close_at, measure_squeeze
from contactlab.studies.grip.fingers import control_ranges
from contactlab.studies.grip.grip_fixture import GripFixture
from contactlab.studies.grip.grip_verdict import MOST_DEPTH, verdict_of
from contactlab.studies.grip.holding import Drift, Load, load_directions, measure_drifts
from contactlab.studies.grip.rollouts import data_at, repeat_input, roll_out, state_row

_LEAST_SQUEEZE = 0.02  # a control squeezes if its full range adds this share of the force


@dataclass(frozen=True)
class Grip:
    """An object in a hand.

    Attributes:
        fixture: hand and object.
        squeeze: the object in closed fingers.
        load: the load on it.
        names: names of the directions out of the hand and back.
        closing: how the hand closes; None for a keyframe.
        close_again: places the object in the hand of another model, as a command on that model
            does; None for a keyframe.
    """

    fixture: GripFixture
    squeeze: Squeeze
    load: Load
    names: tuple[str, str]
    closing: Closing | None
    close_again: Callable[[GripFixture], tuple[Closing, Squeeze]] | None = None

    def directions(self) -> dict[str, Floats]:
        """Return the directions of loads."""
        return load_directions(self.squeeze, self.names)

    @property
    def depth_share(self) -> float:
        """Depth over half of the object's extent from finger to finger."""
        turn = np.empty(9)
        place = self.fixture.address + 3
        mujoco.mju_quat2Mat(turn, self.squeeze.path[-1][place : place + 4])
        half = float(np.abs(turn.reshape(3, 3).T @ self.squeeze.turn[:, 0]) @ self.fixture.half)
        return self.squeeze.depth / half

    def measure_drifts(self) -> tuple[Drift, ...]:
        """Return the drifts in all directions; the first is without a further load."""
        seconds = 2.0  # of a run in each direction
        return measure_drifts(self.fixture, self.squeeze, self.load, self.directions(), seconds)

    def with_model(self, model: mujoco.MjModel) -> "Grip":
        """Return the grip of a changed model: closed again, or continued from the keyframe."""
        fixture = replace(self.fixture, model=model)
        if self.closing is None or self.close_again is None:
            squeeze = self._held_on(fixture, self.squeeze.control)
            return replace(self, fixture=fixture, squeeze=self._frame_squeeze(squeeze))
        closing, squeeze = self.close_again(fixture)
        if squeeze.approach is not None and not np.array_equal(
            squeeze.control, self.squeeze.control
        ):
            squeeze = replace(
                close_at(fixture, closing, squeeze.approach, self.squeeze.control),
                turn=squeeze.turn,
            )
        return replace(self, fixture=fixture, closing=closing, squeeze=squeeze)

    def with_control(self, control: Floats) -> "Grip":
        """Return the grip with another final control."""
        if self.closing is not None and self.squeeze.approach is not None:
            squeeze = close_at(self.fixture, self.closing, self.squeeze.approach, control)
        else:
            squeeze = self._held_on(self.fixture, control)
        return replace(self, squeeze=self._frame_squeeze(squeeze))

    def closed_again(self, control: Floats) -> "Grip":
        """Return the grip closed on the object from the start, with another final control."""
        if self.closing is not None:
            return self.with_control(control)
        data = data_at(self.fixture.model, self.squeeze.row)
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = self.squeeze.path[0], 0, 0
        squeeze = replace(self.squeeze, row=state_row(self.fixture.model, data), control=control)
        grip = replace(self, squeeze=squeeze)
        return replace(grip, squeeze=grip._frame_squeeze(grip._held_on(grip.fixture, control)))

    def _frame_squeeze(self, squeeze: Squeeze) -> Squeeze:
        return replace(squeeze, turn=self.squeeze.turn, sucks=self.squeeze.sucks)

    def _held_on(self, fixture: GripFixture, control: Floats) -> Squeeze:
        """Continue from the keyframe to a control, with a weightless object."""
        adapt_seconds = 0.5  # for a held object to adapt to a change
        steps = max(2, round(adapt_seconds / fixture.model.opt.timestep))
        share = np.minimum(1, np.linspace(0, 2, steps))[:, None]
        controls = self.squeeze.control + share * (control - self.squeeze.control)
        lifted = repeat_input(self.load.load_forces(np.zeros(3)), 1, steps)
        rolled = roll_out(fixture.model, self.squeeze.row[None], controls[None], lifted)
        return measure_squeeze(fixture, rolled.rows[0], control, self.squeeze.turn, rolled.qpos[0])


@dataclass(frozen=True)
class TestedFix:
    """A tested fix.

    Attributes:
        name, against: of the candidate.
        options: changed settings by name.
        drifts: drifts with it.
        deep: depth over half of the object's width.
        time_ratio: its time over that as written; None for a control.
        controls: of a part that is less squeeze; empty if controls are as written.
        cost: counted time over that as written, which ranks fixes; infinite for a control.
    """

    name: str
    against: str
    options: Mapping[str, object]
    drifts: tuple[Drift, ...]
    deep: float
    time_ratio: TimeRatio | None
    controls: tuple[float, ...] = ()
    cost: float = math.inf

    def verdict(self, within: float) -> GripVerdict:
        """Return the verdict with this fix."""
        return verdict_of(self.drifts, within, self.deep)


def run_fixes(grip: Grip, within: float) -> list[TestedFix]:
    """Test and time each fix; combine two only if neither of them holds.

    If the fingers are deep in the object, less squeeze is part of each fix.
    """
    changed, tested_fixes, less = dict[str, mujoco.MjModel](), list[TestedFix](), ""
    controls: tuple[float, ...] = ()
    if grip.depth_share > MOST_DEPTH:
        for eased in _ease_squeeze(grip):
            grip, fix = eased
            tested_fixes.append(fix)
            less, controls = f"{fix.name} and ", fix.controls
            if fix.deep <= MOST_DEPTH:
                break
    model, geoms = grip.fixture.model, grip.squeeze.geoms
    fixes = [fix for entry in CATALOGUE.values() for fix in entry.grip_fixes]
    for candidate in count_steps(fixes, "fixes", len(fixes)):
        if candidate.change is None:
            continue
        name, other = less + candidate.find_name(model), model.__copy__()
        candidate.change(other, geoms)
        settings = changed_settings(model, other, geoms, candidate.fields)
        is_held = any(each.verdict(within) == "holds" for each in tested_fixes)
        if settings and not (candidate.is_both and is_held):
            changed[name] = other
            changed_grip = grip.with_model(other)
            drifts, deep = changed_grip.measure_drifts(), changed_grip.depth_share
            fix = TestedFix(name, candidate.against, settings, drifts, deep, None, controls)
            tested_fixes.append(fix)

    # Time ratios are measured; counted costs are exact, and rank the fixes.
    timed_seconds, window_seconds = 0.4, 0.04
    steps = max(2, round(timed_seconds / model.opt.timestep))
    down = grip.directions()[grip.names[1]]
    forces = grip.load.load_forces(grip.load.gravity * down).ravel()
    inputs = np.tile(np.concatenate([grip.squeeze.control, forces]), (1, steps, 1))
    kinds = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
    motion = Motion(model, grip.squeeze.row[None], inputs, kinds, "held")
    states = sample_states(motion)
    own = count_step_seconds(motion, model, states)
    costs = {
        name: count_step_seconds(motion, other, states) / own for name, other in changed.items()
    }
    timed_models = {name: (lambda other=other: other, 1) for name, other in changed.items()}
    ratios = measure_time_ratios(motion, replay_motion(motion, window_seconds, 1), timed_models)
    tested_fixes = [
        replace(each, time_ratio=ratios.get(each.name), cost=costs.get(each.name, each.cost))
        for each in tested_fixes
    ]
    if not less and (more := double_squeeze(grip)) is not None:
        control, times = more
        changed_grip = grip.with_control(control)
        drifts, deep = changed_grip.measure_drifts(), changed_grip.depth_share
        name = f"{times:.2g} times the squeeze"
        tested_fixes.append(TestedFix(name, "squeeze", {}, drifts, deep, None))
    return tested_fixes


def _ease_squeeze(grip: Grip) -> Iterator[tuple[Grip, TestedFix]]:
    # Each grip is closed again with less squeeze, by controls with digits that a person writes.
    own = sum(grip.closed_again(grip.squeeze.control).squeeze.forces)
    ends = control_ranges(grip.fixture.model)
    opened = (
        grip.closing.open_controls if grip.closing else _squeezing_ends(grip, ends, own, opens=True)
    )
    halvings = 10  # of the way to the opened control, for a share of the squeeze
    low = 0.0
    for share in (0.25, 0.06, 0.015):
        high = 1.0
        for _ in range(halvings):
            middle = (low + high) / 2
            eased_grip = grip.closed_again(
                grip.squeeze.control + middle * (opened - grip.squeeze.control)
            )
            more = sum(eased_grip.squeeze.forces) > share * own
            low, high = (middle, high) if more else (low, middle)
        control = grip.squeeze.control + low * (opened - grip.squeeze.control)
        controls = tuple(float(f"{value:.4g}") for value in control)
        eased_grip = grip.closed_again(np.array(controls))
        force_share, deep = sum(eased_grip.squeeze.forces) / own, eased_grip.depth_share
        name = f"{force_share:.2g} times the squeeze"
        drifts = eased_grip.measure_drifts()
        yield eased_grip, TestedFix(name, "penetration", {}, drifts, deep, None, controls, cost=1.0)


def changed_settings(
    model: mujoco.MjModel, other: mujoco.MjModel, geoms: Sequence[int], fields: Sequence[str]
) -> dict[str, object]:
    """Return the options, and the fields of geoms, that differ between two models."""
    option_values = {name: read_option(other, name) for name in OPTIONS}
    settings = {
        name: value for name, value in option_values.items() if value != read_option(model, name)
    }
    for field in fields:
        for geom in geoms:
            old, new = getattr(model, field)[geom], getattr(other, field)[geom]
            if np.any(old != new):
                name = f"{field}[{model.geom(geom).name}]"
                settings[name] = new.item() if np.ndim(new) == 0 else tuple(map(float, new))
    return settings


def weakest_finger_force(squeeze: Squeeze) -> float:
    """Return the force of the finger that presses least, of those that press [N]."""
    return min((force for force in squeeze.forces if force > 0), default=0.0)


def double_squeeze(grip: Grip) -> tuple[Floats, float] | None:
    """Return a control with twice the squeeze, or the largest possible, and its factor.

    None if the control ranges leave nothing to add.
    """
    ends, control = control_ranges(grip.fixture.model), grip.squeeze.control
    own = sum(grip.squeeze.forces)
    target = grip.closing.closed_controls if grip.closing else _squeezing_ends(grip, ends, own)
    if own <= 0 or np.allclose(
        target, control, rtol=0, atol=SUM_ROUNDING * (1 + np.abs(ends).max())
    ):
        return None
    factor = 2.0
    best, most = control, own
    for share in (0.125, 0.25, 0.5, 1.0):  # of the way to the end of the control ranges
        new_control = control + share * (target - control)
        force = sum(grip.with_control(new_control).squeeze.forces)
        if force > most:
            best, most = new_control, force
        if most >= factor * own:
            break
    return (best, most / own) if most > own * (1 + _LEAST_SQUEEZE) else None


def _squeezing_ends(grip: Grip, ends: Floats, own: float, *, opens: bool = False) -> Floats:
    """Return the ends of control ranges that add to the squeeze, or take from it."""
    target = grip.squeeze.control.copy()
    close = grip.closed_again if opens else grip.with_control
    for control in range(len(target)):
        for end in ends[control]:
            if end == target[control]:
                continue
            # A twentieth of the way shows the sign, and moves little else.
            new_control = grip.squeeze.control.copy()
            new_control[control] += (end - new_control[control]) / 20
            more = (sum(close(new_control).squeeze.forces) - own) * (-1 if opens else 1)
            if 20 * more > _LEAST_SQUEEZE * own:
                target[control] = end
                break
    return target
