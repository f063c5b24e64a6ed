"""Hold a posture: the controls that balance it, and springs where actuators have no feedback.

The force of actuator i is u_i g_i + b_i, where g_i and b_i follow from two evaluations at rest. The
forces f that balance gravity and springs solve, by least squares within the actuators' limits,

    moment^T f = qfrc_bias - qfrc_passive

on the degrees of freedom that actuators move. An actuator without position feedback would only
balance there, stable or not, so a spring and a damper along its own length l are written into the
model: b_i grows by -k l - d dl/dt, and its control by k l_0 / g_i. With M the inertia matrix, K and
D the springs and dampers in joint space, and h the model's timestep, k and d are those of a
critically damped oscillator of the inertia that the actuator moves, and stiffer by what damped
joints take. But with M grown by h times their damping, as implicit integration has it,

    h^2 eig(M^-1 K) <= 0.1    and    h eig(M^-1 D) <= 0.25

so that a spring stays well inside of what an explicit step carries (4 and 2).

What stands on the ground bears more than gravity and springs: the ground pushes back. So a robot
whose root no actuator moves settles first, in a simulation of its own: the forces that its
actuators then exert balance there, and take the place of those above.
"""

import copy
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats

# Natural frequency of the springs [rad/s]: a few hertz; higher where legs carry a body.
_FREQUENCY = 2 * np.pi * 4
_CARRYING = 2 * np.pi * 12
_SPRING_LIMIT, _DAMPER_LIMIT = 0.1, 0.25
# A robot has settled below these speeds [rad/s, m/s]; it is looked at so often, and so long [s].
_STILL, _LOOK, _LONGEST = 0.02, 0.05, 1.0
_MOST_STEPS = 2000
# How often it settles at most, and how near to its posture is near enough [rad or m].
_ROUNDS, _NEAR = 4, 0.01
# How long a robot has for falling over [s], and the cosine of the tilt by which it has.
_FALL, _OVER = 4.0, np.cos(np.pi / 4)
_BEYOND = 1e-3  # how far beyond a limit a start is said to be [rad or m]

_SCALARS = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_FREE = mujoco.mjtJoint.mjJNT_FREE
_MUSCLE = int(mujoco.mjtDyn.mjDYN_MUSCLE)
_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)
_NO_BIAS, _AFFINE = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
_TRN = mujoco.mjtTrn
_LENGTHS = _TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT, _TRN.mjTRN_SLIDERCRANK, _TRN.mjTRN_TENDON


@dataclass(frozen=True)
class Servos:
    """Springs and dampers along the lengths of S actuators, written into models."""

    actuators: NDArray[np.intp]  # (S,)
    stiffness: Floats  # (S,) force by length
    damping: Floats  # (S,) force by rate of length, added to the actuator's own
    forces: Floats  # (S, 2) what they may exert, as their range of controls allows

    @classmethod
    def of_model(
        cls, model: mujoco.MjModel, actuators: NDArray[np.intp], stiffness: Floats, damping: Floats
    ) -> "Servos":
        """Return springs of some actuators, whose forces a model limits."""
        gain, bias = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 0]
        limits = np.stack(_force_limits(model, gain, bias), axis=1)
        return cls(actuators, stiffness, damping, limits[actuators])

    def of(self, actuators: NDArray[np.intp]) -> "Servos":
        """Return those of some actuators."""
        kept = np.isin(self.actuators, actuators)
        gains = self.stiffness[kept], self.damping[kept]
        return Servos(self.actuators[kept], *gains, self.forces[kept])

    def write(self, model: mujoco.MjModel) -> None:
        """Write them into a model, in place."""
        chosen = self.actuators
        model.actuator_biastype[chosen] = _AFFINE
        model.actuator_biasprm[chosen, 1] -= self.stiffness
        model.actuator_biasprm[chosen, 2] -= self.damping
        # The control now carries the posture too; its limits are those of the force.
        model.actuator_ctrllimited[chosen] = 0
        model.actuator_actlimited[chosen] = 0
        limited = np.isfinite(self.forces).all(axis=1)
        model.actuator_forcelimited[chosen[limited]] = 1
        model.actuator_forcerange[chosen[limited]] = self.forces[limited]


@dataclass(frozen=True)
class Posture:
    """What holds one configuration."""

    qpos: Floats  # (nq,) the configuration
    lengths: Floats  # (nu,) of the actuators
    rates: Floats  # (nu,) of lengths with the joint that each depends on most
    forces: Floats  # (nu,) of the actuators
    gain: Floats  # (nu,) how forces change with their inputs
    inputs: Floats  # (nu,) what forces follow: activations where there are any, else controls
    ctrl: Floats  # (nu,)
    act: Floats  # (na,)
    strained: NDArray[np.bool_]  # (nu,) whether forces are at their limits and too small


class Support(NamedTuple):
    """How a robot stands: (nu,) forces for it beside gravity's, and how long it settles [s]."""

    forces: Floats
    settling: float


def find_servos(model: mujoco.MjModel, qpos: Floats) -> Servos:
    """Return springs for the actuators without position feedback, by the inertia at qpos (nq,)."""
    data = _at(model, qpos)
    moment, inertia = _moment(model, data), np.zeros((model.nv, model.nv))
    for column, unit in zip(inertia, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    # Those that get a spring have a fixed gain, and no bias at rest but a constant one.
    moving = np.abs(moment).max(axis=1, initial=0) > 0
    moving &= model.actuator_gainprm[:, 0] != 0
    chosen = np.flatnonzero(moving & _without_feedback(model))
    rows = moment[chosen]
    # Inertia and damping of the motion that the actuator's own joints make, along its length.
    along = rows / np.square(rows).sum(axis=1, keepdims=True)
    masses = np.einsum("ij,jk,ik->i", along, inertia, along)
    dampers = np.square(along) @ model.dof_damping
    frequency = _CARRYING if _carried(model, moment).size else _FREQUENCY
    # A model may leave its timestep to the sweep.
    step = float(model.opt.timestep) or 1e-9
    # MuJoCo integrates the damping of joints implicitly, as if it were inertia.
    carried = _bearable(inertia + step * np.diag(model.dof_damping), rows)
    wanted = frequency * (frequency * masses + dampers)
    stiffness = np.minimum(wanted, _SPRING_LIMIT / step**2 * carried)
    damping = np.minimum(2 * np.sqrt(stiffness * masses), _DAMPER_LIMIT / step * carried)
    damping = np.maximum(damping + model.actuator_biasprm[chosen, 2], 0.0)
    return Servos.of_model(model, chosen, stiffness, damping)


def hold_posture(
    model: mujoco.MjModel, servos: Servos, qpos: Floats, ctrl: Floats, support: Floats | float = 0.0
) -> Posture:
    """Return what holds qpos (nq,), or the next configuration within limits, of a model as written.

    Actuators with feedback keep their ctrl (nu,), but where it is NaN. The support (nu,) is forces
    beside those that balance gravity and springs.
    """
    qpos, limited = qpos.copy(), np.asarray(model.jnt_limited).astype(bool)
    scalar = np.flatnonzero(limited & np.isin(model.jnt_type, _SCALARS))
    places = np.asarray(model.jnt_qposadr)[scalar]
    qpos[places] = np.clip(qpos[places], *np.asarray(model.jnt_range)[scalar].T)
    data = _at(model, qpos)
    gain, bias = _force_law(model, qpos)
    moment = _moment(model, data)
    moved = np.abs(moment).max(axis=0, initial=0) > 0
    wanted = np.asarray(data.qfrc_bias - data.qfrc_passive)[moved]
    low, high = _force_limits(model, gain, bias)
    force = _bounded(moment.T[moved], wanted, low, high)
    missing = np.abs(moment.T[moved] @ force - wanted) > 1e-6 * np.abs(wanted).max(initial=0)
    strained = ((force <= low) | (force >= high)) & moment[:, moved][:, missing].any(axis=1)
    force = np.clip(force + support, low, high)
    usable = np.where(gain == 0, np.inf, gain)
    inputs = (force - bias) / usable
    kept = np.isfinite(ctrl)
    kept[servos.actuators] = False
    inputs[kept] = ctrl[kept]
    lengths, chosen = np.array(data.actuator_length), servos.actuators
    inputs[chosen] += servos.stiffness * lengths[chosen] / gain[chosen]
    rates = np.abs(moment).max(axis=1, initial=0)
    states = _with_states(model, inputs)
    return Posture(qpos, lengths, rates, force, gain, inputs, *states, strained)


def find_support(model: mujoco.MjModel, servos: Servos, qpos: Floats, ctrl: Floats) -> Support:
    """Return how a robot stands that starts at qpos (nq,); see `hold_posture` for the rest.

    Each round settles with what actuators exerted at the end of the last one, as long as that
    brings their lengths closer.
    """
    found, least = Support(np.zeros(model.nu), 0.0), np.inf
    if not _carried(model, _moment(model, _at(model, qpos))).size:
        return found
    held, support = copy.copy(model), found.forces
    servos.write(held)
    held.opt.timestep = held.opt.timestep or 2e-3
    for _ in range(_ROUNDS):
        posture = hold_posture(model, servos, qpos, ctrl, support)
        lengths, forces, settling = _settled(held, posture, qpos)
        ways = np.abs(lengths - posture.lengths) / np.maximum(posture.rates, 1e-9)
        if not ways.max(initial=0.0) < least:
            break
        least, found = ways.max(initial=0.0), Support(support, settling)
        if least < _NEAR:
            break
        support = support + forces - posture.forces
    return found


def _settled(model: mujoco.MjModel, posture: Posture, qpos: Floats) -> tuple[Floats, Floats, float]:
    """Return (nu,) lengths and forces of actuators at rest, and when [s]; NaN if it diverges.

    What still moves after a while has those of the second half of that while, on average.
    """
    data, looks = mujoco.MjData(model), list[tuple[Floats, Floats]]()
    data.qpos[:], data.ctrl[:], data.act[:] = qpos, posture.ctrl, posture.act
    steps = max(1, round(_LOOK / model.opt.timestep))
    while data.time < min(_LONGEST, _MOST_STEPS * model.opt.timestep):
        with suppress(mujoco.FatalError):
            mujoco.mj_step(model, data, nstep=steps)
        if data.warning.number.any() or not data.time > len(looks) * steps * model.opt.timestep:
            return np.full(model.nu, np.nan), np.full(model.nu, np.nan), _LONGEST
        looks.append((data.actuator_length.copy(), data.actuator_force.copy()))
        if np.abs(data.qvel).max(initial=0.0) < _STILL:
            return *looks[-1], float(data.time)
    return *np.mean(looks[len(looks) // 2 :], axis=0), _LONGEST


def unheld(model: mujoco.MjModel, servos: Servos, qpos: Floats, posture: Posture) -> str:
    """Return what a posture does not hold of a model that starts at qpos (nq,); free bodies aside.

    Empty if it holds all.
    """
    moment = _moment(model, _at(model, posture.qpos))
    moved = np.abs(moment).max(axis=0, initial=0) > 0
    jointed = np.flatnonzero(np.asarray(model.jnt_type) != int(_FREE))
    muscles = np.asarray(model.actuator_biastype) == int(mujoco.mjtBias.mjBIAS_MUSCLE)
    beyond = np.abs(posture.qpos - qpos)[model.jnt_qposadr]
    parts = (
        ("no actuator moves", model.joint, np.setdiff1d(jointed, model.dof_jntid[moved])),
        ("without feedback:", model.actuator, np.flatnonzero(muscles)),
        ("too weak at the start:", model.actuator, np.flatnonzero(posture.strained)),
        ("fixed to a mocap body:", model.body, _fixed_to_mocap(model)),
        (
            f"up to {beyond.max(initial=0):.2g} beyond their limits at the start:",
            model.joint,
            np.flatnonzero(beyond > _BEYOND),
        ),
        (
            "falls over, since actuators hold joints only:",
            model.body,
            _fallen(model, servos, qpos, posture),
        ),
    )
    said: list[str] = []
    for what, element, ids in parts:
        names = [str(element(each).name) for each in ids.tolist()]
        more = [f"{len(names) - 4} more"] if len(names) > 4 else []
        said += [f"{what} {', '.join(names[:4] + more)}"] if names else []
    return "; ".join(said)


def _fallen(
    model: mujoco.MjModel, servos: Servos, qpos: Floats, posture: Posture
) -> NDArray[np.int32]:
    """Return the free bodies of robots that turn over though their joints are held."""
    data = _at(model, qpos)
    roots = np.unique(model.body_rootid[_carried(model, _moment(model, data))])
    free = np.asarray(model.jnt_type)[model.body_jntadr[roots]] == int(_FREE)
    roots = roots[free & (model.body_jntnum[roots] > 0)]
    held = copy.copy(model)
    servos.write(held)
    data.ctrl[:], data.act[:] = posture.ctrl, posture.act
    # What is upwards, in the frames of bodies.
    upwards = data.xmat[roots, 6:].copy()
    if roots.size:
        step = held.opt.timestep = held.opt.timestep or 2e-3
        with suppress(mujoco.FatalError):
            mujoco.mj_step(held, data, nstep=min(2 * _MOST_STEPS, round(_FALL / step)))
    return roots[np.sum(upwards * data.xmat[roots, 6:], axis=1) < _OVER]


def _fixed_to_mocap(model: mujoco.MjModel) -> NDArray[np.int32]:
    """Return the bodies that a weld or connection fixes to a mocap body."""
    kinds = int(mujoco.mjtEq.mjEQ_WELD), int(mujoco.mjtEq.mjEQ_CONNECT)
    chosen = np.isin(model.eq_type, kinds) & np.asarray(model.eq_active0).astype(bool)
    sides = np.stack([model.eq_obj1id, model.eq_obj2id], axis=1)[chosen]
    sites = np.asarray(model.eq_objtype)[chosen] == int(mujoco.mjtObj.mjOBJ_SITE)
    if sites.any():
        sides[sites] = np.asarray(model.site_bodyid)[sides[sites]]
    moved = np.asarray(model.body_mocapid)[sides] >= 0
    return np.unique(sides[~moved & moved.any(axis=1, keepdims=True)])


def _moment(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return (nu, nv) how the lengths of actuators change with joints."""
    moment = np.zeros((model.nu, model.nv))
    rows = data.moment_rownnz, data.moment_rowadr
    values, columns = data.actuator_moment.ravel(), data.moment_colind.ravel()
    mujoco.mju_sparse2dense(moment, values, *rows, columns)
    return moment


def _without_feedback(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return which actuators have a length, and a force that does not depend on it."""
    kind, bias = np.asarray(model.actuator_biastype), model.actuator_biasprm[:, 1]
    plain = (kind == _NO_BIAS) | ((kind == _AFFINE) & (bias == 0))
    along = np.isin(model.actuator_trntype, [int(each) for each in _LENGTHS])
    return plain & along & (np.asarray(model.actuator_gaintype) == _FIXED)


def _force_law(model: mujoco.MjModel, qpos: Floats) -> tuple[Floats, Floats]:
    """Return (nu,) gain and bias of the force of actuators at rest, over their input."""
    free = copy.copy(model)
    free.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    free.actuator_forcelimited[:] = 0
    data = mujoco.MjData(free)
    forces: list[Floats] = []
    for level in (0.0, 1.0):
        data.qpos[:] = qpos
        data.ctrl[:], data.act[:] = _with_states(free, np.full(model.nu, level))
        mujoco.mj_forward(free, data)
        forces.append(np.array(data.actuator_force))
    return forces[1] - forces[0], forces[0]


def _with_states(model: mujoco.MjModel, inputs: Floats) -> tuple[Floats, Floats]:
    """Return controls and activations that stay, such that the inputs of forces are as given."""
    ctrl, act = inputs.copy(), np.zeros(model.na)
    for actuator in np.flatnonzero(np.asarray(model.actuator_actnum) == 1):
        act[model.actuator_actadr[actuator]] = inputs[actuator]
    ctrl[is_integrated(model)] = 0.0
    return ctrl, act


def is_integrated(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return (nu,) whether the controls of actuators are rates of their activations."""
    return np.asarray(model.actuator_dyntype) == int(mujoco.mjtDyn.mjDYN_INTEGRATOR)


def _force_limits(model: mujoco.MjModel, gain: Floats, bias: Floats) -> tuple[Floats, Floats]:
    """Return (nu,) least and largest force that ranges of control, activation and force allow."""
    low, high = np.full(model.nu, -np.inf), np.full(model.nu, np.inf)
    ranges = (
        (model.actuator_ctrllimited.astype(bool) & ~is_integrated(model), model.actuator_ctrlrange),
        (model.actuator_actlimited.astype(bool), model.actuator_actrange),
        (np.asarray(model.actuator_dyntype) == _MUSCLE, np.tile([0.0, 1.0], (model.nu, 1))),
    )
    for limited, bounds in ranges:
        ends = np.sort(gain[:, None] * bounds, axis=1) + bias[:, None]
        low = np.where(limited, np.maximum(low, ends[:, 0]), low)
        high = np.where(limited, np.minimum(high, ends[:, 1]), high)
    limited, bounds = model.actuator_forcelimited.astype(bool), model.actuator_forcerange
    low = np.where(limited, np.clip(low, bounds[:, 0], bounds[:, 1]), low)
    high = np.where(limited, np.clip(high, bounds[:, 0], bounds[:, 1]), high)
    fixed = gain == 0
    return np.where(fixed, bias, low), np.where(fixed, bias, high)


def _bounded(matrix: Floats, wanted: Floats, low: Floats, high: Floats) -> Floats:
    """Return x of least |matrix x - wanted|; those beyond their bounds are fixed there in turn.

    Of several such x, nearly the shortest one.
    """
    found = np.clip(np.zeros(len(low)), low, high)
    free = low < high
    while free.any():
        rest = wanted - matrix[:, ~free] @ found[~free]
        found[free] = np.linalg.lstsq(matrix[:, free], rest, rcond=1e-9)[0]
        outside = free & ((found < low) | (found > high))
        if not outside.any():
            break
        found = np.clip(found, low, high)
        free &= ~outside
    return found


def _at(model: mujoco.MjModel, qpos: Floats) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


def _carried(model: mujoco.MjModel, moment: Floats) -> NDArray[np.int32]:
    """Return the bodies of joints that no actuator moves but that carry some which one does."""
    moved = np.abs(moment).max(axis=0, initial=0) > 0
    above = np.asarray(model.dof_parentid)[moved]
    above = above[above >= 0]
    return np.asarray(model.dof_bodyid)[above[~moved[above]]]


def _bearable(inertia: Floats, rows: Floats) -> Floats:
    """Return coefficients c such that no rate of M^-1 rows^T c rows exceeds 1.

    Its rates are those of c G, with G = rows M^-1 rows^T, and by Gershgorin's theorem at most the
    largest sum of a row of |c G|, in any units of the lengths; here in those in which G has ones on
    its diagonal.
    """
    compliance = np.abs(rows @ np.linalg.solve(inertia, rows.T))
    units = np.sqrt(np.diagonal(compliance))
    return 1 / np.maximum((compliance / units).sum(axis=1) * units, np.finfo(float).tiny)
