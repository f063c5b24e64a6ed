"""Rules on bodies that should stay where they were put."""

from contactlab.measure.context import Context, speed_squared
from contactlab.measure.label import Case, Finding, Findings, first, rows
from contactlab.measure.rest import moved


def drift(case: Case) -> Findings:
    """Find runs in which a body ends farther from its start than the scene accepts."""
    found, limit = case.metrics["drift"], case.limits.get("drift")
    if limit is None:
        return {}
    return {
        run: Finding(
            f"a body ended {found[run]:.3g} m away from its start (limit {limit:g} m)",
            _away_from(case.context, run, limit),
        )
        for run in rows(found > limit)
    }


def creep(case: Case) -> Findings:
    """Find runs in which a pair that sticks slips faster than the scene accepts."""
    found, limit = case.metrics["creep_speed"], case.limits.get("creep_speed")
    if limit is None:
        return {}
    return {
        run: Finding(
            f"a pair that sticks slips at {found[run]:.3g} m/s (limit {limit:g} m/s)",
            case.context.tail.start,
        )
        for run in rows(found > limit)
    }


def unsettled(case: Case) -> Findings:
    """Find runs in which a body still moves in the last fifth, where all should rest."""
    found, limit = case.metrics["rest_speed"], case.limits.get("rest_speed")
    if limit is None:
        return {}
    return {
        run: Finding(
            f"a body moved at {found[run]:.3g} m/s in the last fifth (limit {limit:g} m/s)",
            _moving_from(case.context, run, limit),
        )
        for run in rows(found > limit)
    }


def _away_from(context: Context, run: int, limit: float) -> int:
    """Return the first step after which some free body is as far away as that."""
    steps = [first(moved(context, body, run) > limit) for body in context.setup.free_bodies]
    return min(step - 1 for step in steps if step > 0)


def _moving_from(context: Context, run: int, limit: float) -> int:
    """Return the first step of the last fifth after which some free body is as fast as that."""
    start = context.tail.start
    fast = [
        speed_squared(context, body)[run, start + 1 :] > limit**2
        for body in context.setup.free_bodies
    ]
    return start + min(first(each) for each in fast if each.any())
