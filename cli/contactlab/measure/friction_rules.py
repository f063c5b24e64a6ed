"""Rules on sticking and sliding, and on the scene's closed form."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.measure.context import Context
from contactlab.measure.label import Case, Finding, Findings, rows
from contactlab.measure.losses import loss_counts, losses
from contactlab.measure.modes import Modes, spans
from contactlab.measure.sliding import changes, switch_counts
from contactlab.trace import NO_CONTACT, SLIDE, STICK, Floats, PairSeries
from contactlab.trace import Mode as ModeName

_SPREAD = 0.25
"""Share of the time in contact that the middle half of chatter's events spans at least."""

_MODES: dict[ModeName, int] = {"stick": STICK, "slide": SLIDE}


def chatter(case: Case) -> Findings:
    """Find runs in which a pair keeps switching between stick and slide, or losing its contact."""
    found: Findings = {}
    for run, finding in (*_switching(case), *_losing(case)):
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
    context, rate = case.context, case.limits["mode_switches"]
    for series, count in zip(context.series, switch_counts(context), strict=True):
        for run in _often(case, count, rate):
            steps = np.flatnonzero(changes(series)[run]) + 1
            if not _lasting(series, run, steps):
                continue
            reason = (
                f"{series.name} switched {count[run]:.0f} times between stick and slide, "
                f"{count[run] / context.seconds[run]:.3g} times a second (limit {rate:g})"
            )
            yield run, Finding(reason, int(steps[0]))


def _losing(case: Case) -> Iterator[tuple[int, Finding]]:
    context, rate = case.context, case.limits["contact_losses"]
    for index, count in enumerate(loss_counts(context)):
        series = context.series[index]
        for run in _often(case, count, rate):
            gaps = losses(context, index)
            steps = gaps.start[gaps.run == run]
            if not _lasting(series, run, steps):
                continue
            reason = (
                f"{series.name} lost its contact {count[run]:.0f} times while it stuck, "
                f"{count[run] / context.seconds[run]:.3g} times a second (limit {rate:g})"
            )
            yield run, Finding(reason, int(steps[0]))


def _often(case: Case, count: Floats, rate: float) -> list[int]:
    often = count / case.context.seconds > rate
    return rows(often & (count >= case.limits["mode_switch_count"]))


def _lasting(series: PairSeries, run: int, steps: NDArray[np.intp]) -> bool:
    """Say whether events go on; parts that tumble to rest switch often, but only for a while."""
    early, late = np.quantile(steps, (0.25, 0.75))
    return bool(late - early >= _SPREAD * (series.mode[run] != NO_CONTACT).sum())


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
