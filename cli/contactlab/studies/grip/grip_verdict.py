"""The verdict on a grip, and its causes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from contactlab.rendering.amounts import format_percent
from contactlab.schema.grip import CauseKind, GripVerdict
from contactlab.studies.grip.holding import Drift

_HALVED_SHARE = 0.5


def worst_drift(drifts: Sequence[Drift]) -> Drift:
    """Return the drift that is lost first, or otherwise the fastest."""
    lost = [drift for drift in drifts if drift.trend == "lost"]
    if lost:
        return min(lost, key=lambda drift: drift.lost)
    return max(drifts, key=lambda drift: drift.speed)


MOST_DEPTH = 0.5
"""Share of half of the object's width. Deeper, a finger is nearer to the middle of the object than
to its face, and where it touches is not where it would."""


def verdict_of(drifts: Sequence[Drift], within: float, deep: float) -> GripVerdict:
    """Return the verdict: drops if a drift is lost, creeps if one is faster than `within` [m/s].

    An object that rests deep inside the fingers, by more than half of half its width, is not held.
    """
    worst = worst_drift(drifts)
    if worst.trend == "lost":
        return "drops"
    if worst.speed > within:
        return "creeps"
    return "penetrates" if deep > MOST_DEPTH else "holds"


def worst_speed(drifts: Sequence[Drift]) -> float:
    """Return the speed of the worst drift [m/s]; infinite if it is lost."""
    return worst_drift(drifts).speed


@dataclass(frozen=True)
class GripEvidence:
    """Measurements that show the causes.

    Attributes:
        word: the verdict.
        speed: of the worst drift [m/s]; infinite if lost.
        idle: speed without a load [m/s].
        pressed: whether two sides press on the object.
        pull, weight: smallest holding force, and weight of the object [N].
        deep: depth over half of the object's width.
        speeds_with_fixes: speeds with fixes, by the cause that they test.
        tolerance: largest speed of an object that does not creep [m/s].
    """

    word: GripVerdict
    speed: float
    idle: float
    pressed: bool
    pull: float
    weight: float
    deep: float
    speeds_with_fixes: Mapping[str, float]
    tolerance: float

    def is_halved_by(self, name: str) -> bool:
        """Return whether a fix halves the speed at least, or holds an object that was lost."""
        new_speed = self.speeds_with_fixes.get(name, math.inf)
        return math.isfinite(new_speed) and new_speed <= _HALVED_SHARE * self.speed


def find_causes(evidence: GripEvidence) -> list[tuple[CauseKind, str]]:
    """Return why an object does not stay, the first cause first; each is shown by an experiment."""
    causes = list[tuple[CauseKind, str]]()
    if (
        evidence.word not in ("holds", "penetrates")
        and (first := _first_cause(evidence)) is not None
    ):
        causes.append(first)
    deep_share = 0.1  # share of half of the object's width
    if evidence.deep > deep_share:
        share = f"{format_percent(evidence.deep)} of half of its width"
        causes.append(("deep penetration", f"the fingers penetrate it by {share}"))
    return causes


_BY_EXPERIMENT: tuple[tuple[str, CauseKind, str], ...] = (
    ("squeeze", "weak squeeze", "more squeeze halves the speed"),
    ("friction", "Coulomb's limit", "twice the friction halves the speed"),
    ("solref", "deep penetration", "stiffer contacts halve the speed"),
    ("condim", "shape", "it turns about its contacts: torsional friction halves the speed"),
)


def _first_cause(evidence: GripEvidence) -> tuple[CauseKind, str] | None:
    if not evidence.pressed:
        return "shape", "it slips out while the fingers close, before it is loaded"
    if evidence.word == "drops" and evidence.pull < evidence.weight:
        kind: CauseKind = "weak squeeze"
        end = _missing_force(evidence.speeds_with_fixes)
        if evidence.is_halved_by("squeeze"):
            end = "; more squeeze holds it"
        elif evidence.is_halved_by("friction"):
            kind, end = "Coulomb's limit", "; more friction holds it"
        pull_text = (
            f"the fingers hold {evidence.pull:.3g} N, the object weighs {evidence.weight:.3g} N"
        )
        return kind, f"{pull_text}{end}"
    if evidence.idle > min(_HALVED_SHARE * evidence.speed, evidence.tolerance):
        # Friction carries no load then, so the cause is not its regularization.
        return "shape", (
            f"without a load it moves at {1e3 * evidence.idle:.2g} mm/s already: the fingers push "
            "it, "
            "by their shape or their soft contacts"
        )
    if evidence.is_halved_by("regularized"):
        return "regularized friction", _regularized_cause(evidence)
    for against, kind, text in _BY_EXPERIMENT:
        if evidence.is_halved_by(against):
            return kind, text
    unknown: CauseKind = "unknown"
    return (unknown, "no tested change halves the speed") if evidence.speeds_with_fixes else None


def _missing_force(speeds_with_fixes: Mapping[str, float]) -> str:
    if "friction" not in speeds_with_fixes:
        return ""
    if "squeeze" in speeds_with_fixes:
        return ", and neither more friction nor more squeeze is enough"
    return ", twice the friction is not enough, and the actuators allow no more squeeze"


def _regularized_cause(evidence: GripEvidence) -> str:
    text = "MuJoCo's friction is regularized, so that a held body creeps under any load"
    more = evidence.speeds_with_fixes.get("friction", math.nan)
    if math.isnan(more) or more < _HALVED_SHARE * evidence.speed:
        return text
    if not math.isfinite(more):
        return f"{text}; twice the friction makes it worse: the object is lost"
    change = "makes it worse" if more > evidence.speed else "does not fix it"
    return f"{text}; twice the friction {change}: {1e3 * more:.2g} mm/s"
