"""Rules on a body that should be held."""

from collections.abc import Iterator

from contactlab.measure.context import contact_depths
from contactlab.measure.hold import offsets, window, window_seconds
from contactlab.measure.label import Case, Finding, Findings, first, rows


def exploited(case: Case) -> Findings:
    """Find runs that hold by sinking the holder into what it holds."""
    return _deep(case, "exploited")


def broken(case: Case) -> Findings:
    """Find runs that hold so deep that contact means nothing."""
    return _deep(case, "broken")


def slipping(case: Case) -> Findings:
    """Find runs that lose what they should hold, or let it slip."""
    found: Findings = {}
    for run, finding in (*_lost(case), *_displaced(case), *_slipped(case)):
        found.setdefault(run, finding)
    return found


def _deep(case: Case, name: str) -> Findings:
    limit, depth = case.limits[name], case.metrics["hold_penetration"]
    found: Findings = {}
    for run in rows(depth > limit):
        inside = window(case.context)[run]
        deep = [first((each[run] > limit) & inside) for _, each in contact_depths(case.context)]
        reason = f"held {depth[run]:.3g} m deep on average (limit {limit:g} m)"
        found[run] = Finding(reason, max(deep))
    return found


def _lost(case: Case) -> Iterator[tuple[int, Finding]]:
    limit, share = case.limits["hold_contact"], case.metrics["hold_contact"]
    for run in rows(share < limit):
        reason = f"nothing bore force in {1 - share[run]:.0%} of the time in which it should hold"
        yield run, Finding(reason, first(window(case.context)[run]))


def _displaced(case: Case) -> Iterator[tuple[int, Finding]]:
    limit, offset = case.limits.get("hold_offset"), case.metrics["hold_offset"]
    held = case.context.trace.held
    if limit is None or held is None:
        return
    for run in rows(offset > limit):
        reason = (
            f"it was {offset[run]:.3g} m from its place in the grip when it should be held "
            f"(limit {limit:g} m)"
        )
        yield run, Finding(reason, first(offsets(held)[run] > limit))


def _slipped(case: Case) -> Iterator[tuple[int, Finding]]:
    limit, slip = case.limits["hold_slip"], case.metrics["hold_slip"]
    seconds = window_seconds(case.context)
    for run in rows(slip > limit):
        reason = f"a pair slipped {slip[run]:.3g} m in {seconds[run]:.3g} s (limit {limit:g} m)"
        yield run, Finding(reason, first(window(case.context)[run]))
