"""Facts of a model beside its budget: how deep it sinks, where it overlaps, what its bodies weigh.

They judge nothing: what is deep or light may be meant. Numbers are in units that people use.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.places import contact_name
from contactlab.budget.verdict import percent
from contactlab.budget.windows import replay
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.compile_model import InertiaFault
from contactlab.schema.examination import Fact
from contactlab.studies.check.inertia import in_words, inertia_faults

# States are looked at in these windows of a run [s].
_WINDOW = 0.01
# Depths below this share of the thinner geom, and forces below so many weights, are ordinary.
_DEEP, _HEAVY = 0.05, 1e3


class _Contact(NamedTuple):
    """The deepest contact, or the one with the largest force, of some states."""

    pair: str
    amount: float  # [m] or [N]
    share: float  # of the thinner geom's smallest half extent, or of the model's weight
    time: float  # [s], of the run


def facts(motions: Sequence[Motion], begins: Sequence[float]) -> tuple[Fact, ...]:
    """Return the facts of a model's motions, whose phases begin at these times [s] of the run."""
    model = motions[0].model
    data = mujoco.MjData(model)
    deepest, hardest, overlap = list[_Contact](), list[_Contact](), list[_Contact]()
    for motion, begin in zip(motions, begins, strict=True):
        run = replay(motion, _WINDOW, 1)
        times = begin + run.begins * model.opt.timestep
        for seed in range(motion.seeds):
            for place in np.flatnonzero(run.valid[seed]):
                found = list(_contacts(model, data, run.starts[seed, place], float(times[place])))
                deepest += [contact for contact, _ in found]
                hardest += [contact for _, contact in found]
                if not place and not begin:
                    overlap += [contact for contact, _ in found]
    return (*_of_depth(deepest, overlap), *_of_force(hardest), *_of_mass(model))


def _contacts(
    model: mujoco.MjModel, data: mujoco.MjData, state: Floats, time: float
) -> Iterator[tuple[_Contact, _Contact]]:
    """Yield each contact of a state as a depth and as a force."""
    mujoco.mj_setState(model, data, state, INTEGRATION)
    mujoco.mj_forward(model, data)
    weight = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity)) or np.inf
    force = np.empty(6)
    for place in range(data.ncon):
        geoms = data.contact.geom[place]
        if geoms.min() < 0 or data.contact.efc_address[place] < 0:
            continue
        mujoco.mj_contactForce(model, data, place, force)
        name, depth = contact_name(model, geoms), -float(data.contact.dist[place])
        thin = min(_half_extent(model, int(geom)) for geom in geoms)
        yield (
            _Contact(name, depth, depth / thin, time),
            _Contact(name, float(force[0]), float(force[0]) / weight, time),
        )


def _half_extent(model: mujoco.MjModel, geom: int) -> float:
    """Return half of a geom's smallest extent [m]; infinite for a plane or height field."""
    half = model.geom_aabb[geom, 3:]
    return float(half.min()) if half.min() > 0 else np.inf


def _of_depth(deepest: Sequence[_Contact], overlap: Sequence[_Contact]) -> Iterator[Fact]:
    if (worst := _worst(overlap)) and worst.share > _DEEP:
        yield Fact(
            kind="overlap",
            place=worst.pair,
            value=worst.amount,
            unit="m",
            sentence=f"at the start {_in_words(worst)}",
        )
    if (worst := _worst(deepest)) and worst.share > 0:
        yield Fact(
            kind="depth",
            place=worst.pair,
            value=worst.amount,
            unit="m",
            sentence=f"deepest {_in_words(worst)}, at {worst.time:.2f} s",
        )


def _worst(contacts: Sequence[_Contact]) -> _Contact | None:
    return max(contacts, key=lambda contact: contact.share, default=None)


def _in_words(contact: _Contact) -> str:
    share = percent(contact.share)
    return f"{contact.pair}, {1e3 * contact.amount:.2g} mm ({share} of half the thinner geom)"


def _of_force(hardest: Sequence[_Contact]) -> Iterator[Fact]:
    if (worst := _worst(hardest)) and worst.share > _HEAVY:
        sentence = (
            f"absurd: {worst.pair} bears {worst.amount:.2g} N, {worst.share:.2g} times the "
            f"model's weight, at {worst.time:.2f} s"
        )
        yield Fact(kind="force", place=worst.pair, value=worst.amount, unit="N", sentence=sentence)


def _of_mass(model: mujoco.MjModel) -> Iterator[Fact]:
    alike: dict[tuple[str, float], list[InertiaFault]] = {}
    for fault in inertia_faults(model):
        alike.setdefault((fault.kind, fault.limit), []).append(fault)
    for faults in alike.values():
        first, (sentence,) = faults[0], in_words(faults)
        yield Fact(
            kind="inertia", place=first.body, value=first.value, unit=first.unit, sentence=sentence
        )
