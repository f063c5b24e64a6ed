"""Cells of maps against a slow, obvious loop over runs."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import Floats
from contactlab.page import map_cells
from contactlab.page.heatmap import label_rows
from contactlab.page.map_cells import (
    STATISTICS,
    Statistic,
    aggregated_columns,
    cell_statistic,
    label_counts,
    most_frequent_failure,
)
from contactlab.page.page_charts import knob_changes
from contactlab.page.run_series import thin_indices
from contactlab.palette import STABLE_COLOUR
from contactlab.reporting.map_axes import MapAxes, most_informative_axes
from contactlab.reporting.report_columns import GridAxis, Quantity, RunLabels
from contactlab.schema.evidence import LabelFacts
from contactlab.store.table_layout import REAL, Column

NAMES = ("diverged", "chatter", "stable")
SLOW: dict[Statistic, Callable[[Floats], float]] = {
    "worst": lambda values: float(np.abs(values).max()),
    "median": lambda values: float(np.median(values)),
    "mean": lambda values: float(values.mean()),
}


def axis(name: str, codes: list[int], size: int, role: str = "knob") -> GridAxis:
    ticks = tuple(f"{name}{place}" for place in range(size))
    places = np.array(codes, dtype=np.int64)
    return GridAxis(name, "", role, ticks, places, None)  # type: ignore[arg-type]


def run_labels(codes: list[int]) -> RunLabels:
    placed = np.array(codes, dtype=np.int64)
    return RunLabels(
        names=NAMES,
        letters=("D", "C", ""),
        facts=tuple(LabelFacts(colour=colour) for colour in ("#111111", "#222222", STABLE_COLOUR)),
        codes=placed,
        masks=np.zeros(len(placed), dtype=np.int64),
        every=(),
    )


def quantity(values: list[float], better: str = "lower") -> Quantity:
    return Quantity(Column("q", REAL, "m", "", better), np.array(values))


Runs = list[tuple[int, int, int, float]]
runs = st.lists(
    st.tuples(
        st.integers(0, 2),
        st.integers(0, 3),
        st.integers(0, 2),
        st.floats(-1e6, 1e6) | st.just(np.nan),
    ),
    min_size=1,
    max_size=60,
)


@pytest.mark.long
@given(runs)
def test_cells_are_those_of_a_loop(rows: Runs) -> None:
    xs, ys, labels, values = (list(each) for each in zip(*rows, strict=True))
    drawn = MapAxes(axis("x", xs, 3), axis("y", ys, 4))
    counts = label_counts(drawn, run_labels(labels))
    for x in range(3):
        for y in range(4):
            own = [row for row in rows if row[:2] == (x, y)]
            assert counts[y, x].tolist() == [
                sum(row[2] == code for row in own) for code in (0, 1, 2)
            ]
            known = np.array([row[3] for row in own if not np.isnan(row[3])])
            for kind in STATISTICS:
                found = cell_statistic(drawn, quantity(values), kind)[y, x]
                if len(known):
                    assert found == pytest.approx(SLOW[kind](known), rel=1e-9, abs=1e-9)
                else:
                    assert np.isnan(found)


@pytest.mark.long
@given(runs, st.sampled_from(["lower", "higher"]))
def test_aggregated_cells_are_those_of_each_map(rows: Runs, better: str) -> None:
    """In single precision."""
    xs, ys, labels, values = (list(each) for each in zip(*rows, strict=True))
    axes = axis("x", xs, 3), axis("y", ys, 4)
    found = aggregated_columns(axes, run_labels(labels), [quantity(values, better)])
    for name, drawn in {"cells:0:1": MapAxes(*axes), "cells:1:": MapAxes(axes[1], None)}.items():
        counts = label_counts(drawn, run_labels(labels))
        assert found[f"{name}:labels"].tolist() == counts.ravel().tolist()
        for kind in STATISTICS:
            one = cell_statistic(drawn, quantity(values, better), kind).ravel()
            np.testing.assert_allclose(found[f"{name}:q:{kind}"], one, rtol=2.0**-23, atol=1e-9)


@pytest.mark.parametrize("better", ["lower", "higher"])
def test_many_values_are_looked_through_in_parts(
    better: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With ties across the ends of parts, empty cells, one of a single value, and one of half."""
    monkeypatch.setattr(map_cells, "_PART", 16)
    rng = np.random.default_rng(39)
    xs, ys = rng.integers(0, 3, 4000), rng.integers(0, 2, 4000)
    xs[::2], ys[::2], ys[0] = 0, 1, 2
    values = rng.normal(size=4000).round(2)
    axes = axis("x", xs.tolist(), 3), axis("y", ys.tolist(), 3)
    measured = quantity(values.tolist(), better)
    found = aggregated_columns(axes, run_labels([0] * 4000), [measured])
    for (y, x), worst in np.ndenumerate(cell_statistic(MapAxes(*axes), measured, "worst")):
        own, cell = values[(xs == x) & (ys == y)], 3 * y + x
        told = [found[f"cells:0:1:q:{kind}"][cell] for kind in STATISTICS]
        if not len(own):
            assert np.isnan([worst, *told]).all()
            continue
        extreme = own.min() if better == "higher" else np.abs(own).max()
        assert worst == extreme
        expected = [extreme, np.median(own), own.mean()]
        # In single precision; a sum of 4,000 numbers of one is right to 1e-12.
        np.testing.assert_allclose(told, expected, rtol=2.0**-23, atol=1e-12)


def test_the_worst_value_is_the_least_where_higher_is_better() -> None:
    drawn = MapAxes(axis("x", [0, 0, 1], 2), None)
    assert cell_statistic(drawn, quantity([3.0, -1.0, 2.0], "higher"), "worst").tolist() == [
        [-1.0, 2.0]
    ]


@given(runs)
def test_pieces_fill_their_cell_by_fraction(rows: Runs) -> None:
    xs, ys, labels, _ = (list(each) for each in zip(*rows, strict=True))
    drawn = MapAxes(axis("x", xs, 3), axis("y", ys, 4))
    known = run_labels(labels)
    counts = label_counts(drawn, known)
    pieces, letters = label_rows(counts, known)
    for y, x in np.argwhere(counts.any(axis=-1)).tolist():
        own = [each for each in pieces if (int(each["x"]), int(each["y"])) == (x, y)]
        width = sum(each["x2"] - each["x"] for each in own)
        assert width == pytest.approx(0.94, abs=1e-5)
        for each in own:
            fraction = counts[y, x][known.legend.index(each["label"])] / counts[y, x].sum()
            assert (each["x2"] - each["x"]) / width == pytest.approx(fraction, abs=1e-5)
    failures = counts[..., :2]
    failed = (failures.sum(axis=-1) > 0).sum()
    assert failed == (most_frequent_failure(counts, known) >= 0).sum()
    # Failures that fill a quarter of a cell have a letter, and the most frequent one of each cell.
    wide = (failures > 0) & (failures >= 0.25 * counts.sum(axis=-1, keepdims=True))
    assert len(letters) == np.maximum(wide.sum(axis=-1), failures.any(axis=-1)).sum()


def test_the_map_has_the_axes_that_decide_the_label() -> None:
    """A run fails where a and b are both 1; c is random, and d says the same as a."""
    rng = np.random.default_rng(0)
    a, b, c = (rng.integers(0, 2, 400).tolist() for _ in range(3))
    labels = [0 if one and other else 2 for one, other in zip(a, b, strict=True)]
    axes = tuple(axis(name, codes, 2) for name, codes in (("c", c), ("a", a), ("d", a), ("b", b)))
    drawn = most_informative_axes(axes, run_labels(labels))
    assert drawn is not None
    assert drawn.y is not None
    assert {drawn.x.name, drawn.y.name} in ({"a", "b"}, {"d", "b"})


def test_changes_are_of_pairs_that_differ_in_nothing_else() -> None:
    """The last run has no pair; the run that fails at value 1 counts, with the worst ratio."""
    knob, world = [0, 0, 0, 1, 1, 1, 1], [0, 1, 2, 0, 1, 2, 3]
    axes = axis("k", knob, 2), axis("w", world, 4, "scenario")
    values = [1.0, 3.0, 5.0, 1.5, 6.0, 99.0, 7.0]
    (found,) = knob_changes(axes, run_labels([2, 2, 2, 2, 2, 0, 2]), [quantity(values)], 1)
    assert (found.axis, found.pairs, found.failed) == ("k", 3, (0.0, pytest.approx(1 / 3)))
    assert found.ratios["q"] == pytest.approx(2.0)


@given(st.lists(st.floats(-1e9, 1e9) | st.just(np.nan), min_size=1, max_size=2000))
def test_decimated_values_keep_the_extremes(values: list[float]) -> None:
    array = np.array(values)
    places = thin_indices(array, 100)
    assert len(places) <= 102
    assert (np.diff(places) > 0).all()
    if np.isfinite(array).any():
        assert array[places].min() == np.nanmin(array)
        assert array[places].max() == np.nanmax(array)
    else:
        assert len(places) == 0
