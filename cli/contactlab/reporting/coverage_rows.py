"""Coverage of a run, in words."""

from collections.abc import Iterable, Sequence

from contactlab.rendering.amounts import format_percent
from contactlab.schema.coverage import ActuatorUse, Coverage, PairUse, Travel

_APART = PairUse()


def coverage_rows(coverage: Coverage, pairs: Iterable[str]) -> list[tuple[str, str, str]]:
    """Return each kind of parts that a model has: the unused ones, and the use of the others.

    The pairs are all that are monitored.
    """
    parts = {**coverage.joints, **coverage.tendons}
    limited = {name: part for name, part in parts.items() if part.share is not None}
    kinds = {
        "joints moved": {name: _describe_travel(joint) for name, joint in coverage.joints.items()},
        "limits reached": {name: ", ".join(part.ends) for name, part in limited.items()},
        "tendons moved": {
            name: _describe_travel(tendon) for name, tendon in coverage.tendons.items()
        },
        "actuators used": {
            name: _describe_use(actuator) for name, actuator in coverage.actuators.items()
        },
        "equalities loaded": {
            name: f"{load:g}" if load else "" for name, load in coverage.equalities.items()
        },
        "pairs touched": {
            name: _describe_touch(coverage.pairs.get(name, _APART)) for name in pairs
        },
    }
    return [
        (
            kind,
            join_few([name for name, text in texts_by_name.items() if not text], ", "),
            join_few([f"{name} {text}" for name, text in texts_by_name.items() if text], "; "),
        )
        for kind, texts_by_name in kinds.items()
        if texts_by_name
    ]


def join_few(texts: Sequence[str], separator: str, most: int = 4) -> str:
    """Return the first texts, and the count of the others."""
    rest = len(texts) - most
    more = [f"{rest} more"] if rest > 0 else []
    return separator.join([*texts[:most], *more])


def _describe_travel(travel: Travel) -> str:
    """Return the distance that a part moved; empty if it stayed at rest."""
    if not travel.counts and not travel.stretched:
        return ""
    way = f"{travel.moved:g}" if travel.share is None else format_percent(travel.share)
    return f"{way}, turned {travel.turned:g} rad" if travel.turned else way


def _describe_use(use: ActuatorUse) -> str:
    if not use.force and not use.counts:
        return ""
    control = f"{format_percent(use.share)}, " if use.share else ""
    saturated = f", saturated {format_percent(use.saturated)}" if use.saturated else ""
    return f"{control}force {use.force:g}{saturated}"


def _describe_touch(use: PairUse) -> str:
    """Return the shares of time that a pair touched, stuck, slid, rolled and spun."""
    names = ("touched", "stuck", "slid", "rolled", "spun")
    shares = ((name, getattr(use, name)) for name in names)
    return ", ".join(f"{name} {format_percent(share)}" for name, share in shares if share)
