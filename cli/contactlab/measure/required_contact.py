"""Labels of pairs that do not touch as their scene or sweep requires."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK, Floats
from contactlab.contact.trace_setup import ExpectedContact
from contactlab.measure.context import Context, contact_depths, first_step, runs_where
from contactlab.measure.coverage import TURNING
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, Threshold, label
from contactlab.measure.stick_slip import find_spans
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.rendering.amounts import format_amount

_REQUIRED_VERBS = {"sticks": "stick", "slides": "slide", "rolls": "roll"}
MODE_HOLD = Threshold(
    "mode_hold", 0.02, "s", "Shortest that counts; 4 to 24 ms distinguish sliding from sticking."
)

Mask = NDArray[np.bool_]
Faults = Iterator[tuple[str, str, Mask]]
"""The requirement, the observation instead, and the steps (N,) of the observation."""


@label(
    "noted",
    rank=4,
    thresholds=(MODE_HOLD,),
    judged_on=(("requirement_margin", ""),),
    letter="5",
    colour="#b3d789",
    advice="change friction or priority until the pair sticks or slides, or correct `must`",
    traits=("required",),
)
def pair_expectation(runs: MeasuredRuns) -> OnsetIterator:
    """A pair does not press, touch, separate, stick, slide or roll as it must, or is deeper."""
    for stretch in _required_stretches(runs.context, runs.limits["mode_hold"]):
        for faults in (
            _find_wrong_modes(stretch, SLIDE),
            _find_wrong_modes(stretch, STICK),
            _find_mismatches(stretch),
        ):
            for expectation, observation, where in faults:
                step = first_step(where)
                time = runs.context.trace.time[stretch.run, step]
                yield (
                    stretch.run,
                    Onset(f"{expectation}, but {observation}, from {time:.4g} s on", step),
                )


@dataclass(frozen=True)
class _RequiredStretch:
    """The steps (N,) of a run with a requirement of pairs, and the shortest number that counts."""

    context: Context
    expected: ExpectedContact
    run: int
    inside: Mask
    width: int

    @property
    def pairs(self) -> Iterator[tuple[str, int]]:
        """The name and the row of each pair."""
        for pair, row in zip(self.expected.pairs, self._rows.tolist(), strict=True):
            yield self.context.pairs.names[pair], row

    @property
    def _rows(self) -> NDArray[np.intp]:
        return self.context.pairs.rows[[*self.expected.pairs]]

    def forbids(self, mode: int) -> bool:
        """Return whether pairs must not be in a mode."""
        return self.expected.word in ({"slides"} if mode == STICK else {"sticks", "rolls"})

    def in_mode(self, row: int, mode: int) -> Mask:
        """Return (N,) the steps of a pair in a forbidden mode.

        If the requirement is for the first or last mode only, these are the steps until the other
        mode first lasts, or after it last did.
        """
        series = self.context.net.series.mode[row, self.run]
        where = self.inside & (series == mode)
        if self.expected.end:
            other = long_stretches(self.inside & (series == STICK + SLIDE - mode), self.width)
            good = np.flatnonzero(other).tolist()
            if good and self.expected.end == "first":
                where[good[0] :] = False
            elif good:
                where[: good[-1]] = False
        return where

    @cached_property
    def touching(self) -> Mask:
        """(N,) whether any of the pairs touches."""
        modes = self.context.net.series.mode[self._rows, self.run]
        return self.inside & (modes != NO_CONTACT).any(axis=0)

    @property
    def untouched_steps(self) -> Mask:
        """(N,) whether none of the pairs touches although one must."""
        must = self.expected.word in _REQUIRED_VERBS or self.expected.force[0] > 0
        must &= self.expected.has_times or not self.touching.any()
        return self.inside & ~self.touching & must

    def pressed_steps(self, row: int) -> Mask:
        """Return (N,) whether a pair carries force."""
        return self.inside & (self.context.net.series.normal[row, self.run] > 0)

    def unturned_steps(self, row: int) -> Mask:
        """Return (N,) whether a pair sticks and does not turn."""
        still = self.pressed_steps(row) & (self.context.net.rolling[row, self.run] <= TURNING)
        return still & (self.context.net.series.mode[row, self.run] == STICK)

    @property
    def mean_force(self) -> Floats:
        """Means of the total force of the pairs, over the steps that count from each step on [N].

        (N,), NaN at steps that are not judged: without contact, if the requirement has no time.
        """
        series = self.context.net.series.normal
        total = np.sum([series[row, self.run] for _, row in self.pairs], axis=0)
        judged = self.inside if self.expected.has_times else self.touching
        means, spans = np.full(len(total), np.nan), find_spans(judged[None])
        for start, stop in zip(spans.start.tolist(), spans.stop.tolist(), strict=True):
            # All of a shorter stretch.
            size = min(self.width, stop - start)
            sums = np.cumsum([0.0, *total[start:stop]])
            means[start : stop - size + 1] = (sums[size:] - sums[:-size]) / size
        return means

    def depth(self, row: int) -> Floats:
        """Return (N,) the depth of a pair [m], 0 outside of the requirement's time."""
        return np.where(self.inside, contact_depths(self.context)[1][row, self.run], 0)


def _required_stretches(context: Context, hold: float) -> Iterator[_RequiredStretch]:
    time = context.trace.time[:, :-1] + COARSE_ROUNDING * context.trace.timestep[:, None]
    for expected in context.setup.expected:
        if isinstance(expected, ExpectedContact) and expected.pairs:
            start, stop = np.moveaxis(expected.window[:, :, None], 1, 0)
            inside = (time >= start) & (time < stop)
            for run in runs_where(inside.any(axis=1)):
                yield _RequiredStretch(
                    context, expected, run, inside[run], steps_that_count(context, run, hold)
                )


def steps_that_count(context: Context, run: int, hold: float) -> int:
    """Return the number of steps of a run in the shortest time that counts [s]."""
    return max(int(np.ceil(hold / context.trace.timestep[run] - COARSE_ROUNDING)), 1)


def contact_margins(context: Context, hold: float) -> Floats:
    """Return (n,) the least margin of the requirements of pairs; infinite without requirements.

    For modes, a margin is 1 less the longest time [s] in another mode over the shortest that
    counts, `hold`; for forces and depths it is a share of the limit.
    """
    least = np.full(context.trace.runs, np.inf)
    for stretch in _required_stretches(context, hold):
        least[stretch.run] = min(least[stretch.run], *_stretch_margins(stretch), np.inf)
    return least


def _stretch_margins(stretch: _RequiredStretch) -> Iterator[float]:
    word, width = stretch.expected.word, stretch.width
    for mode in (SLIDE, STICK):
        if stretch.forbids(mode):
            for _, row in stretch.pairs:
                yield 1 - longest_stretch(stretch.in_mode(row, mode)) / width
    if stretch.expected.end is not None:
        return
    yield 1 - longest_stretch(stretch.untouched_steps) / width
    for _, row in stretch.pairs:
        if word == "apart":
            time = longest_stretch(stretch.pressed_steps(row))
            yield -time / width if time else 1.0
        elif word == "rolls":
            yield 1 - longest_stretch(stretch.unturned_steps(row)) / width
        elif word == "shallow" and np.isfinite(depth := stretch.depth(row)).all():
            yield 1 - float(depth.max()) / stretch.expected.depth
    if word == "presses" and not np.isnan(force := stretch.mean_force).all():
        low, high = float(np.nanmin(force)), float(np.nanmax(force))
        least, most = stretch.expected.force
        yield (low - least) / (abs(least) or 1) if np.isfinite(least) else np.inf
        yield (most - high) / (abs(most) or 1) if np.isfinite(most) else np.inf


def _find_wrong_modes(stretch: _RequiredStretch, mode: int) -> Faults:
    if not stretch.forbids(mode):
        return
    slips, when = stretch.context.net.series.slip, stretch.expected.end or ""
    for name, row in stretch.pairs:
        where = long_stretches(stretch.in_mode(row, mode), stretch.width)
        if where.any():
            fastest = format_amount(slips[row, stretch.run, where].max(), "mm/s")
            slides = f"slides, at up to {fastest}"
            does = slides if mode == SLIDE else "sticks"
            verb = _REQUIRED_VERBS[stretch.expected.word]
            yield f"{name} should {verb} {when}".rstrip(), does, where


def _find_mismatches(stretch: _RequiredStretch) -> Faults:
    expected, timestep = stretch.expected, stretch.context.trace.timestep[stretch.run]
    word = expected.word
    if expected.end is not None:
        return
    least, most = expected.force
    apart = long_stretches(stretch.untouched_steps, stretch.width)
    if apart.any():
        verb = _REQUIRED_VERBS.get(word, f"press with {least:.3g} N or more")
        observation = f"touches nothing for {np.count_nonzero(apart) * timestep:.3g} s"
        yield f"{expected.name} should {verb}", observation, apart
    for name, row in stretch.pairs:
        if word == "apart" and (pressed := stretch.pressed_steps(row)).any():
            force = stretch.context.net.series.normal[row, stretch.run, pressed].max()
            yield f"{name} should be apart", f"presses with up to {force:.3g} N", pressed
        elif word == "rolls":
            still = long_stretches(stretch.unturned_steps(row), stretch.width)
            if still.any():
                time = np.count_nonzero(still) * timestep
                yield f"{name} should roll", f"does not turn for {time:.3g} s", still
        elif word == "shallow":
            depth = stretch.depth(row)
            if (deep := depth > expected.depth).any():
                observation = f"is up to {format_amount(depth[deep].max(), 'mm')} deep"
                bound = format_amount(expected.depth, "mm")
                yield f"{name} should be at most {bound} deep", observation, deep
    if word != "presses":
        return
    mean = stretch.mean_force
    for beyond, worst, bound in (
        (mean < least, np.fmin, f"{least:.3g} N or more"),
        (mean > most, np.fmax, f"{most:.3g} N or less"),
    ):
        if beyond.any():
            observation = f"presses with {worst.reduce(mean):.3g} N at worst"
            yield f"{expected.name} should press with {bound}", observation, beyond


def long_stretches(mask: Mask, shortest: int) -> Mask:
    """Return (N,) the true steps of a mask that last for at least `shortest` steps."""
    spans, lasting = find_spans(mask[None]), mask.copy()
    for start, stop in zip(spans.start, spans.stop, strict=True):
        lasting[start:stop] = stop - start >= shortest
    return lasting


def longest_stretch(mask: Mask) -> int:
    """Return the largest number of consecutive true steps of a mask (N,)."""
    spans = find_spans(mask[None])
    return int((spans.stop - spans.start).max(initial=0))
