"""The energy that soft constraints store, which is not in MuJoCo's `energy`."""

import copy
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION
from contactlab.contact.contact_laws import impedance_at, restitution_from_damping
from contactlab.contact.trace_arrays import Floats

_EVEN, _TWICE = np.polynomial.legendre.leggauss(8)
# Points and weights of the integral over shares of a violation, from none to all of it.
_SHARES, _WEIGHTS = (_EVEN[:, None] + 1) / 2, _TWICE / 2
_WARM_START = int(mujoco.mjtState.mjSTATE_WARMSTART)
_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
_LIMIT_JOINT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_LIMIT_TENDON = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)
_BY_DISTANCE = [int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)]
_ALONE = sum(
    int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0)) for name in ("WARMSTART", "ISLAND")
)


class _ViolatedRows(NamedTuple):
    """K rows of constraints that are violated in a state, at rest."""

    violations: Floats  # (K,) [m or rad]
    springs: Floats  # (K,) forces that owe to violations alone [N or N m]
    loads: Floats  # (K,) forces that owe to the load
    powers: Floats  # (K,) of both [W]
    shapes: Floats  # (K, 2) stiffness and damping
    depths: Floats  # (K,) that give their impedances
    solimp: Floats  # (K, 5)


class ConstraintEnergy:
    """Computes the energy that contacts, limits and equalities would give back to motion.

    It is the work of the part of their forces that depends on positions, along a violation that
    shrinks to none, times their restitution. The velocities of semi-implicit steps lag by half a
    step, so the work of all forces with a potential in half a step is added:
    docs/theory/error-budget.md.
    """

    def __init__(self, model: mujoco.MjModel, *, constraints: bool = True) -> None:
        """Take a model with a converged solver; refsafe is as at its step."""
        self._model, self._constraints = copy.copy(model), constraints
        self._model.opt.disableflags |= _ALONE
        self._data = mujoco.MjData(self._model)
        self._solimp = {
            _EQUALITY: self._model.eq_solimp,
            _LIMIT_JOINT: self._model.jnt_solimp,
            _LIMIT_TENDON: self._model.tendon_solimp_lim,
        }
        self._by_distance = np.isin(self._model.eq_type, _BY_DISTANCE)
        self._lags = model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4

    def __call__(self, states: Floats) -> Floats:
        """Return (...) energies [J] of states (..., nstate) of mjSTATE_INTEGRATION."""
        return self.after_steps(states, [self._model.opt.timestep])[0]

    def after_steps(self, states: Floats, timesteps: Sequence[float]) -> Floats:
        """Return (T, ...) energies [J] of states that steps of these T lengths [s] led to.

        States that differ in time or in warm starts only are evaluated once.
        """
        rows, lags = states.reshape(-1, states.shape[-1]), [step / 2 for step in timesteps]
        keys, model = rows.copy(), self._model
        keys[:, :1] = 0
        first = mujoco.mj_stateSize(model, (_WARM_START - 1) & INTEGRATION)
        keys[:, first : first + mujoco.mj_stateSize(model, _WARM_START)] = 0
        numbers, places = dict[bytes, int](), np.full(len(rows), -1)
        powers, counts, violations = list[float](), list[int](), list[_ViolatedRows]()
        with np.errstate(invalid="ignore", over="ignore"):
            for place in np.flatnonzero(np.isfinite(rows).all(axis=1)):
                number = places[place] = numbers.setdefault(keys[place].tobytes(), len(numbers))
                if number < len(powers):
                    continue
                power, violated = self._evaluate_state(rows[place])
                powers.append(power)
                counts.append(0 if violated is None else len(violated.violations))
                if violated is not None:
                    violations.append(violated)
            energies = np.outer(np.array(lags) * self._lags, [*powers, np.nan])
            if violations:
                of = np.repeat(np.arange(len(powers)), counts)
                returned_work = self._given_back(violations, lags)
                energies += [np.bincount(of, work, len(powers) + 1) for work in returned_work]
        # States that are not finite take the last energy, which is NaN.
        return energies[:, places].reshape(-1, *states.shape[:-1])

    def _evaluate_state(self, state: Floats) -> tuple[float, _ViolatedRows | None]:
        """Return the power of gravity and springs [W], and which constraints are violated."""
        model, data = self._model, self._data
        mujoco.mj_setState(model, data, state, INTEGRATION)
        velocity = data.qvel.copy()
        data.qvel[:] = 0
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        power = float((data.qfrc_spring - data.qfrc_bias) @ velocity)
        violations = data.efc_pos - data.efc_margin
        rows = violations.nonzero()[0]
        if not (rows.size and self._constraints):
            return power, None
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        forces = data.efc_force[rows]
        mujoco.mj_mulJacVec(model, data, data.efc_vel, velocity)
        powers = forces * data.efc_vel[rows]
        data.qfrc_smooth[:] = data.qacc_smooth[:] = 0
        mujoco.mj_fwdConstraint(model, data)
        springs = data.efc_force[rows]
        violations = violations[rows]
        softness = self._gather_softness(violations, rows)
        shape = data.efc_KBIP[rows, :2]
        return power, _ViolatedRows(violations, springs, forces - springs, powers, shape, *softness)

    def _gather_softness(self, violations: Floats, rows: np.ndarray) -> tuple[Floats, Floats]:
        """Return (K,) depths and (K, 5) solimp that give rows of constraints their impedances."""
        model, data = self._model, self._data
        kinds, numbers = data.efc_type[rows], data.efc_id[rows]
        depths, solimp = np.abs(violations), np.empty((len(rows), 5))
        for kind in set(kinds.tolist()):
            here = kinds == kind
            of_all = self._solimp.get(kind)
            solimp[here] = (data.contact.solimp if of_all is None else of_all)[numbers[here]]
        if not model.neq:
            return depths, solimp
        # MuJoCo takes the distance of a whole connect or weld for the depth of each of its rows.
        here = (kinds == _EQUALITY).nonzero()[0]
        here = here[self._by_distance[numbers[here]]]
        if here.size:
            squares = np.bincount(numbers[here], violations[here] ** 2)
            depths[here] = np.sqrt(squares[numbers[here]])
        return depths, solimp

    def _given_back(
        self, violated_rows: list[_ViolatedRows], lags: Sequence[float]
    ) -> Iterator[Floats]:
        """Yield (K,) work of the forces along violations that shrink in proportion [J]."""
        violations, springs, loads, powers, shapes, depths, solimp = map(
            np.concatenate, zip(*violated_rows, strict=True)
        )
        stiffness, damping = shapes.T
        zetas = damping / (2 * np.sqrt(np.maximum(stiffness, np.finfo(float).tiny)))
        rise = impedance_at(_SHARES * depths, solimp) / impedance_at(depths, solimp)
        forces = springs * (_WEIGHTS @ (_SHARES * rise**2)) + loads * (_WEIGHTS @ rise)
        restitution = restitution_from_damping(zetas)
        for lag in lags:
            yield restitution * (lag * self._lags * powers - violations * forces)
