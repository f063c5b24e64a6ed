"""The free motions of a model: nothing acts but gravity, springs and inertia."""

import math
from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.engines import loose_bodies, loose_energy
from contactlab.studies.check.bench import Bench, Tried, Values
from contactlab.studies.check.ledger import Ledger, ledger_of
from contactlab.studies.check.target import Target

SECONDS = 5.0
BEST = "RK4"
"""The integrator of highest order."""

_OFF = ("contact", "limit", "frictionloss", "equality", "actuation", "damper")
_MEDIUM = ("density", "viscosity")
_SHARES = (1.0, 0.5, 0.25)
_TIMEOUT = 300.0


@dataclass(frozen=True)
class Motion:
    """One free motion of the model.

    Attributes:
        tried: its run.
        integrator: the integrator.
        timestep: length of a step [s].
        damped: whether the model's own damping was on.
        ledger: what became of its energy, without that of bodies that only fall beside a
            mechanism; None if it was not simulated to its end.
    """

    tried: Tried
    integrator: str
    timestep: float
    damped: bool
    ledger: Ledger | None

    @property
    def drift(self) -> float:
        """Size of the change of energy over peak kinetic energy and time [1/s]."""
        return abs(self.ledger.rate(self.ledger.peak)) if self.ledger else math.inf

    @property
    def name(self) -> str:
        """The integrator and the timestep, in words."""
        return f"{self.integrator} at {self.timestep * 1e3:g} ms"


def hindrance(target: Target) -> str:
    """Say why the energy of a model's free motion says nothing; empty if it does."""
    model = target.base.model
    if not model.nv:
        return "the model has nothing that moves"
    if model.nplugin:
        return "plugins act on the model, and their work is not known"
    if np.any(target.start.applied):
        return "the scene pushes its bodies with forces from outside, which do work"
    if any(not model.body(index).name for index in np.flatnonzero(model.body_gravcomp)):
        return "gravity is compensated for bodies without a name, which cannot be switched off"
    return ""


def free_motions(bench: Bench, store: str) -> list[Motion]:
    """Run the model's free motion with its own integrator and the best, by timestep.

    The first is at the model's own settings; the last, if the model has any damping, with that on.
    """
    target = bench.target
    own, timestep = str(target.setting("integrator")), target.resolved.timestep
    rows: list[Values] = [
        {**_still(target), "integrator": integrator, "timestep": timestep * share}
        for integrator in dict.fromkeys((own, BEST))
        for share in _SHARES
        if share == 1 or target.fits(timestep * share, SECONDS)
    ]
    undamped = len(rows)
    if is_damped(target):
        rows.append({**_without(target, _MEDIUM, "damper"), "integrator": own})
    runs = bench.run(
        store,
        "Free motion: contacts, limits and all that gives or takes energy are off",
        rows,
        duration=SECONDS,
        checks="none",
        timeout=_TIMEOUT,
    )
    return [_motion(target, each, damped=row >= undamped) for row, each in enumerate(runs)]


def is_damped(target: Target) -> bool:
    """Say whether the model's own joints, tendons or medium take energy."""
    model = target.prepared.model
    fluid = any(target.setting(name) for name in _MEDIUM)
    viscous = model.dof_damping.any() or model.tendon_damping.any()
    return bool(fluid or (viscous and target.resolved.flags["damper"]))


def is_accounted(target: Target) -> bool:
    """Say whether all that damps is linear in the speed of a joint, so that its work is known."""
    model = target.prepared.model
    curved = getattr(model, "dof_dampingpoly", np.zeros(1))
    fluid = any(target.setting(name) for name in _MEDIUM)
    return not (fluid or model.tendon_damping.any() or np.any(curved))


def _motion(target: Target, tried: Tried, *, damped: bool) -> Motion:
    settings = tried.record.settings
    damping = np.array(target.prepared.model.dof_damping, dtype=np.float64) * damped
    return Motion(
        tried=tried,
        integrator=str(settings["integrator"]),
        timestep=float(str(settings["timestep"])),
        damped=damped,
        ledger=ledger_of(tried.trace, damping, _apart(target, tried)) if tried.whole else None,
    )


def bystanders(target: Target) -> tuple[int, ...]:
    """Return the bodies that fly by themselves beside a mechanism; none if there is no other."""
    model = target.prepared.model
    loose = loose_bodies(model)
    return loose if model.nv > 6 * len(loose) else ()


def _apart(target: Target, tried: Tried) -> tuple[Floats, Floats]:
    trace = tried.trace
    return loose_energy(target.prepared.model, bystanders(target), trace.qpos, trace.qvel)


def _still(target: Target) -> dict[str, object]:
    """Return the switches and settings that leave gravity, springs and inertia alone."""
    model = target.base.model
    values: dict[str, object] = dict.fromkeys(_OFF, False)
    values |= {name: 0.0 for name in _MEDIUM if target.setting(name)}
    compensated = np.flatnonzero(model.body_gravcomp)
    return values | {f"body_gravcomp[{model.body(index).name}]": 0.0 for index in compensated}


def _without(target: Target, medium: tuple[str, ...], switch: str) -> dict[str, object]:
    return {name: value for name, value in _still(target).items() if name not in {*medium, switch}}
