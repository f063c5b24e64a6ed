"""Runs of a sweep that only newer engines can do: left out of its plan, and counted."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from contactlab.plan import Plan
from contactlab.scene import LenientCatalogue, why_unsupported
from contactlab.schema import Vocabulary


@dataclass(frozen=True)
class Trimmed:
    """What an engine can do of a plan.

    Attributes:
        plan: the runs that are left.
        reasons: why others are not, each once.
    """

    plan: Plan
    reasons: tuple[str, ...]


def lenient(vocabulary: Callable[[str], Vocabulary]) -> Callable[[str], Vocabulary]:
    """Return vocabularies that know what other versions of the engine know as well."""

    def known(reference: str) -> Vocabulary:
        own = vocabulary(reference)
        return replace(own, axes=LenientCatalogue(own.axes))

    return known


def trimmed(plan: Plan) -> Trimmed:
    """Return a plan without the rows that hold what this engine lacks."""
    if not any(_lacks(name, values) for name, values in _values(plan)):
        return Trimmed(plan, ())
    rows = list(plan.grid.rows())
    reasons = [_reason(row) for row in rows]
    left = tuple(row for row, reason in zip(rows, reasons, strict=True) if reason is None)
    grid = replace(plan.grid, base={}, blocks=None, excludes=(), added=left)
    count = min(plan.count, len(left) * len(plan.sweep.seed_values))
    told = dict.fromkeys(filter(None, reasons))
    return Trimmed(replace(plan, grid=grid, count=count), tuple(told))


def _values(plan: Plan) -> Iterator[tuple[str, Iterable[object]]]:
    yield from ((axis.name, axis.values) for axis in plan.axes)
    yield from ((name, [value]) for name, value in plan.grid.base.items())


def _lacks(name: str, values: Iterable[object]) -> bool:
    return any(why_unsupported(name, value) for value in values)


def _reason(row: Mapping[str, object]) -> str | None:
    found = (why_unsupported(name, value) for name, value in row.items())
    return next((reason for reason in found if reason), None)
