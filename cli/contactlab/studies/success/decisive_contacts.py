"""The contacts that decide an episode: those of its object with what holds, pushes or carries it.

The object is what a robot touches and no actuator moves. Without one, as for a robot that walks, it
is the robot itself.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.measure import labels_with
from contactlab.rendering.amounts import format_percent
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import (
    MAX_PAIRS,
    colliding_geoms,
    half_extents,
    touch_pairs,
)
from contactlab.scene.model_names import find_id, name_of
from contactlab.scene.part_bodies import bodies_of_actuator, is_mocap_driven
from contactlab.schema.evidence import LabelEntry
from contactlab.schema.scene_manifest import PairEntry
from contactlab.store.mcap.trace_reader import StoredPair, StoredTrace
from contactlab.studies.success.contact_creep import (
    ContactHold,
    CreepLimits,
    Sides,
    find_holds,
)

Bodies = frozenset[int]
SUSTAINED_SECONDS = 0.02
"""A depth counts if it lasts as long as a mode of contact must last in a requirement [s]."""


@dataclass(frozen=True)
class Parts:
    """The bodies of a model by their role.

    Attributes:
        trees: (nbody,) the kinematic tree of each body; -1 of static ones.
        agents: the bodies of trees that actuators or mocap bodies move, and mocap bodies.
    """

    model: mujoco.MjModel
    trees: np.ndarray
    agents: Bodies

    @classmethod
    def from_model(cls, model: mujoco.MjModel) -> "Parts":
        """Find the roles of a model's bodies."""
        trees = np.asarray(model.body_treeid)
        moved = {
            find_id(model, "body", name)
            for actuator in range(model.nu)
            for name in bodies_of_actuator(model, actuator)
        }
        for equality in np.flatnonzero(is_mocap_driven(model)):
            moved |= {int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])}
        driven = {int(trees[body]) for body in moved if body >= 0} - {-1}
        is_agent = np.isin(trees, [*driven]) | (np.asarray(model.body_mocapid) >= 0)
        return cls(model, trees, frozenset(np.flatnonzero(is_agent).tolist()))

    @property
    def things(self) -> Bodies:
        """The bodies that move and that nothing drives."""
        free = set(np.flatnonzero(self.trees >= 0).tolist())
        return frozenset(free - self.agents)

    def tree_of(self, bodies: Iterable[int]) -> Bodies:
        """Return all bodies of the trees of some bodies."""
        trees = {int(self.trees[body]) for body in bodies} - {-1}
        return frozenset(np.flatnonzero(np.isin(self.trees, [*trees])).tolist())

    def named_bodies(self, names: Sequence[str]) -> Bodies:
        """Return the bodies of names with all that is fixed to them or hangs on them."""
        known = [name_of(self.model, "body", body) for body in range(1, self.model.nbody)]
        bodies = set[int]()
        for name in names:
            body = find_id(self.model, "body", name)
            if body < 1:
                raise SceneError(f"--object {name}: no such body{did_you_mean(name, known)}")
            bodies.add(body)
        for body in range(1, self.model.nbody):  # parents come first
            if int(self.model.body_parentid[body]) in bodies:
                bodies.add(body)
        return frozenset(bodies)


def choose_pairs(model: mujoco.MjModel, names: Sequence[str]) -> list[PairEntry]:
    """Return the pairs to record: of geoms of possible objects with all that they can touch.

    If these are too many, they are pairs of bodies, whose thickness is that of their thinnest geom.
    Raises a SceneError if nothing can touch, or more pairs of bodies than can be recorded.
    """
    parts = Parts.from_model(model)
    objects = parts.named_bodies(names) if names else parts.things or parts.agents
    owner = np.asarray(model.geom_bodyid)
    geoms, bodies = list[PairEntry](), dict[tuple[str, str], None]()
    for pair in touch_pairs(model):
        both = [int(owner[geom]) for geom in pair]
        apart = parts.trees[both[0]] != parts.trees[both[1]] or bool(names)
        if apart and not objects.isdisjoint(both):
            first, second = (name_of(model, "geom", geom) for geom in pair)
            geoms.append(PairEntry(geoms=(first, second)))
            bodies[name_of(model, "body", min(both)), name_of(model, "body", max(both))] = None
    if not geoms:
        raise SceneError("no object of the environment can touch anything; name one by --object")
    if len(geoms) <= MAX_PAIRS:
        return geoms
    if len(bodies) <= MAX_PAIRS:
        slots = 8  # contacts of two faces
        return [PairEntry(bodies=pair, slots=slots) for pair in bodies]
    body_names = sorted({name_of(model, "body", body) for body in objects})
    raise SceneError(
        f"{len(bodies)} pairs of bodies may touch, and {MAX_PAIRS} can be recorded; name the "
        f"object by --object, out of {', '.join(body_names)}"
    )


@dataclass(frozen=True)
class ContactVerdict:
    """The contacts of the object in one episode.

    Attributes:
        causes: the reasons that speak against them, by name: failure labels of the object, worst
            first, `too deep` and `creeping`.
    """

    causes: "Mapping[str, ContactCause]"

    @property
    def is_sound(self) -> bool:
        """Whether nothing speaks against the contacts."""
        return not self.causes


class ContactCause(NamedTuple):
    """A reason that speaks against contacts, and when it begins [s]; None for a whole episode."""

    reason: str
    time: float | None


TOO_DEEP, CREEPING = "too deep", "creeping"


@dataclass(frozen=True)
class PairShare:
    """A decisive pair of bodies, and its part of the impulse of all contacts of the object."""

    name: str
    share: float


class DecisiveContacts:
    """Finds the object of episodes in their traces, and judges its contacts.

    Args:
        base: the compiled scene with the monitored pairs.
        names: bodies that the user names as the object; found in traces if empty.
        limit: largest depth, as a share of the thickness of the thinner body.
    """

    def __init__(self, base: CompiledScene, names: Sequence[str], limit: float) -> None:
        self._base, self._limit = base, limit
        self.parts = Parts.from_model(base.model)
        self.named = bool(names)
        self.objects: Bodies = self.parts.named_bodies(names) if names else frozenset()
        self.pairs: tuple[PairShare, ...] = ()

    @cached_property
    def _pair_sides(self) -> dict[str, tuple[Bodies, Bodies]]:
        owner = np.asarray(self._base.model.geom_bodyid)
        return {
            pair.name: (
                frozenset(owner[list(pair.geoms[0])].tolist()),
                frozenset(owner[list(pair.geoms[1])].tolist()),
            )
            for pair in self._base.pairs
        }

    @cached_property
    def _touching_sides(self) -> dict[str, Sides]:
        # The geoms of each pair that may touch.
        touching = colliding_geoms(self._base.model, self._base.pairs)
        return {
            pair.name: (tuple({one for one, _ in geoms}), tuple({other for _, other in geoms}))
            for pair, geoms in zip(self._base.pairs, touching, strict=True)
        }

    @cached_property
    def _pair_thicknesses(self) -> dict[str, float]:
        halves = half_extents(self._base.model)
        return {
            name: 2 * float(halves[[*sides[0], *sides[1]]].min(initial=np.inf))
            for name, sides in self._touching_sides.items()
        }

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of the object's bodies that are the roots of their trees, or were named."""
        model = self._base.model
        roots = [
            body
            for body in sorted(self.objects)
            if int(model.body_parentid[body]) not in self.objects
        ]
        return tuple(name_of(model, "body", body) for body in roots)

    @property
    def body_names(self) -> frozenset[str]:
        """Names of all bodies of the object."""
        return frozenset(name_of(self._base.model, "body", body) for body in self.objects)

    def find_object(self, traces: Sequence[StoredTrace]) -> None:
        """Find the object in the traces of some episodes, and its decisive pairs."""
        impulses = dict[str, float]()
        for trace in traces:
            step = float(np.diff(trace.time[:2]).sum())
            for pair in trace.pairs:
                impulses[pair.name] = impulses.get(pair.name, 0.0) + step * float(pair.normal.sum())
        if not self.named:
            self.objects = self._touched_things(impulses)
        own = {name: value for name, value in impulses.items() if self._is_decisive(name)}
        total = sum(own.values())
        least = 0.01  # contacts with less of the impulse brush past
        ranked = sorted(own, key=lambda name: -own[name])
        shares = [PairShare(name, own[name] / total) for name in ranked if total > 0]
        self.pairs = tuple(each for each in shares if each.share >= least)

    def _touched_things(self, impulses: dict[str, float]) -> Bodies:
        things, reached = self.parts.things, set(self.parts.agents)
        loaded = [self._pair_sides[name] for name, value in impulses.items() if value > 0]
        while True:
            more = {
                body
                for sides in loaded
                for one, other in (sides, sides[::-1])
                if not reached.isdisjoint(one)
                for body in other & things
            }
            if self.parts.tree_of(more) <= reached:
                break
            reached |= self.parts.tree_of(more)
        return frozenset(reached & things) or self.parts.agents

    def _is_decisive(self, pair: str) -> bool:
        return any(not side.isdisjoint(self.objects) for side in self._pair_sides[pair])

    def judge_episode(
        self, labels: Iterable[LabelEntry], trace: StoredTrace | None
    ) -> ContactVerdict:
        """Return the verdict on the contacts of an episode with some labels."""
        names, notes = self.body_names, {"stable", *labels_with("note")}
        causes = dict[str, ContactCause]()
        for each in labels:
            if each.label not in notes and (not each.bodies or not names.isdisjoint(each.bodies)):
                time = None if trace is None or each.step is None else float(trace.time[each.step])
                causes.setdefault(each.label, ContactCause(each.reason, time))
        depths, holds = [_NOTHING], list[tuple[ContactHold, str]]()
        for pair in trace.pairs if trace else ():
            if trace and self._is_decisive(pair.name) and len(pair.steps):
                depths.append(self._find_lasting_depth(pair, trace.time))
                pair_holds = find_holds(
                    self._base.model, self._touching_sides[pair.name], pair, trace
                )
                holds += [(hold, pair.name) for hold in pair_holds]
        if (deepest := max(depths)).amount > self._limit:
            part = format_percent(deepest.amount)
            text = f"{deepest.describe_contact()}: {part} of the thinner body's thickness"
            causes[TOO_DEEP] = ContactCause(text, deepest.time)
        if holds:
            shortest, name = min(holds, key=lambda each: each[0].times_left)
            if shortest.times_left < CreepLimits().multiple:
                text = f"{name}: {shortest.describe_creep()}"
                causes[CREEPING] = ContactCause(text, shortest.begin)
        return ContactVerdict(causes)

    def _find_lasting_depth(self, pair: StoredPair, times: Floats) -> "_Extreme":
        depths: Floats = pair.spread_over_steps(len(times) - 1, -pair.distance)
        width = min(max(1, round(SUSTAINED_SECONDS / float(times[1] - times[0]))), len(depths))
        lasting = np.lib.stride_tricks.sliding_window_view(depths, width).min(axis=1)
        deepest = int(lasting.argmax())
        share = float(lasting[deepest]) / self._pair_thicknesses[pair.name]
        return _Extreme(share, pair.name, float(times[deepest]))


class _Extreme(NamedTuple):
    amount: float
    pair: str
    time: float

    def describe_contact(self) -> str:
        return f"{self.pair} at {self.time:.2f} s"


_NOTHING = _Extreme(0.0, "", 0.0)
