"""The one judge of grips: what drifts come to, and why an object does not stay."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from contactlab.schema.grip import CauseKind, GripWord
from contactlab.studies.grip.holding import Drift

_DEEP = 0.1  # of half of the object's width
_HALVED = 0.5


def worst_of(drifts: Sequence[Drift]) -> Drift:
    """Return the drift that is lost first, or else the fastest."""
    lost = [drift for drift in drifts if drift.trend == "lost"]
    if lost:
        return min(lost, key=lambda drift: drift.lost)
    return max(drifts, key=lambda drift: drift.speed)


def word_of(drifts: Sequence[Drift], within: float) -> GripWord:
    """Return a verdict on drifts: drops if one is lost, creeps if one is faster than so [m/s]."""
    worst = worst_of(drifts)
    if worst.trend == "lost":
        return "drops"
    return "creeps" if worst.speed > within else "holds"


def speed_of(drifts: Sequence[Drift]) -> float:
    """Return the speed of the worst drift [m/s]; infinite if it is lost."""
    return worst_of(drifts).speed


@dataclass(frozen=True)
class Evidence:
    """What is known of a grip when it is asked why.

    Attributes:
        word: the verdict.
        speed: of the worst drift [m/s]; infinite if lost.
        idle: speed without a load [m/s].
        pressed: whether two sides press on the object.
        pull, weight: what the fingers hold at least, and what the object weighs [N].
        deep: depth over half of the object's width.
        tried: speeds with remedies, by what they are against.
    """

    word: GripWord
    speed: float
    idle: float
    pressed: bool
    pull: float
    weight: float
    deep: float
    tried: Mapping[str, float]

    def halved_by(self, name: str) -> bool:
        """Return whether a remedy leaves at most half of the speed, or holds what was lost."""
        left = self.tried.get(name, math.inf)
        return math.isfinite(left) and left <= _HALVED * self.speed


def causes(known: Evidence) -> list[tuple[CauseKind, str]]:
    """Return why an object does not stay, the first cause first; each by an experiment."""
    found = list[tuple[CauseKind, str]]()
    if known.word != "holds" and (first := _first_cause(known)) is not None:
        found.append(first)
    if known.deep > _DEEP:
        share = f"{known.deep:.0%} of half of its width"
        found.append(("sinking in", f"the fingers sink into it by {share}"))
    return found


_BY_EXPERIMENT: tuple[tuple[str, CauseKind, str], ...] = (
    ("squeeze", "weak squeeze", "more squeeze halves it"),
    ("friction", "Coulomb's limit", "twice the friction halves it"),
    ("solref", "sinking in", "stiffer contacts halve it"),
    ("condim", "shape", "it turns about its contacts: friction that resists spin halves it"),
)


def _first_cause(known: Evidence) -> tuple[CauseKind, str] | None:
    if not known.pressed:
        return "shape", "it slips out as the fingers close, before anything loads it"
    if known.word == "drops" and known.pull < known.weight:
        return _too_weak(known)
    if known.idle > _HALVED * known.speed:
        return "shape", "it moves as much without a load: the fingers push it on"
    if known.halved_by("regularised"):
        return "regularised friction", _regularised(known)
    for against, kind, text in _BY_EXPERIMENT:
        if known.halved_by(against):
            return kind, text
    unknown: CauseKind = "unknown"
    return (unknown, "none of the changes that were run halves it") if known.tried else None


def _too_weak(known: Evidence) -> tuple[CauseKind, str]:
    held = f"the fingers hold {known.pull:.3g} N of its {known.weight:.3g} N"
    if known.halved_by("squeeze"):
        return "weak squeeze", f"{held}; more squeeze holds it"
    if known.halved_by("friction"):
        return "Coulomb's limit", f"{held}; more friction holds it"
    return "weak squeeze", f"{held}, and neither friction nor squeeze at hand suffices"


def _regularised(known: Evidence) -> str:
    text = "friction is regularised, so that a held body creeps under any load"
    more = known.tried.get("friction", math.nan)
    if math.isnan(more) or more < _HALVED * known.speed:
        return text
    if not math.isfinite(more):
        return f"{text}; twice the friction makes it worse: the object is lost"
    change = "makes it worse" if more > known.speed else "does not cure it"
    return f"{text}; twice the friction {change}: {1e3 * more:.2g} mm/s"
