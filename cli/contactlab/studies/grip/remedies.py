"""What may hold a grip: changes of how it is computed, of pads and of the squeeze, each run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.budget.motion import Motion
from contactlab.budget.prices import Price, prices
from contactlab.budget.windows import replay
from contactlab.contact.trace_arrays import Floats
from contactlab.mjcf import OPTIONS
from contactlab.scene.model_edits import read_option
from contactlab.studies.grip.bench import Rig
from contactlab.studies.grip.closing import Closing, Squeeze, close_at, pressing
from contactlab.studies.grip.fingers import control_ends
from contactlab.studies.grip.holding import Drift, Load, directions, drifts
from contactlab.studies.grip.judging import word_of
from contactlab.studies.grip.rollouts import constant, roll

_INPUTS = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
_ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
SECONDS = 2.0  # of a run in each direction
_ADAPTS = 0.5  # s, in which a held object takes a change up
_TIMED = 0.4  # s, of a run whose time is taken
_WINDOW = 0.04  # s
_STIFFER, _MORE = 0.5, 2.0
_IMPRATIO, _NOSLIP = 10.0, 3
# A control squeezes if the whole way to an end of its range adds this share of the force.
_SQUEEZES = 0.02
_SHARES = (0.125, 0.25, 0.5, 1.0)


@dataclass(frozen=True)
class Grip:
    """An object in a hand, and how it came there.

    Attributes:
        rig: hand and object.
        held: the object in closed fingers.
        load: what pulls on it.
        names: of the directions out of the hand and back.
        closing: how the hand closes; None where a keyframe has it closed.
    """

    rig: Rig
    held: Squeeze
    load: Load
    names: tuple[str, str]
    closing: Closing | None

    def ways(self) -> dict[str, Floats]:
        """Return the directions of loads."""
        return directions(self.held, self.names)

    def drifts(self) -> tuple[Drift, ...]:
        """Return the drifts in all directions, and first without a further load."""
        return drifts(self.rig, self.held, self.load, self.ways(), SECONDS)

    def with_model(self, model: mujoco.MjModel) -> "Grip":
        """Return the grip that a changed model makes: closed anew, or held on from the keyframe."""
        rig = replace(self.rig, model=model)
        if self.closing is not None and self.held.approach is not None:
            held = close_at(rig, self.closing, self.held.approach, self.held.control)
        else:
            held = self._held_on(rig, self.held.control)
        return replace(self, rig=rig, held=replace(held, turn=self.held.turn))

    def with_control(self, control: Floats) -> "Grip":
        """Return the grip with another control at its end."""
        if self.closing is not None and self.held.approach is not None:
            held = close_at(self.rig, self.closing, self.held.approach, control)
        else:
            held = self._held_on(self.rig, control)
        return replace(self, held=replace(held, turn=self.held.turn))

    def _held_on(self, rig: Rig, control: Floats) -> Squeeze:
        """Go on from the keyframe to a control, the object without weight."""
        steps = max(2, round(_ADAPTS / rig.model.opt.timestep))
        share = np.minimum(1, np.linspace(0, 2, steps))[:, None]
        controls = self.held.control + share * (control - self.held.control)
        lifted = constant(self.load.forces(np.zeros(3)), 1, steps)
        rolled = roll(rig.model, self.held.row[None], controls[None], lifted)
        return pressing(rig, rolled.rows[0], control, self.held.turn, rolled.qpos[0])


@dataclass(frozen=True)
class Candidate:
    """A change of a grip's model.

    Attributes:
        name: as a sentence has it.
        against: what it is an experiment on.
        change: of a copy of the model; the geoms are those of the hand that touch the object.
        fields: of geoms, which it changes.
        is_both: whether it is two others at once.
    """

    name: str
    against: str
    change: Callable[[mujoco.MjModel, Sequence[int]], None]
    fields: tuple[str, ...] = ()
    is_both: bool = False


@dataclass(frozen=True)
class Tried:
    """A change that was run.

    Attributes:
        name, against: of the candidate.
        options: settings that it changes, by name.
        drifts: with it.
        price: its time over that as written; None for a control.
    """

    name: str
    against: str
    options: Mapping[str, object]
    drifts: tuple[Drift, ...]
    price: Price | None


def _elliptic(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    del geoms
    model.opt.impratio = _impratio(model)
    model.opt.cone = _ELLIPTIC


def _impratio(model: mujoco.MjModel) -> float:
    """Return ten times the regularisation's ratio under elliptic cones, or at least ten."""
    own = model.opt.impratio if model.opt.cone == _ELLIPTIC else 1.0
    return max(_IMPRATIO, _IMPRATIO * float(own))


def _noslip(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    del geoms
    model.opt.noslip_iterations = _NOSLIP


def _both(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    _elliptic(model, geoms)
    _noslip(model, geoms)


def _friction(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    model.geom_friction[list(geoms), 0] *= _MORE


def _condim(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    model.geom_condim[list(geoms)] = np.maximum(model.geom_condim[list(geoms)], 4)


def _solref(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    least = 2 * model.opt.timestep
    for geom in geoms:
        if model.geom_solref[geom, 0] > 0:
            model.geom_solref[geom, 0] = max(least, _STIFFER * model.geom_solref[geom, 0])


def candidates(model: mujoco.MjModel) -> tuple[Candidate, ...]:
    """Return the changes to try on a model, the simplest first."""
    elliptic = f"elliptic cones with impratio {_impratio(model):g}"
    return (
        Candidate(elliptic, "regularised", _elliptic),
        Candidate(f"noslip {_NOSLIP}", "regularised", _noslip),
        Candidate(f"{elliptic}, and noslip {_NOSLIP}", "regularised", _both, is_both=True),
        Candidate("stiffer pads (half of solref)", "solref", _solref, ("geom_solref",)),
        Candidate("pads that resist spin (condim 4)", "condim", _condim, ("geom_condim",)),
        Candidate("twice the pads' friction", "friction", _friction, ("geom_friction",)),
    )


def tried_on(grip: Grip, within: float) -> list[Tried]:
    """Run each change that is one, and time it; both of two only where neither of them holds."""
    model, geoms = grip.rig.model, grip.held.geoms
    changed, found = dict[str, mujoco.MjModel](), list[Tried]()
    for candidate in candidates(model):
        other = model.__copy__()
        candidate.change(other, geoms)
        settings = changed_settings(model, other, geoms, candidate.fields)
        held = any(word_of(each.drifts, within) == "holds" for each in found)
        if settings and not (candidate.is_both and held):
            changed[candidate.name] = other
            drifts = grip.with_model(other).drifts()
            found.append(Tried(candidate.name, candidate.against, settings, drifts, None))
    costs = _prices(grip, changed)
    found = [replace(each, price=costs.get(each.name)) for each in found]
    if (more := squeezed_twice(grip)) is not None:
        control, times = more
        drifts = grip.with_control(control).drifts()
        found.append(Tried(f"{times:.2g} times the squeeze", "squeeze", {}, drifts, None))
    return found


def changed_settings(
    model: mujoco.MjModel, other: mujoco.MjModel, geoms: Sequence[int], fields: Sequence[str]
) -> dict[str, object]:
    """Return the options, and the fields of geoms, in which a model differs from another."""
    found = {name: read_option(other, name) for name in OPTIONS}
    settings = {name: value for name, value in found.items() if value != read_option(model, name)}
    for field in fields:
        for geom in geoms:
            old, new = getattr(model, field)[geom], getattr(other, field)[geom]
            if np.any(old != new):
                name = f"{field}[{model.geom(geom).name}]"
                settings[name] = new.item() if np.ndim(new) == 0 else tuple(map(float, new))
    return settings


def _prices(grip: Grip, changed: Mapping[str, mujoco.MjModel]) -> Mapping[str, Price]:
    model = grip.rig.model
    steps = max(2, round(_TIMED / model.opt.timestep))
    down = grip.ways()[grip.names[1]]
    forces = grip.load.forces(grip.load.gravity * down).ravel()
    inputs = np.tile(np.concatenate([grip.held.control, forces]), (1, steps, 1))
    motion = Motion(model, grip.held.row[None], inputs, _INPUTS, "held")
    run = replay(motion, _WINDOW, 1)
    made = {name: (lambda other=other: other, 1) for name, other in changed.items()}
    return prices(motion, run, made)


def least_force(held: Squeeze) -> float:
    """Return what the finger bears that presses least, of those that do [N]."""
    return min((force for force in held.forces if force > 0), default=0.0)


def squeezed_twice(grip: Grip) -> tuple[Floats, float] | None:
    """Return a control that squeezes twice as hard, or as hard as the ranges let it, and how much.

    None if the ranges of control leave nothing to add.
    """
    ends, control = control_ends(grip.rig.model), grip.held.control
    own = sum(grip.held.forces)
    target = grip.closing.closed if grip.closing else _squeezing_ends(grip, ends, own)
    if own <= 0 or np.allclose(target, control, rtol=0, atol=1e-9 * (1 + np.abs(ends).max())):
        return None
    best, most = control, own
    for share in _SHARES:
        tried = control + share * (target - control)
        force = sum(grip.with_control(tried).held.forces)
        if force > most:
            best, most = tried, force
        if most >= _MORE * own:
            break
    return (best, most / own) if most > own * (1 + _SQUEEZES) else None


def _squeezing_ends(grip: Grip, ends: Floats, own: float) -> Floats:
    """Return the controls at those ends of their ranges that add to the squeeze."""
    target = grip.held.control.copy()
    for control in range(len(target)):
        for end in ends[control]:
            if end == target[control]:
                continue
            # A twentieth of the way tells the sign, and moves little else.
            tried = grip.held.control.copy()
            tried[control] += (end - tried[control]) / 20
            more = sum(grip.with_control(tried).held.forces) - own
            if 20 * more > _SQUEEZES * own:
                target[control] = end
                break
    return target
