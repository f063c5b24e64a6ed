"""What was found, in words and as the report has it."""

import math
from collections.abc import Iterator

from contactlab.budget.prices import Price
from contactlab.printable import percent
from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.tune_report import Point, TuneReport
from contactlab.studies.search.choice import described
from contactlab.studies.search.searching import SAME

UNJUDGED = "no time was left to judge what is next best"
"""Why the search ended without a verdict."""
_NO_TIME = "no time was left to judge what may"
_TWO_DIGITS = 0.1  # ratios from which on two digits after the point are two


def error_text(error: float | None, unit: str) -> str:
    """Return an error with its unit; a share in percent."""
    if error is None:
        return "unknown"
    return percent(error) if unit == "1" else f"{error:.2e} {unit}"


def price_text(price: Price | BudgetPrice) -> str:
    """Return a ratio of times, with its interval."""
    ratio, low, high = (
        f"{part:.2f}" if part >= _TWO_DIGITS else f"{part:.2g}"
        for part in (price.ratio, price.low, price.high)
    )
    return f"x{ratio} ({low} to {high})"


def is_faster(price: Price | BudgetPrice, twin: Price | BudgetPrice) -> bool:
    """Return whether something takes less time than a model, beyond what its twin does beside it.

    A twin is the model once more, which takes turns with itself: its interval is noise.
    """
    return price.high < min(1.0, twin.low)


def finite(number: float) -> float | None:
    """Return a number, or None for what no JSON has."""
    return float(number) if math.isfinite(number) else None


def settings_text(point: Point, now: Point) -> str:
    """Return the settings of a point in a line, its step among them where it is another."""
    step = {} if point.timestep == now.timestep else {"timestep": point.timestep}
    return described({**step, **point.settings}) or "the model as written"


def unsaved(report: TuneReport) -> str:
    """Return why nothing saves a fifth, of what was tried; empty where something does."""
    now, bare = report.now, report.bare
    if bare is None or now.error is None:
        return ""
    limit = SAME * now.error if now.error > report.aim.limit else report.aim.limit
    known = [one for one in report.points if one.error is not None]
    own = [one for one in known if one.timestep == now.timestep and one.price]
    good = [(one.price.ratio, one) for one in own if one.price and (one.error or 0.0) <= limit]
    parts = [f"x{bare.ratio:.2f} without contacts and all other constraints"]
    if good:
        ratio, best = min(good, key=lambda pair: pair[0])
        parts.append(f"x{min(ratio, 1.0):.2f} at best ({settings_text(best, now)})")
    longer = [one for one in known if one.timestep > now.timestep and (one.error or 0.0) > limit]
    if longer:
        next_one = min(longer, key=lambda one: (one.timestep, one.error))
        error = error_text(next_one.error, report.aim.unit)
        parts.append(f"the next longer that was tried, {next_one.timestep:g} s, has {error}")
    return f"at its own step {', '.join(parts)}"


def sentence_of(report: TuneReport) -> str:
    """Return the answer in a line, from all that a report has else."""
    best, verified = report.recommended, report.verified
    now, rest = error_text(report.now.error, report.aim.unit), list(_beside(report))
    if best and best.price and verified:
        saved = f"{price_text(best.price)} of the time"
        if _beyond(report):
            beyond = f"its error as written is beyond {percent(report.aim.within)}"
            saved = f"{beyond}; what keeps that: {saved}"
        seen = f"{error_text(verified.error, report.aim.unit)} on fresh seeds"
        error = f"error {error_text(best.error, report.aim.unit)}, {seen} (now {now})"
        parts = [f"{saved}, {error}", *rest]
    else:
        parts = [_nothing(report, told_beside=bool(rest)), *rest]
    told = "; ".join(parts)
    return f"{told}; give more with --max-time" if _NO_TIME in told else told


def _nothing(report: TuneReport, *, told_beside: bool) -> str:
    """Say that nothing is recommended, and why."""
    now = error_text(report.now.error, report.aim.unit)
    beyond = _beyond(report) and report.aim.real_time is None
    head = f"error {now}"
    if beyond:
        head = f"its error as written, {now}, is beyond {percent(report.aim.within)}"
    if (likely := _unjudged(report)) and likely.price:
        goal, error = "keep that" if beyond else "be faster", likely.error
        what = f"{settings_text(likely, report.now)}, {price_text(likely.price)} of the time"
        return f"{head}; {_NO_TIME} {goal}: {what}, error {error_text(error, report.aim.unit)}"
    found = "was found in time that " if report.ended else ""
    if beyond:
        return f"{head}, and nothing sound {found}keeps that"
    if told_beside:
        return f"nothing sound {found}is faster at no larger error than now, {now}"
    return f"keep it as it is: {head}, and nothing within the limit {found}is measurably faster"


def _unjudged(report: TuneReport) -> Point | None:
    """Return the fastest point that may be recommended, if no time was left to judge; or None."""
    now = report.now.error
    if now is None or not _is_unjudged(report):
        return None
    failed, beyond = {kept.name for kept in report.kept}, _beyond(report)
    limit = report.aim.within if beyond else max(report.aim.limit, SAME * now)
    found = [
        (one.price.ratio, one)
        for one in report.points
        if one.price
        and (beyond or is_faster(one.price, report.now.price or one.price))
        and (one.error or 0.0) <= limit
        and settings_text(one, report.now) not in failed
    ]
    return min(found, key=lambda pair: pair[0])[1] if found else None


def _is_unjudged(report: TuneReport) -> bool:
    return any(kept.reason == UNJUDGED for kept in report.kept)


def _beyond(report: TuneReport) -> bool:
    error, aim = report.now.error, report.aim
    return aim.unit == "1" and (error is None or error > aim.within)


def _beside(report: TuneReport) -> Iterator[str]:
    """Yield what stands beside what is recommended."""
    aim = report.aim
    if report.as_accurate and report.as_accurate.point.price:
        price = price_text(report.as_accurate.point.price)
        yield f"what is as accurate as now, and no sounder: {price}"
    if report.to_aim and report.to_aim.point.price:
        price = price_text(report.to_aim.point.price)
        limit = error_text(aim.limit, aim.unit)
        why = _hardly(report)
        yield f"as written it misses the aim of {limit}{why}; what keeps it: {price}"
    elif near := report.nearest:
        got = error_text(near.error, aim.unit)
        got += f" at {price_text(near.price)} of the time" if near.price else ", not timed"
        limit = error_text(aim.limit, aim.unit)
        which = f"{settings_text(near, report.now)}, {got}"
        nothing = "nothing was found in time that keeps" if report.ended else "nothing keeps"
        if aim.real_time is not None:
            limit = f"{aim.real_time:g} times real time"
        elif near.error is not None and near.error <= aim.limit:
            if _is_unjudged(report):
                yield f"{_NO_TIME} keep {limit}: {which}"
                return
            limit += " on fresh seeds, too"
        yield f"{nothing} {limit}: nearest is {which}; it binds {report.binds}"


def _hardly(report: TuneReport) -> str:
    """Say where an aim is strict only since the model is uncertain by little."""
    aim, now = report.aim, report.now.error
    if aim.uncertain is None or now is None or aim.uncertain >= aim.limit:
        return ""
    return f" (friction and masses are worth {percent(aim.uncertain)} only)"
