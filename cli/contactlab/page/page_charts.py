"""The charts of a page besides its map: labels, accuracy and time, a run, changes by knobs."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import prod

import altair as alt
import numpy as np

from contactlab.charts import (
    Rows,
    Spec,
    apply_theme,
    layer_of,
    with_page_colours,
)
from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK, Floats
from contactlab.page.heatmap import Layered, label_map, number_map
from contactlab.palette import COLOURS, INK
from contactlab.pareto.convergence import MethodKey, method_key
from contactlab.pareto.tradeoff_chart import chart_specification
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import (
    Codes,
    GridAxis,
    Quantity,
    RunLabels,
    combination_codes,
)

MODE_NAMES = {NO_CONTACT: "no contact", STICK: "stick", SLIDE: "slide"}


def chart_templates(data: ReportData, tradeoff: Spec | None) -> dict[str, Spec]:
    """Return the specifications that a page's script fills with data, in the page's colours."""
    templates = {
        "labels": apply_theme(label_map(None, data.labels).to_dict(validate=False)),
        "number": apply_theme(number_map(None, np.empty((0, 0)), "").to_dict(validate=False)),
        "tradeoff": tradeoff,
    }
    return {name: with_page_colours(spec) for name, spec in templates.items() if spec is not None}


def tradeoff_chart(data: ReportData) -> Spec | None:
    """Return accuracy against time; None if the store lacks one of them.

    If there are very many configurations, it shows the best methods and a sample of the others.
    """
    report = data.tradeoff
    configurations = report.configurations if report else ()
    if report is None or all(
        configuration.time is None or configuration.error is None
        for configuration in configurations
    ):
        return None
    # Altair would hold every configuration against its schema.
    # Whole methods are drawn, those of the fronts before others.
    by_method: dict[MethodKey, list[int]] = {}
    for place, configuration in enumerate(report.configurations):
        by_method.setdefault(method_key(configuration.configuration), []).append(place)
    recommended = [pick for pick in (report.recommendation, report.robust) if pick is not None]
    best = (*recommended, *report.front, *report.unconstrained_front)
    best_methods = (method_key(configuration.configuration) for configuration in best)
    # The others in an order that samples all of them evenly.
    keys, stride = list(by_method), max(1, len(by_method) // 64)
    others = (key for start in range(stride) for key in keys[start::stride])
    places: list[int] = []
    most_configurations = 600
    for key in dict.fromkeys((*best_methods, *others)):
        if len(places) < most_configurations:
            places += by_method[key]
    return apply_theme(chart_specification(report, set(places)).to_dict(validate=False))


@dataclass(frozen=True)
class KnobChange:
    """One knob from one value to another, over the pairs of runs that differ in nothing else.

    `failed` has the failed fractions before and after. The ratios are, by quantity, the median of
    after over before; None if no pair has two positive values. Failed runs count: a comparison of
    the runs that survive a longer step would show how little the survivors suffer.
    """

    axis: str
    before: str
    after: str
    pairs: int
    failed: tuple[float, float]
    ratios: dict[str, float | None]


def knob_changes(
    axes: Sequence[GridAxis], labels: RunLabels, quantities: Iterable[Quantity], most: int
) -> list[KnobChange]:
    """Return every knob's values against its first, if runs can be matched.

    Ratios are those of the first quantities with any, at most `most`.
    """
    most_values = 12
    knobs = [axis for axis in axes if axis.role == "knob" and len(axis.ticks) <= most_values]
    pairs = [knob_change for axis in knobs for knob_change in _changes_of(axis, axes, labels)]
    count = 0
    for quantity in quantities if pairs else ():
        ratios = [_median_ratio(*(quantity.values[rows] for rows in both)) for _, both in pairs]
        if any(ratio is not None for ratio in ratios):
            for (change, _), ratio in zip(pairs, ratios, strict=True):
                change.ratios[quantity.name] = ratio
            count += 1
        if count == most:
            break
    return [change for change, _ in pairs]


def _changes_of(
    axis: GridAxis, axes: Sequence[GridAxis], labels: RunLabels
) -> Iterator[tuple[KnobChange, tuple[Codes, Codes]]]:
    """Yield changes, each with the rows (m,) of its pairs, before and after."""
    shared = [other for other in axes if other is not axis]
    others, size = (
        combination_codes(shared, len(axis.codes)),
        prod(len(each.ticks) for each in shared),
    )
    if size > 4 * len(others):  # most combinations have no run
        combinations, others = np.unique(others, return_inverse=True)
        size = len(combinations)
    others = others.astype(np.min_scalar_type(size))

    def first_runs(code: int) -> Codes:
        """Return (size,) the first run of each combination that has this value, otherwise -1."""
        rows = np.flatnonzero(axis.codes == code).astype(np.int32)[::-1]
        first = np.full(size, -1, np.int32)
        # The last assignment of equal combinations stays.
        first[others[rows]] = rows
        return first

    base, failed, earlier = first_runs(0), labels.failed, np.empty(0, np.int32)
    for code in range(1, len(axis.ticks)):
        runs = first_runs(code)
        has_both = (base >= 0) & (runs >= 0)
        before, after = base[has_both], runs[has_both]
        if len(before):
            shares = float(failed[before].mean()), float(failed[after].mean())
            ticks = axis.ticks[0], axis.ticks[code]
            change = KnobChange(axis.title, *ticks, len(before), shares, {})
            # In a grid, all changes of an axis begin at the same runs.
            earlier = earlier if np.array_equal(before, earlier) else before
            yield change, (earlier, after)


def _median_ratio(before: Floats, after: Floats) -> float | None:
    positive = (before > 0) & (after > 0)
    if not positive.any():
        return None
    return float(np.median(after[positive] / before[positive]))


def change_panels(changes: Sequence[KnobChange], names: Sequence[str]) -> Spec:
    """Return bars of the factor of each change for each quantity."""
    rows: Rows = [
        {
            "change": f"{change.axis}  {change.before} → {change.after}",
            "name": name,
            "ratio": ratio,
            "one": 1.0,
            "text": f"x {ratio:.3g}",
            # Right of bar and rule, where no tick label is.
            "end": max(ratio, 1.0),
        }
        for change in changes
        for name in names
        if (ratio := change.ratios.get(name)) is not None
    ]
    order = list(dict.fromkeys(row["change"] for row in rows))
    rows_by_name = {
        name: own for name in names if (own := [row for row in rows if row["name"] == name])
    }
    panels = [
        _ratio_bars(own, name, order, is_first=name == names[0])
        for name, own in rows_by_name.items()
    ]
    return alt.hconcat(*panels, spacing=26).to_dict()


def _ratio_bars(rows: Rows, name: str, order: list[str], *, is_first: bool) -> Layered:
    sizes = [row["ratio"] for row in rows]
    margin = 3.0
    domain = [min(*sizes, 1.0) / margin, max(*sizes, 1.0) * margin]
    x = alt.X("ratio:Q").scale(type="log", domain=domain, nice=False)
    x = x.axis(title=f"{name}, after / before", format="~g", tickCount=5)
    y = alt.Y("change:N").scale(domain=order).axis(title=None, labelLimit=260, labels=is_first)
    colour = alt.condition("datum.ratio >= 1", alt.value(COLOURS[1]), alt.value(COLOURS[0]))
    base = layer_of(f"changes {name}", rows)
    bars = base.mark_bar(height=13).encode(x, y, x2="one:Q", color=colour)
    texts = base.mark_text(fontSize=11, color=INK, align="left", dx=5)
    end = alt.X("end:Q").scale(type="log", domain=domain, nice=False)
    texts = texts.encode(end, y, text="text:N")
    one = base.mark_rule(color=INK).encode(alt.X("one:Q").scale(type="log", domain=domain))
    return alt.layer(bars, one, texts).properties(width=240, height={"step": 22})
