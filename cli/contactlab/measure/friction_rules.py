"""Rules on sticking and sliding, and on the scene's closed form."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import NO_CONTACT, SLIDE, STICK, Floats, PairSeries
from contactlab.contact import SlipMode as ModeName
from contactlab.measure.context import Context
from contactlab.measure.hold import hold_switch_masks, window, window_seconds
from contactlab.measure.label import Case, Finding, Findings, rows
from contactlab.measure.losses import all_losses
from contactlab.measure.modes import Modes, spans
from contactlab.measure.sliding import switch_masks

_SPREAD = 0.25
"""Share of the time in contact that the middle half of chatter's events spans at least."""

Events = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Runs and steps of events, in order of run and time."""

_MODES: dict[ModeName, int] = {"stick": STICK, "slide": SLIDE}


def chatter(case: Case) -> Findings:
    """Find runs in which a pair keeps switching between stick and slide, or losing its contact."""
    held = case.context.setup.hold is not None
    events = _holding(case) if held else (*_switching(case), *_losing(case))
    found: Findings = {}
    for run, finding in events:
        found.setdefault(run, finding)
    return found


def unexpected_slide(case: Case) -> Findings:
    """Find runs in which a pair slides first or last, where the scene says it sticks."""
    return _unexpected(case, "stick", "slide")


def unexpected_stick(case: Case) -> Findings:
    """Find runs in which a pair sticks first or last, where the scene says it slides."""
    return _unexpected(case, "slide", "stick")


def oracle_miss(case: Case) -> Findings:
    """Find runs that are too far from the scene's closed form, or give nothing to measure."""
    setup, metrics = case.context.setup, case.metrics
    error = metrics["oracle_error"]
    unmet = np.isfinite(metrics["oracle_expected"]) & np.isnan(metrics["oracle_measured"])
    unmet &= np.isfinite(setup.oracle_tolerance)
    return {
        run: Finding(
            f"{setup.oracle}: expected {metrics['oracle_expected'][run]:.4g}, measured "
            f"{metrics['oracle_measured'][run]:.4g}, error {error[run]:.3g} "
            f"(limit {setup.oracle_tolerance:g})",
            case.context.trace.steps - 1,
        )
        for run in rows(unmet | (error > setup.oracle_tolerance))
    }


def _switching(case: Case) -> Iterator[tuple[int, Finding]]:
    context = case.context
    for series, mask in zip(context.series, switch_masks(context), strict=True):
        run, step = np.nonzero(mask)
        what = f"{series.name} switched {{}} times between stick and slide"
        yield from _often(case, series, (run, step + 1), what, "mode_switches")


def _losing(case: Case) -> Iterator[tuple[int, Finding]]:
    context = case.context
    for series, gaps in zip(context.series, all_losses(context), strict=True):
        what = f"{series.name} lost its contact {{}} times while it stuck"
        yield from _often(case, series, (gaps.run, gaps.start), what, "contact_losses")


def _holding(case: Case) -> Iterator[tuple[int, Finding]]:
    context = case.context
    for series, mask in zip(context.series, hold_switch_masks(context), strict=True):
        run, step = np.nonzero(mask)
        what = f"{series.name} switched {{}} times between stick, slide and no contact in its hold"
        yield from _often(case, series, (run, step + 1), what, "mode_switches")


def _often(
    case: Case, series: PairSeries, events: Events, what: str, threshold: str
) -> Iterator[tuple[int, Finding]]:
    """Find runs with too many events a second that do not end as the run settles."""
    limit, fewest = case.limits[threshold], case.limits["mode_switch_count"]
    judged, seconds = _judged(case.context)
    counts = np.bincount(events[0], minlength=case.context.trace.runs)
    for run in rows((counts / seconds > limit) & (counts >= fewest)):
        steps = events[1][events[0] == run]
        touching = (series.mode[run] != NO_CONTACT) & judged[run]
        if _is_lasting(steps, int(touching.sum())):
            rate = counts[run] / seconds[run]
            reason = f"{what.format(counts[run])}, {rate:.3g} times a second (limit {limit:g})"
            yield run, Finding(reason, int(steps[0]))


def _judged(context: Context) -> tuple[NDArray[np.bool_], Floats]:
    """Return (n, N) the steps in which chatter is judged, and (n,) how long they last [s]."""
    if context.setup.hold is not None:
        return window(context), window_seconds(context)
    return np.ones(context.trace.contacts.shape, dtype=np.bool_), context.seconds


def _is_lasting(steps: NDArray[np.intp], touching: int) -> bool:
    """Say whether events go on; parts that tumble to rest switch often, but only for a while."""
    early, late = np.quantile(steps, (0.25, 0.75))
    return bool(late - early >= _SPREAD * touching)


def _unexpected(case: Case, wanted: ModeName, met: ModeName) -> Findings:
    setup, found = case.context.setup, Findings()
    for when, mode in (("first", setup.first_mode), ("last", setup.last_mode)):
        if mode != wanted:
            continue
        for series in case.context.series:
            established = _established(series.mode, case.context, case.limits["mode_hold"])
            for run, (opening, closing) in established.items():
                shown, step = opening if when == "first" else closing
                if shown == _MODES[met]:
                    reason = f"{series.name} should {wanted} {when}, but does {met}"
                    found.setdefault(run, Finding(reason, step))
    return found


def _established(
    mode: Modes, context: Context, hold: float
) -> dict[int, tuple[tuple[int, int], tuple[int, int]]]:
    """Return by run the first and the last mode held for `hold` [s], each with its first step."""
    shortest = np.ceil(hold / context.trace.timestep - 1e-6)
    held = sorted(
        (int(run), int(start), value)
        for value in (STICK, SLIDE)
        for run, start, stop in zip(*_stretches(mode == value), strict=True)
        if stop - start >= shortest[run]
    )
    found: dict[int, tuple[tuple[int, int], tuple[int, int]]] = {}
    for run, start, value in held:
        opening = found[run][0] if run in found else (value, start)
        found[run] = opening, (value, start)
    return found


def _stretches(mask: NDArray[np.bool_]) -> tuple[list[int], list[int], list[int]]:
    found = spans(mask)
    return found.run.tolist(), found.start.tolist(), found.stop.tolist()
