"""What a run exercised, in words: first what did not move, act or touch, then what did."""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from contactlab.schema.coverage import ActuatorUse, Coverage, PairUse, Travel

_MOST = 4


class CoverageRow(NamedTuple):
    """Parts of one kind: those that a run left alone, and what the others did."""

    kind: str
    idle: str
    used: str


def coverage_rows(coverage: Coverage, pairs: Iterable[str]) -> list[CoverageRow]:
    """Return the rows of the kinds that the model has.

    Args:
        coverage: of the run.
        pairs: every monitored pair.
    """
    parts = {**coverage.joints, **coverage.tendons}
    limited = {name: each for name, each in parts.items() if each.share is not None}
    kinds = {
        "joints moved": {name: _travel(each) for name, each in coverage.joints.items()},
        "limits reached": {name: ", ".join(each.ends) for name, each in limited.items()},
        "tendons moved": {name: _travel(each) for name, each in coverage.tendons.items()},
        "actuators used": {name: _use(each) for name, each in coverage.actuators.items()},
        "equalities loaded": {
            name: f"{load:g}" if load else "" for name, load in coverage.equalities.items()
        },
        "pairs touched": {
            name: _contact(coverage.pairs[name]) if name in coverage.pairs else "" for name in pairs
        },
    }
    return [_row(kind, done) for kind, done in kinds.items() if done]


def _row(kind: str, done: Mapping[str, str]) -> CoverageRow:
    idle = [name for name, text in done.items() if not text]
    used = [f"{name} {text}" for name, text in done.items() if text]
    return CoverageRow(kind, _listed(idle, ", "), _listed(used, "; "))


def _listed(texts: list[str], separator: str) -> str:
    rest = len(texts) - _MOST
    more = [f"{rest} more"] if rest > 0 else []
    return separator.join([*texts[:_MOST], *more])


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


def _contact(use: PairUse) -> str:
    """Return how long a pair did what, in shares of time."""
    return ", ".join(_shares(use))


def _shares(use: PairUse) -> Iterator[str]:
    for name in ("touched", "stuck", "slid", "rolled", "spun"):
        if share := getattr(use, name):
            yield f"{name} {share:.0%}"
