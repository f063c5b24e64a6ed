"""Contacts of a model in units of the world: laws of rest and impact, and what a run measures."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from contactlab.contact.contact_laws import (
    damping_ratio,
    damping_ratio_of,
    largest_step,
    refsafe_solref,
    rest_penetration,
    restitution_from_damping,
    stiffness_damping,
)
from contactlab.contact.trace_arrays import DISTANCE
from contactlab.mjcf import AT_REST
from contactlab.scene.contact_at_rest import ContactAtRest, rest_law_inputs
from contactlab.schema.examination import RestingContact
from contactlab.tasks.checked_model import CheckedModel

_MEANS = ("contacts", "load", "depth")


@dataclass(frozen=True)
class RestingPair:
    """A pair of contacts, what it bears at rest, and how deep it is.

    That is measured at the end of the first phase of the task, before anything is excited.
    """

    law: ContactAtRest
    name: str  # as it is told: geoms without one by their bodies
    restitution: float | None  # measured in the run
    phase: str  # the first of the task
    contacts: float = 0.0  # mean number in the last fifth of that phase, if the pair rests then
    load: float = 0.0  # that one contact bears [N]
    depth: float = 0.0  # mean of the contacts, measured [m]

    @property
    def expected_depth(self) -> float:
        """The depth at which it bears its load, by the law [m]."""
        law, weight = self.law, self.law.softness * self.load
        return float(rest_penetration(weight, law.inverse_mass, law.solref, law.solimp))

    def contact(self, timestep: float) -> RestingContact:
        """Return it as data, for a timestep [s] of the run."""
        solref, mass = self.law.solref, 1 / self.law.inverse_mass
        (rate, drag), zeta = stiffness_damping(solref), damping_ratio(solref)
        return RestingContact(
            name=self.name,
            solref=solref,
            phase=self.phase,
            contacts=self.contacts,
            load=self.load,
            depth=self.depth,
            expected_depth=self.expected_depth if self.load else None,
            stiffness=float(rate) * mass,
            damping=float(drag) * mass,
            damping_ratio=float(zeta),
            restitution=float(restitution_from_damping(zeta)),
            bounced=self.restitution,
            longest_step=float(largest_step(solref)),
            timestep=timestep,
        )

    def solve_softness(self, words: Mapping[str, float]) -> tuple[float, float]:
        """Return the solref, in standard form, that has what is asked for; refused with why not."""
        zeta = float(damping_ratio(self.law.solref))
        if "restitution" in words:
            zeta = float(damping_ratio_of(words["restitution"]))
        if not words.keys() & AT_REST.keys():
            return 1 / (zeta * float(stiffness_damping(self.law.solref)[0]) ** 0.5), zeta
        depth = words.get("depth_at_rest") or self.load / words["stiffness"]
        return self.law.solref_for_depth(depth, self.load, zeta)


def resting_contacts(examined: CheckedModel) -> Iterator[RestingContact]:
    """Yield the monitored pairs of a model of which one side can move, in units of the world."""
    timestep = examined.resolved.timestep
    yield from (pair.contact(timestep) for pair in resting_pairs(examined))


def resting_pairs(examined: CheckedModel) -> Iterator[RestingPair]:
    """Yield the monitored pairs of which one side can move, as the run of the first seed has them.

    Nothing is stiff between sides that cannot move.
    """
    if not examined.base.pairs:
        return
    run, first = examined.runs[0], examined.task.phases[0]
    record, trace, timestep = run.record, run.trace, examined.resolved.timestep
    end = round((len(trace.time) - 1) * first.end / examined.task.duration)
    fifth = end // 5
    for pair in examined.base.pairs:
        stored, used = trace.pair(pair.name), record.pairs[pair.name]
        last = (stored.steps >= end - fifth) & (stored.steps < end)
        count, loads = stored.contacts[last], stored.normal[last]
        points = stored.points[np.repeat(last, stored.contacts), DISTANCE]
        safe = record.effects.get("refsafe", True)
        solref = refsafe_solref(used.solref, timestep) if safe else used.solref
        law = replace(rest_law_inputs(examined.prepared.model, pair, used), solref=solref)
        if not law.inverse_mass:
            continue
        found = RestingPair(
            law,
            examined.name_geoms(pair.name),
            record.metrics.get("restitution_measured"),
            first.name,
        )
        resting_share = 0.9  # of the last fifth of the first phase, in which a pair touches
        if last.any() and last.sum() >= resting_share * fifth:
            depth = used.margin - float(points.mean())  # force begins at the margin
            means = float(count.mean()), float((loads / count).mean()), depth
            found = replace(found, **dict(zip(_MEANS, means, strict=True)))
        yield found
