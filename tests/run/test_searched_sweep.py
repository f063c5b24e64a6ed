"""A search finds the worst run of a grid by a part of its runs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import contactlab
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SweepFileError
from contactlab.plan.rows import listed_values
from contactlab.plan.search import Trials, axis_coordinates
from contactlab.reporting.chosen_runs import worst_lines
from contactlab.run.recomputed_runs import recomputed_problems
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

SIDE = 25
GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, SIDE)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
WHOLE: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.3,
    "axes": {
        "drop_height": {"linspace": [0.05, 0.3, 9]},
        "solref.timeconst": {"logspace": [0.005, 0.02, 9]},
    },
    "trace": "none",
    "checks": "none",
    "effects": "all",
}


def found(
    values: Floats, most: int, points: Floats = GRID, sign: float = -1.0, batch: int = 0
) -> dict[int, float | None]:
    """Return what is measured in the end, of trials that finish `batch` at a time."""
    search, measured = Trials(points, sign, most), dict[int, float | None]()
    while trials := search.next_points(measured):
        assert not measured.keys() & set(trials)
        for trial in trials[: batch or None]:
            measured[trial] = None if np.isnan(values[trial]) else float(values[trial])
    return measured


def best(measured: dict[int, float | None], sign: float = -1.0) -> float:
    return -sign * max(-sign * value for value in measured.values() if value is not None)


@settings(max_examples=4)
@given(centre=st.tuples(st.floats(0, 1), st.floats(0, 1)), width=st.floats(0.15, 1))
def test_a_peak_is_found_within_100_trials(centre: tuple[float, float], width: float) -> None:
    """To 5 % of its height: one point of the plane has that, or its neighbours do.

    A Gaussian falls by 5 % within .23 of its width, .034 at least, and points are 1/24 apart, so
    that the nearest is at most .030 away.
    """
    values = np.exp(-((GRID - np.array(centre)) ** 2).sum(axis=1) / width**2)
    measured = found(values, 100)
    assert len(measured) <= 100
    assert best(measured) >= 0.95 * values.max()


@pytest.mark.parametrize("corner", range(4))
def test_what_grows_along_all_axes_is_found_in_its_corner(corner: int) -> None:
    """A sharp peak in a corner, which spans one point of the 25 x 25: corners are tried first."""
    peak = np.array([(corner & 1), (corner >> 1)], float)
    values = np.exp(-(((GRID - peak) * 3 * SIDE) ** 2).sum(axis=1))
    assert best(found(values, 10)) == 1


@settings(max_examples=4)
@given(level=st.floats(0.4, 0.9), slope=st.floats(-0.3, 0.3))
def test_what_ends_at_a_cliff_is_followed_to_it(level: float, slope: float) -> None:
    """Values grow up to a line, beyond which nothing can be measured: the largest lie along it.

    A descent needs no more than that points without a value are worse than any. Each value is a
    24th, so that 5 % are one step, and three for a cliff that is met aslant.
    """
    across, along = GRID.T
    edge = level + slope * (along - 0.5)
    values = np.where(across < edge, 1 + across, np.nan)
    assert best(found(values, 100)) >= np.nanmax(values) - 1 / (SIDE - 1) - 1e-9


def test_all_points_of_a_small_plan_are_tried() -> None:
    """Once descents have ended, the sequence goes on."""
    measured = found(np.zeros(9), 40, np.linspace(0, 1, 9)[:, None])
    assert measured.keys() == set(range(9))


def test_neither_interruption_nor_order_changes_the_trials() -> None:
    values = np.sin(7 * GRID).sum(axis=1)
    at_once = found(values, 60)
    assert found(values, 60, batch=1).keys() == at_once.keys()
    assert len(at_once) == 60


def test_two_descents_go_on_side_by_side() -> None:
    """After the first trials, most rounds have one of each; where both ask the same, one waits."""
    values, rounds = np.sin(7 * GRID).sum(axis=1), list[int]()
    search, measured = Trials(GRID, -1.0, 60), dict[int, float | None]()
    while trials := search.next_points(measured):
        rounds.append(len(trials))
        measured |= {trial: float(values[trial]) for trial in trials}
    assert rounds[0] == 24
    assert set(rounds[1:]) <= {1, 2}
    assert rounds.count(2) > len(rounds) / 2


def test_what_goes_on_begins_anew() -> None:
    """Another search that knows some of it, and more besides, tries the same in the end."""
    values = np.sin(7 * GRID).sum(axis=1)
    at_once = found(values, 60)
    known = dict[int, float | None]((place, float(values[place])) for place in [*at_once][:47])
    known |= {600: float(values[600])}
    again = Trials(GRID, -1.0, 60)
    while trials := again.next_points(known):
        known |= {trial: float(values[trial]) for trial in trials}
    assert known.keys() == at_once.keys() | {600}


def test_what_cannot_be_measured_is_no_worst() -> None:
    values = np.where(GRID[:, 0] > 0.5, np.nan, GRID[:, 0])
    measured = found(values, 40, sign=1.0)
    assert len(measured) == 40
    assert best(measured, 1.0) < 0.05


def test_coordinates_span_an_axis() -> None:
    sweep = Sweep.model_validate(
        {
            "version": 1,
            "scene": "?",
            "axes": {
                "a": {"linspace": [2, 4, 5]},
                "b": {"uniform": [1, 3]},
                "c": {"loguniform": [1, 100]},
                "d": [3, 7, 9],
            },
        }
    )
    cases = {"a": (2, 3.5, 4), "b": (1, 2.5, 3), "c": (1, 10**1.5, 100)}
    for name, values in cases.items():
        place = axis_coordinates(
            sweep.axes[name], listed_values(sweep.axes[name]) if name == "a" else ()
        )
        assert [place(value) for value in values] == pytest.approx([0, 0.75, 1])
    assert axis_coordinates(sweep.axes["d"], (3, 7, 9))(7) == 0.5


def worst(store: Store) -> float:
    return max(store.columns.to_pydict(["penetration_max"])["penetration_max"])


def test_the_deepest_impact_is_that_of_the_grid(tmp_path: Path) -> None:
    """The highest drop onto the softest contact."""
    whole = contactlab.sweep(WHOLE, output=tmp_path / "whole", workers=0)
    search = {"maximise": "penetration_max", "runs": 30}
    part = contactlab.sweep({**WHOLE, "search": search}, output=tmp_path / "part", workers=0)
    assert part.manifest.runs <= 30
    assert worst(part) >= 0.95 * worst(whole)
    (line,) = worst_lines(part)
    assert line.startswith("largest penetration_max: ")
    assert "drop_height 0.3, solref.timeconst 0.02" in line
    ids = [set(store.columns.run_ids.to_pylist()) for store in (part, whole)]
    assert ids[0] < ids[1]
    assert not [*find_problems(part.address)]
    assert not [*recomputed_problems(part)]


def test_the_least_margin_of_what_must_hold_is_that_of_the_grid(tmp_path: Path) -> None:
    """A ball that must stay within 10 cm of where it starts falls by g t^2 / 2 in the air.

    Steps of 2 ms make it g t (t + h) / 2, so that the margin is 1 less that over 10 cm.
    """
    sweep = {
        **WHOLE,
        "duration": 0.1,
        "axes": {
            "gravity": {"linspace": [5, 15, 9]},
            "drop_height": {"linspace": [0.1, 0.3, 9]},
        },
        "must": "stays(ball, 10 cm)",
    }
    search = {"minimise": "margin of must", "runs": 20}
    store = contactlab.sweep({**sweep, "search": search}, output=tmp_path / "part", workers=0)
    assert store.manifest.runs == 20
    margins = store.columns.to_pydict(["requirement_margin", "gravity"])
    for margin, gravity in zip(*margins.values(), strict=True):
        assert margin == pytest.approx(1 - gravity * 0.1 * (0.1 + 2e-3) / 2 / 0.1, abs=2e-3)
    (line,) = worst_lines(store)
    assert line.startswith("least requirement_margin: 0.2")
    assert "gravity 15" in line


def test_axes_in_units_are_searched_too(tmp_path: Path) -> None:
    """As many runs as the search may make, and not so many of each height."""
    axes = {
        "drop_height": {"linspace": ["5 cm", "30 cm", 9]},
        "solref.timeconst": {"logspace": ["5 ms", "20 ms", 9]},
    }
    search = {"maximise": "penetration_max", "runs": 8}
    sweep = {**WHOLE, "duration": 0.02, "axes": axes, "search": search}
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    assert store.manifest.runs == 8


def test_a_metric_that_no_run_has_is_told(tmp_path: Path) -> None:
    """A box that slides from the start never creeps."""
    sliding = {
        **WHOLE,
        "scene": "incline",
        "duration": 0.1,
        "axes": {"tilt": {"linspace": [40, 45, 5]}, "friction.slide": [0.1]},
        "search": {"maximise": "creep_speed", "runs": 4},
    }
    store = contactlab.sweep(sliding, output=tmp_path / "store", workers=0)
    assert store.manifest.runs == 4
    assert [*worst_lines(store)] == ["creep_speed could not be measured in any of 4 trials"]


@pytest.mark.parametrize("drawn", [False, True])
def test_rows_of_a_file_run_as_they_are(drawn: bool, tmp_path: Path) -> None:
    """They lack a searched axis, or have values that it does not take."""
    heights = {"uniform": [0.05, 0.3]} if drawn else {"linspace": [0.05, 0.3, 9]}
    sweep = {
        **WHOLE,
        "duration": 0.02,
        "axes": {"drop_height": heights, "solref.timeconst": {"loguniform": [0.005, 0.02]}},
        "sample": {"n": 16},
        "include": [{"drop_height": 0.1}, {"drop_height": 0.1, "solref.timeconst": 0.03}],
        "search": {"maximise": "penetration_max", "runs": 5, "axes": ["solref.timeconst"]},
    }
    if drawn:
        sweep["search"] = {"maximise": "penetration_max", "runs": 5}
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    assert not [*find_problems(store.address)]
    assert {0.1} <= {*store.columns.to_pydict(["drop_height"])["drop_height"]}


@pytest.mark.parametrize(
    ("search", "code", "remedy"),
    [
        ({"maximise": "penetration"}, "unknown-metric", "did you mean"),
        ({"maximise": "penetration_max", "axes": ["hight"]}, "axis-not-swept", "drop_height"),
        ({}, "bad-value", "either maximise or minimise"),
        ({"minimise": "margin of must"}, "not-asked", "add must"),
        ({"minimise": "margin of mus"}, "unknown-metric", "'margin of must'"),
        ({"maximise": "slip_distance", "minimise": "drop"}, "bad-value", "either"),
    ],
)
def test_mistakes_name_the_remedy(
    search: dict[str, Any], code: str, remedy: str, tmp_path: Path
) -> None:
    with pytest.raises(SweepFileError) as caught:
        contactlab.sweep({**WHOLE, "search": search}, output=tmp_path / "s", workers=0)
    assert code in str(caught.value)
    assert remedy in str(caught.value)
