"""Coverage of a run, in words."""

from collections.abc import Iterable

from contactlab.schema.coverage import ActuatorUse, Coverage, PairUse, Travel

_MOST_PARTS_LISTED = 4
_APART = PairUse()


def coverage_rows(coverage: Coverage, pairs: Iterable[str]) -> list[tuple[str, str, str]]:
    """Return the kinds of parts that a model has: those that a run left alone, what others did.

    The pairs are all that are monitored.
    """
    parts = {**coverage.joints, **coverage.tendons}
    limited = {name: part for name, part in parts.items() if part.share is not None}
    kinds = {
        "joints moved": {name: _travel(joint) for name, joint in coverage.joints.items()},
        "limits reached": {name: ", ".join(part.ends) for name, part in limited.items()},
        "tendons moved": {name: _travel(tendon) for name, tendon in coverage.tendons.items()},
        "actuators used": {name: _use(actuator) for name, actuator in coverage.actuators.items()},
        "equalities loaded": {
            name: f"{load:g}" if load else "" for name, load in coverage.equalities.items()
        },
        "pairs touched": {name: _touching(coverage.pairs.get(name, _APART)) for name in pairs},
    }
    return [
        (
            kind,
            _listed([name for name, text in done.items() if not text], ", "),
            _listed([f"{name} {text}" for name, text in done.items() if text], "; "),
        )
        for kind, done in kinds.items()
        if done
    ]


def _listed(texts: list[str], separator: str) -> str:
    rest = len(texts) - _MOST_PARTS_LISTED
    more = [f"{rest} more"] if rest > 0 else []
    return separator.join([*texts[:_MOST_PARTS_LISTED], *more])


def _travel(travel: Travel) -> str:
    """Return how far something went, nothing where it held still."""
    if not travel.counts and not travel.stretched:
        return ""
    way = f"{travel.moved:g}" if travel.share is None else f"{travel.share:.0%}"
    return f"{way}, turned {travel.turned:g} rad" if travel.turned else way


def _use(use: ActuatorUse) -> str:
    if not use.force and not use.counts:
        return ""
    control = f"{use.share:.0%}, " if use.share else ""
    saturated = f", saturated {use.saturated:.0%}" if use.saturated else ""
    return f"{control}force {use.force:g}{saturated}"


def _touching(use: PairUse) -> str:
    """Return how long a pair did what, in shares of time."""
    names = ("touched", "stuck", "slid", "rolled", "spun")
    return ", ".join(f"{name} {share:.0%}" for name in names if (share := getattr(use, name)))
