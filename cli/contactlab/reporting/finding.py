"""Finding of a sweep, in one sentence that its table supports."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.reporting.label_shares import ShareWords, exact_share
from contactlab.reporting.report_columns import (
    SEED,
    STABLE,
    Codes,
    GridAxis,
    RunLabels,
    number_with_unit,
)
from contactlab.shares import SURE, unequal_chance


@dataclass(frozen=True)
class _SentenceRules:
    """Numbers that decide which sentence describes the runs."""

    most_values: int = 3
    least_outcome_share: float = 0.5
    # A reader takes in this number of bounds easily.
    few_bounds: int = 2
    # A value of a smaller share of the runs says little.
    least_run_share: float = 0.05


_RULES = _SentenceRules()


class _Words(NamedTuple):
    """An outcome in words: of one run, of all, and as verbs of one run and of several."""

    one: str
    all_of_them: str
    run_does: str
    runs_do: str


_OF_FAILED = _Words("failure", "failures", "fails", "fail")
_OF_STABLE = _Words("stable run", "stable runs", "is stable", "are stable")


def write_headline(labels: RunLabels) -> str:
    """Return how many runs are stable, and which other labels are most frequent."""
    counts = Counter(dict(zip(labels.names, labels.counts, strict=True)))
    stable = counts.pop(STABLE, 0)
    others = [
        f"{count:,} {name}" for name, count in counts.most_common(_RULES.most_values) if count
    ]
    rest = sum(counts.values()) - sum(count for _, count in counts.most_common(_RULES.most_values))
    others += [f"{rest:,} others"] if rest else []
    text = f"{stable:,} of {len(labels.codes):,} runs are stable"
    return f"{text}; {', '.join(others)}" if others else text


def write_finding(
    axes: Sequence[GridAxis], labels: RunLabels, share: ShareWords = exact_share
) -> str:
    """Return where runs are stable, and which axes make no difference to it.

    "Only" says that no other run is stable. An axis makes no difference if that is true for every
    combination of the other axes. Shares are as `share` writes them, with their interval if runs
    are draws.
    """
    failed, runs = labels.failed, len(labels.codes)
    if not failed.any():
        return f"All {runs:,} runs are stable." if runs != 1 else "The run is stable."
    if failed.all():
        place = int(np.argmax(labels.counts))
        return f"No run is stable; {labels.counts[place]:,} of {runs:,} are {labels.names[place]}."
    # The rarer outcome is the easier one to name.
    rare = ~failed if 2 * failed.sum() > runs else failed
    words = _OF_STABLE if rare is not failed else _OF_FAILED
    swept = [axis for axis in axes if axis.name != SEED]
    within = {axis.name: _has_value_of(axis, rare) for axis in swept}
    bound, inside = _find_bounds(swept, within, rare)
    if not bound or rare[inside].mean() < _RULES.least_outcome_share:
        return _sufficient_sentence(swept, rare, words) or _extreme_sentence(
            swept, rare, words.runs_do, share
        )
    parts = [_describe_setting(axis, axis.codes[rare]) for axis in bound]
    if not rare[inside].all():
        counts = int(rare.sum()), int(inside.sum())
        share_text = "" if share is exact_share else f", {share(*counts)}"
        some = f"{counts[0]:,} of {counts[1]:,} such runs{share_text}"
        return f"Every {words.one} has {' and '.join(parts)} ({some})."
    free = [axis.name for axis in swept if within[axis.name].all()]
    rest = f"; {_join_words(free)} {'do' if len(free) > 1 else 'does'} not matter" if free else ""
    return f"Only {' with '.join(parts)} {words.run_does}{rest}."


def _find_bounds(
    axes: Sequence[GridAxis], within: Mapping[str, NDArray[np.bool_]], rare: NDArray[np.bool_]
) -> tuple[list[GridAxis], NDArray[np.bool_]]:
    """Return the axes that bound an outcome, in their order, and the runs within these bounds.

    Axes that follow from others are left out. If other outcomes occur within the bounds too, the
    bounds are as few as describe most of the outcome.
    """
    narrowings: list[tuple[set[str], NDArray[np.bool_]]] = [(set(), np.ones(len(rare), dtype=bool))]
    for _ in axes:
        names, inside = narrowings[-1]
        tightest = min(within, key=lambda name: (within[name] & inside).sum())
        narrowed = inside & within[tightest]
        if narrowed.sum() < inside.sum():
            narrowings.append((names | {tightest}, narrowed))
    enough = (
        bounds
        for bounds in narrowings[_RULES.few_bounds :]
        if rare[bounds[1]].mean() >= _RULES.least_outcome_share
    )
    names, inside = (
        narrowings[-1] if rare[narrowings[-1][1]].all() else next(enough, narrowings[-1])
    )
    return [axis for axis in axes if axis.name in names], inside


def _has_value_of(axis: GridAxis, runs: NDArray[np.bool_]) -> NDArray[np.bool_]:
    # Return (n,) whether each run has a value of the axis that any of some runs has.
    is_among = np.zeros(len(axis.ticks), np.bool_)
    is_among[axis.codes[runs]] = True
    return is_among[axis.codes]


def _sufficient_sentence(axes: Sequence[GridAxis], rare: NDArray[np.bool_], words: _Words) -> str:
    """Return a sentence on values that always lead to an outcome; empty for few runs of it."""
    parts: list[str] = []
    covered_runs = np.zeros(len(rare), dtype=bool)
    pure = {axis.name: ~_has_value_of(axis, ~rare) for axis in axes}
    for axis in sorted(axes, key=lambda axis: -pure[axis.name].sum())[: _RULES.few_bounds]:
        if (pure[axis.name] & ~covered_runs).any():
            parts.append(f"with {_describe_setting(axis, axis.codes[pure[axis.name]])}")
            covered_runs |= pure[axis.name]
    if covered_runs.sum() < _RULES.least_outcome_share * rare.sum():
        return ""
    covered = f"{covered_runs.sum():,} of {rare.sum():,} {words.all_of_them}"
    return f"Every run {', or '.join(parts)} {words.run_does}: {covered}."


def _describe_setting(axis: GridAxis, codes: Codes) -> str:
    """Return an axis with values that have some codes: `a timestep of 2 ms or more`."""
    values = _describe_values(axis, codes)
    if not axis.amount_unit or values.startswith("other"):
        return f"{axis.name} {number_with_unit(values, axis.amount_unit)}"
    number, space, rest = values.partition(" or ")
    amount = f"{number} {axis.unit}{space}{rest}"
    last = rest.rpartition(" ")[2]
    amount += f" {axis.unit}" if space and last not in ("less", "more", "others") else ""
    return f"{'an' if axis.name[0] in 'aeiou' else 'a'} {axis.name.replace('_', ' ')} of {amount}"


def _describe_values(axis: GridAxis, codes: Codes) -> str:
    """Return the values of an axis that have some codes: `0.002 or less`, `a or b`."""
    present_codes = np.flatnonzero(np.bincount(codes)).tolist()
    ticks, last = axis.ticks, len(axis.ticks) - 1
    if (
        axis.is_ordered
        and len(present_codes) > 1
        and present_codes == list(range(present_codes[0], present_codes[-1] + 1))
    ):
        low, high = (
            ticks[present_codes[0]].split(" to ")[0],
            ticks[present_codes[-1]].split(" to ")[-1],
        )
        if present_codes[0] == 0:
            return f"{high} or less"
        return f"{low} or more" if present_codes[-1] == last else f"{low} to {high}"
    if len(present_codes) > max(_RULES.most_values, len(ticks) / 2):
        others = [tick for code, tick in enumerate(ticks) if code not in present_codes]
        if len(others) <= _RULES.most_values:
            return f"other than {_join_words(others, 'or')}"
    present_ticks = [ticks[code] for code in present_codes]
    rest = len(present_ticks) - _RULES.most_values
    return _join_words(
        present_ticks if rest <= 0 else [*present_ticks[: _RULES.most_values], f"{rest} others"],
        "or",
    )


def _join_words(words: Sequence[str], last: str = "and") -> str:
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _extreme_sentence(
    axes: Sequence[GridAxis], rare: NDArray[np.bool_], verb: str, share: ShareWords
) -> str:
    """Return the values of one axis with most and with fewest runs of an outcome.

    The axis with the largest difference is the best of several, so that the chance of it is as many
    times as large.
    """
    shares: list[NDArray[np.float64]] = []
    for axis in axes:
        good, runs = _count_outcomes(axis, rare)
        enough = runs >= _RULES.least_run_share * len(rare)
        shares.append(np.where(enough, good / np.maximum(1, runs), np.nan))
    spreads = [0.0 if np.isnan(e).all() else np.nanmax(e) - np.nanmin(e) for e in shares]
    if not any(spreads):
        return f"{rare.sum():,} of {len(rare):,} runs {verb}."
    axis, axis_shares = axes[int(np.argmax(spreads))], shares[int(np.argmax(spreads))]
    most, least = int(np.nanargmax(axis_shares)), int(np.nanargmin(axis_shares))
    good, runs = _count_outcomes(axis, rare)
    ends = [int(each[place]) for place in (most, least) for each in (good, runs)]
    if unequal_chance(*ends) * len(axes) > 1 - SURE:
        every = f"{rare.sum():,} of {len(rare):,} runs {verb}"
        return f"{every}; no value of an axis has more of them than chance gives it."
    highest, lowest = (share(int(good[place]), int(runs[place])) for place in (most, least))
    return (
        f"{highest} of runs {verb} with {_describe_setting(axis, np.array([most]))}, "
        f"{lowest} with {number_with_unit(axis.ticks[least], axis.unit)}."
    )


def _count_outcomes(
    axis: GridAxis, rare: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (values) the runs with an outcome at each value of an axis, and the runs at it."""
    size = len(axis.ticks)
    return np.bincount(axis.codes[rare], minlength=size), np.bincount(axis.codes, minlength=size)
