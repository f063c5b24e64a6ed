"""What can be changed about a scene's effects, one at a time."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from contactlab.scene import EFFECTS, EffectState
from contactlab.studies.effects.question import Question, Values

# All that is solved, which pairs of bodies touch, and what inverse dynamics says are the model's.
_KEPT = {"constraint", "filterparent", "invdiscrete"}
# What turns on an effect that the base configuration lacks.
_ON: Mapping[str, Values] = MappingProxyType(
    {
        "torsional_friction": {"torsional_friction": True},
        "rolling_friction": {"rolling_friction": True},
        "elliptic": {"elliptic": True},
        "noslip": {"noslip": True},
        "impratio": {"impratio": 10.0},
        "speculative": {"speculative": True},
        # What sleeps is an island; in a set that leaves islands out, sleep brings them back.
        "sleep": {"sleep": True, "island": True},
        "diagexact": {"diagexact": True},
        "implicit": {"implicit": True},
    }
)
_OFF: Mapping[str, Values] = MappingProxyType(
    {"gravity": {"gravity": 0.0}, "impratio": {"impratio": 1.0}}
)


@dataclass(frozen=True)
class Toggle:
    """One effect, changed.

    Attributes:
        effect: its name.
        on: whether it is on in the base configuration.
        values: axis values that change it.
        proof: why nothing changes with it, if that is known without running anything.
    """

    effect: str
    on: bool
    values: Values
    proof: str | None


def find_toggles(question: Question) -> tuple[Toggle, ...]:
    """Return every effect that can be changed, as the base configuration has it."""
    written = [*_choices(question, "all")]
    proven = [*_choices(question, "auto")]
    found = (_toggle(name, written, proven) for name in EFFECTS if name not in _KEPT)
    return tuple(each for each in found if each is not None)


def _choices(question: Question, rest: str) -> Iterator[Mapping[str, EffectState]]:
    scene = question.scene.with_effects(rest)
    for scenario in question.scenarios:
        run = scene.resolve({**question.base, **scenario}, question.seeds[0], question.duration)
        yield scene.prepare(run, scene.starts([run])).effects


def _toggle(
    name: str, written: list[Mapping[str, EffectState]], proven: list[Mapping[str, EffectState]]
) -> Toggle | None:
    on = any(each[name].on for each in written)
    if not on:
        return Toggle(name, False, _ON[name], None) if name in _ON else None
    unused = not any(each[name].on for each in proven)
    proof = proven[0][name].reason if unused and written[0][name].on else None
    return Toggle(name, True, _OFF.get(name, {name: False}), proof)
