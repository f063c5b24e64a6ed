"""What became of a motion's energy, and how its error goes with the timestep."""

import math
from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.scene import as_number
from contactlab.store.mcap import StoredTrace
from contactlab.studies.check.checked_model import CheckedModel, CheckRun, CheckRunner
from contactlab.studies.check.free_body_energy import free_body_energy, single_free_bodies
from contactlab.studies.session import Values

_SAMPLE = 0.25
"""When trajectories are compared [s]: before a chaotic motion parts them for other reasons."""

_LEAST = 1e-12
"""Difference [m or rad] below which there is rounding only."""


@dataclass(frozen=True)
class EnergyBudget:
    """The energy of one motion of N steps.

    Attributes:
        seconds: how long it was.
        change: mechanical energy at the end less that at the start [J].
        most: largest distance of the energy from that at the start [J].
        peak: largest kinetic energy [J].
        dampers: what viscous damping of the joints took [J].
    """

    seconds: float
    change: float
    most: float
    peak: float
    dampers: float

    def rate(self, peak: float) -> float:
        """Return the change of energy over a peak kinetic energy [J] and time [1/s]."""
        return self.change / peak / self.seconds

    def unexplained(self, peak: float) -> float:
        """Return the same for the change that the dampers leave unexplained [1/s]."""
        return (self.change + self.dampers) / peak / self.seconds


def energy_budget(
    trace: StoredTrace, damping: Floats, apart: tuple[Floats, Floats]
) -> EnergyBudget:
    """Return the ledger of a trace.

    A damper with coefficient b takes the power b qvel^2; its integral is by the trapezoidal rule,
    whose error goes with the square of the timestep.

    Args:
        trace: a run of at least two steps.
        damping: (nv,) viscous coefficient of each degree of freedom.
        apart: (N + 1,) each, kinetic and potential energy of what is left out [J].
    """
    rows = len(trace.kinetic)
    kinetic = trace.kinetic - apart[0][:rows]
    energy = kinetic + trace.potential - apart[1][:rows]
    power = (trace.qvel[:rows] ** 2) @ damping
    return EnergyBudget(
        seconds=float(trace.time[rows - 1] - trace.time[0]),
        change=float(energy[-1] - energy[0]),
        most=float(np.abs(energy - energy[0]).max()),
        peak=float(kinetic.max()),
        dampers=float(np.trapezoid(power, trace.time[:rows])),
    )


def convergence_order(coarse: StoredTrace, middle: StoredTrace, fine: StoredTrace) -> float:
    """Return p of an error that goes with the timestep to the power p, by Richardson's ratio.

    Args:
        coarse: a run at timestep h.
        middle: the same at h/2.
        fine: the same at h/4.

    Returns:
        ``log2(|q(h) - q(h/2)| / |q(h/2) - q(h/4)|)`` with the largest difference of a coordinate
        a quarter of a second after the start; NaN where there is no difference but rounding.
    """
    step = max(1, round(_SAMPLE / float(coarse.time[1] - coarse.time[0])))
    step = min(step, len(coarse.qpos) - 1)
    first = _largest_difference(coarse.qpos[step], middle.qpos[2 * step])
    second = _largest_difference(middle.qpos[2 * step], fine.qpos[4 * step])
    if not min(first, second) > _LEAST:
        return math.nan
    return math.log2(first / second)


def _largest_difference(some: Floats, others: Floats) -> float:
    return float(np.abs(some - others).max())


SECONDS = 5.0
BEST = "RK4"
"""The integrator of highest order."""

_OFF = ("contact", "limit", "frictionloss", "equality", "actuation", "damper")
_MEDIUM = ("density", "viscosity")
_SHARES = (1.0, 0.5, 0.25)
_TIMEOUT = 300.0


@dataclass(frozen=True)
class FreeMotion:
    """One free motion of the model.

    Attributes:
        tried: its run.
        integrator: the integrator.
        timestep: length of a step [s].
        damped: whether the model's own damping was on.
        ledger: what became of its energy, without that of bodies that only fall beside a
            mechanism; None if it was not simulated to its end.
    """

    tried: CheckRun
    integrator: str
    timestep: float
    damped: bool
    ledger: EnergyBudget | None

    @property
    def drift(self) -> float:
        """Size of the change of energy over peak kinetic energy and time [1/s]."""
        return abs(self.ledger.rate(self.ledger.peak)) if self.ledger else math.inf

    @property
    def name(self) -> str:
        """The integrator and the timestep, in words."""
        return f"{self.integrator} at {self.timestep * 1e3:g} ms"


def why_not_applicable(checked: CheckedModel) -> str:
    """Say why the energy of a model's free motion says nothing; empty if it does."""
    model = checked.base.model
    if not model.nv:
        return "the model has nothing that moves"
    if model.nplugin:
        return "plugins act on the model, and their work is not known"
    if np.any(checked.start.applied):
        return "the scene pushes its bodies with forces from outside, which do work"
    if any(not model.body(index).name for index in np.flatnonzero(model.body_gravcomp)):
        return "gravity is compensated for bodies without a name, which cannot be switched off"
    return ""


def free_motions(runner: CheckRunner, store: str) -> list[FreeMotion]:
    """Run the model's free motion with its own integrator and the best, by timestep.

    The first is at the model's own settings; the last, if the model has any damping, with that on.
    """
    checked = runner.checked
    own, timestep = str(checked.setting("integrator")), checked.resolved.timestep
    rows: list[Values] = [
        {**_still(checked), "integrator": integrator, "timestep": timestep * share}
        for integrator in dict.fromkeys((own, BEST))
        for share in _SHARES
        if share == 1 or checked.fits(timestep * share, SECONDS)
    ]
    undamped = len(rows)
    if is_damped(checked):
        rows.append({**_without(checked, _MEDIUM, "damper"), "integrator": own})
    runs = runner.run(
        store,
        "Free motion: contacts, limits and all that gives or takes energy are off",
        rows,
        duration=SECONDS,
        checks="none",
        timeout=_TIMEOUT,
    )
    return [_motion(checked, each, damped=row >= undamped) for row, each in enumerate(runs)]


def is_damped(checked: CheckedModel) -> bool:
    """Say whether the model's own joints, tendons or medium take energy."""
    model = checked.prepared.model
    fluid = any(checked.setting(name) for name in _MEDIUM)
    viscous = model.dof_damping.any() or model.tendon_damping.any()
    return bool(fluid or (viscous and checked.resolved.flags["damper"]))


def is_accounted(checked: CheckedModel) -> bool:
    """Say whether all that damps is linear in the speed of a joint, so that its work is known."""
    model = checked.prepared.model
    curved = getattr(model, "dof_dampingpoly", np.zeros(1))
    fluid = any(checked.setting(name) for name in _MEDIUM)
    return not (fluid or model.tendon_damping.any() or np.any(curved))


def _motion(checked: CheckedModel, tried: CheckRun, *, damped: bool) -> FreeMotion:
    settings = tried.record.settings
    damping = np.array(checked.prepared.model.dof_damping, dtype=np.float64) * damped
    return FreeMotion(
        tried=tried,
        integrator=str(settings["integrator"]),
        timestep=as_number(settings["timestep"]),
        damped=damped,
        ledger=energy_budget(tried.trace, damping, _apart(checked, tried)) if tried.whole else None,
    )


def free_flying_bodies(checked: CheckedModel) -> tuple[int, ...]:
    """Return the bodies that fly by themselves beside a mechanism; none if there is no other."""
    model = checked.prepared.model
    loose = single_free_bodies(model)
    return loose if model.nv > 6 * len(loose) else ()


def _apart(checked: CheckedModel, tried: CheckRun) -> tuple[Floats, Floats]:
    trace = tried.trace
    return free_body_energy(
        checked.prepared.model, free_flying_bodies(checked), trace.qpos, trace.qvel
    )


def _still(checked: CheckedModel) -> dict[str, object]:
    """Return the switches and settings that leave gravity, springs and inertia alone."""
    model = checked.base.model
    values: dict[str, object] = dict.fromkeys(_OFF, False)
    values |= {name: 0.0 for name in _MEDIUM if checked.setting(name)}
    compensated = np.flatnonzero(model.body_gravcomp)
    return values | {f"body_gravcomp[{model.body(index).name}]": 0.0 for index in compensated}


def _without(checked: CheckedModel, medium: tuple[str, ...], switch: str) -> dict[str, object]:
    return {name: value for name, value in _still(checked).items() if name not in {*medium, switch}}
