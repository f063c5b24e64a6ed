"""Sentences of a tune report."""

import math
from collections.abc import Iterator

from contactlab.rendering.amounts import format_above, format_amount, format_percent
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.tune_report import Candidate, TuneReport
from contactlab.studies.search.configuration import format_settings
from contactlab.studies.search.settings_search import EQUAL_ERROR_RATIO, SURE_COST

UNVERIFIED = "no time was left to verify the next candidate"
"""Why the search ended without a verdict."""
_NOT_VERIFIED = "No time was left to verify"
_MORE_TIME = "Allow more with --max-cpu."


def error_text(error: float | None, unit: str, tolerance: float = math.inf) -> str:
    """Return an error with its unit; a share in percent, with digits above a tolerance."""
    if error is None:
        return "unknown"
    if unit != "1":
        return f"{error:.2e} {unit}"
    return format_above(error, tolerance) if error > tolerance else format_percent(error)


def find_error(report: TuneReport, mark: str = "as written") -> float | None:
    """Return the error of a marked point, as the table of the front has it."""
    for point in report.front:
        if mark in point.marks:
            return point.error
    if mark == "as written" or report.recommended is None:
        return report.current.error
    return report.recommended.error


def counts_as_equal(report: TuneReport) -> bool:
    """Return whether the error as written is below the limit, so that larger ones equal it."""
    own, target = report.current.error, report.target
    return target.kind == "as written" and own is not None and own < target.limit


def _limit_text(report: TuneReport) -> str:
    return error_text(report.target.limit, report.target.unit)


def settings_text(candidate: Candidate, current: Candidate) -> str:
    """Return the settings of a candidate in a line, with its timestep if that was changed."""
    step = {} if candidate.timestep == current.timestep else {"timestep": candidate.timestep}
    return format_settings({**step, **candidate.settings}) or "the model as written"


def no_speedup_text(report: TuneReport) -> str:
    """Explain why no tested change saves 20 %; empty if one does."""
    current, unconstrained = report.current, report.unconstrained_cost
    if unconstrained is None or current.error is None:
        return ""
    limit = max(report.target.limit, EQUAL_ERROR_RATIO * current.error)
    measured_candidates = [one for one in report.candidates if one.error is not None]
    same_step = [one for one in measured_candidates if one.timestep == current.timestep]
    good = [
        (one.cost, one) for one in same_step if one.cost is not None and (one.error or 0.0) <= limit
    ]
    parts = [f"x{unconstrained:.2f} without contacts and other constraints"]
    if good:
        ratio, best = min(good, key=lambda pair: pair[0])
        parts.append(f"x{min(ratio, 1.0):.2f} at best ({settings_text(best, current)})")
    longer = [
        one
        for one in measured_candidates
        if one.timestep > current.timestep and (one.error or 0.0) > limit
    ]
    if longer:
        next_one = min(longer, key=lambda one: (one.timestep, one.error))
        parts.append(f"the next longer timestep, {next_one.timestep:g} s, is less accurate")
    return f"work at the same timestep: {', '.join(parts)}"


def sentence_of(report: TuneReport) -> str:
    """Return the result in a few sentences."""
    best, verified, target = report.recommended, report.verified, report.target
    current = error_text(find_error(report), target.unit, target.tolerance)
    options = list(_extra_options(report))
    if best and best.time_ratio and verified:
        own = error_text(find_error(report, "recommended"), target.unit, target.tolerance)
        change = f"error {own}, as before" if own == current else f"error {own}, not {current}"
        if own != current and counts_as_equal(report):
            change = f"error {own}, {current} as written (equal below {_limit_text(report)})"
        elif own != current and _is_within_seeds(report):
            change = f"error {own}, {current} as written; its interval has both"
        change = "the same motion" if best.exact else change
        head = f"Recommended: {_time_text(best.time_ratio, best.cost)}, {change}."
        if _is_above_tolerance(report):
            limit = format_percent(target.tolerance)
            head = f"The error as written is above the tolerance of {limit}. {head}"
    else:
        head = no_recommendation_text(report, has_options=bool(options))
        if _NOT_VERIFIED in head:
            options = [option for option in options if _NOT_VERIFIED not in option]
    text = " ".join([head, *options])
    return f"{text} {_MORE_TIME}" if _NOT_VERIFIED in text else text


def _time_text(ratio: TimeRatio, cost: float | None) -> str:
    # If the interval of the time includes 1, only counted work shows the saving.
    if cost is None or not ratio.low <= 1 <= ratio.high:
        return f"{ratio.text} time"
    return f"{format_amount(cost, 'x')} work, {ratio.text} time, which is within noise"


def _is_within_seeds(report: TuneReport) -> bool:
    # Whether the interval of the recommended error has the error as written.
    current = find_error(report)
    return current is not None and any(
        (point.error_low or 0.0) <= current <= (point.error_high or 0.0)
        for point in report.front
        if "recommended" in point.marks
    )


def no_recommendation_text(report: TuneReport, *, has_options: bool) -> str:
    """Say that no change is recommended, and why."""
    unit = report.target.unit
    current = error_text(find_error(report), unit, report.target.tolerance)
    above = _is_above_tolerance(report) and report.target.real_time is None
    error = f"{'Numerical error' if unit == '1' else 'Forward error'} is {current}"
    if above:
        error += f", above the tolerance of {format_percent(report.target.tolerance)}"
    if likely := _unverified_candidate(report):
        goal = "within the tolerance" if above else "faster"
        settings = settings_text(likely, report.current)
        return (
            f"{error}. {_NOT_VERIFIED} a candidate that may be {goal}: {settings}, x"
            f"{likely.cost:.2g} work."
        )
    tested = _tested_text(report)
    if above:
        return f"{error}, and no {tested} that is numerically accurate is within it."
    if has_options:
        limit = _limit_text(report) if counts_as_equal(report) else f"{current}, as written"
        return f"No accurate {tested} is faster with an error of at most {limit}."
    least_saving = format_percent(1 - SURE_COST)
    end = f"saves {least_saving} of the work without making something worse"
    return f"No change recommended. {error}, and no {tested} {end}."


def _unverified_candidate(report: TuneReport) -> Candidate | None:
    """Return the fastest candidate that may be recommended, if time was short; or None."""
    current = report.current.error
    if current is None or not _has_unverified(report):
        return None
    rejected, above = {skipped.name for skipped in report.not_changed}, _is_above_tolerance(report)
    limit = report.target.tolerance
    if not above:
        limit = max(report.target.limit, EQUAL_ERROR_RATIO * current)
    unverified = [
        (one.cost, one)
        for one in report.candidates
        if one.cost is not None
        and (above or one.cost <= SURE_COST)
        and (one.error or 0.0) <= limit
        and settings_text(one, report.current) not in rejected
    ]
    return min(unverified, key=lambda pair: pair[0])[1] if unverified else None


def _has_unverified(report: TuneReport) -> bool:
    return any(skipped.reason == UNVERIFIED for skipped in report.not_changed)


def _is_above_tolerance(report: TuneReport) -> bool:
    error, target = report.current.error, report.target
    return target.unit == "1" and (error is None or error > target.tolerance)


def _extra_options(report: TuneReport) -> Iterator[str]:
    """Yield sentences on the candidates besides the recommended one."""
    target = report.target
    limit = error_text(target.limit, target.unit)
    if report.equal_error and report.equal_error.candidate.time_ratio:
        ratio = report.equal_error.candidate.time_ratio.text
        yield f"Equally accurate as written, with the same verdict: {ratio} time."
    if closest := report.closest:
        which = f"{settings_text(closest, report.current)}, error "
        which += error_text(closest.error, target.unit, target.tolerance)
        which += "" if closest.cost is None else f" at x{closest.cost:.2g} work"
        tested = _tested_text(report)
        goal = f"the target of {limit}"
        if target.real_time is not None:
            goal = f"the target of {target.real_time:g}x real time"
        elif closest.error is not None and closest.error <= target.limit:
            if _has_unverified(report):
                yield f"{_NOT_VERIFIED} a candidate for {goal}: {which}."
                return
            goal += " on fresh seeds as well"
        factor = f"; limiting factor: {report.limiting_factor}" if report.limiting_factor else ""
        yield f"No {tested} meets {goal}. Closest: {which}{factor}."


def _tested_text(report: TuneReport) -> str:
    return "tested setting" if report.ended == "complete" else "setting that was tested"


def ending_text(report: TuneReport) -> str:
    """Return the number of trials, and the reason of their end."""
    count = f"{report.trials} trials"
    match report.ended:
        case "complete":
            return f"{count}; nothing was left to try"
        case "work":
            return f"{count}; ended by the work that {report.max_cpu:g} s allow"
        case "time":
            return f"ended early after {report.trials} of {report.planned_trials} trials"
