"""Shares of variance are those of closed forms."""

from pathlib import Path

import numpy as np
import pytest

import contactlab
from contactlab.errors import SweepFileError
from contactlab.plan.rows import sample_points
from contactlab.reporting.sensitivity import _measure_sensitivity as of_values  # pyright: ignore[reportPrivateUsage]
from contactlab.reporting.sensitivity import (
    axes_of_starts,
    budget_lines,
    find_sensitivities,
    sensitivity_lines,
)
from contactlab.schema.sweep_schema import Sample


def test_ishigami() -> None:
    """The shares of sin a + 7 sin^2 b + c^4 sin(a) / 10 over [-pi, pi]^3 are known.

    First order .3139, .4424 and 0, total .5576, .4424 and .2437 (T. Ishigami, T. Homma, 1990).
    Of 2^10 points they are within .03.
    """
    sample = Sample(method="saltelli", n=1024, seed=0)
    a, b, c = (2 * sample_points(sample, 3).T - 1) * np.pi
    values = np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)
    found = of_values("y", {}, ("a", "b", "c"), values.reshape(5, -1))
    assert found.first == pytest.approx([0.3139, 0.4424, 0], abs=0.03)
    assert found.total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.03)
    for shares, interval in (
        (found.first, found.first_interval),
        (found.total, found.total_interval),
    ):
        assert ((interval[:, 0] <= shares) & (shares <= interval[:, 1])).all()


def test_points_differ_from_those_of_the_first_half_in_one_column() -> None:
    points = sample_points(Sample(method="saltelli", n=8), 3).reshape(5, 8, 3)
    first, second = points[:2]
    for axis in range(3):
        mixed = points[2 + axis]
        assert np.array_equal(mixed[:, axis], second[:, axis])
        assert np.array_equal(np.delete(mixed, axis, 1), np.delete(first, axis, 1))


def test_what_falls_from_a_height_depends_on_that_alone(tmp_path: Path) -> None:
    """Before it lands: how far it fell hangs on gravity, and on nothing of the contact."""
    sweep = {
        "version": 1,
        "scene": "ball_drop",
        "duration": 0.1,
        "axes": {
            "gravity": {"uniform": [5, 15]},
            "solref.timeconst": {"uniform": [0.01, 0.03]},
        },
        "sample": {"method": "saltelli", "n": 16},
        "trace": "none",
        "checks": "none",
        "effects": "all",
    }
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    assert store.manifest.runs == 16 * 4
    (found,) = find_sensitivities(store, ["final_speed"])
    assert found.axes == ("gravity", "solref.timeconst")
    # All of the variance goes with gravity: estimates of both are exact up to 16 points' error.
    assert found.total[1] == pytest.approx(0, abs=1e-9)
    assert found.first[0] == pytest.approx(1, abs=0.3)
    assert "gravity alone explains" in next(sensitivity_lines(found))
    with pytest.raises(SweepFileError, match="power of two"):
        contactlab.sweep({**sweep, "sample": {"method": "saltelli", "n": 12}}, workers=0)


def test_what_axes_are_worth_is_the_law_of_free_fall(tmp_path: Path) -> None:
    """In two windows of 40 ms of a fall from rest, half as much gravity is a closed form.

    Velocities part by (g - g') T in a window, at least; the slack of a step takes h g' of that,
    which for g' = 5 is less than for 15. Real are the path g T of each window and a tenth of the
    weight. What touches nothing is worth nothing, and of the height there is no row.
    """
    sweep = {
        "version": 1,
        "scene": "ball_drop",
        "duration": 0.08,
        "axes": {
            "gravity": {"uniform": [5, 15]},
            "solref.timeconst": {"loguniform": [0.01, 0.03]},
            "drop_height": {"uniform": [0.5, 1]},
        },
        "sample": {"method": "saltelli", "n": 2},
        "trace": "none",
        "checks": "none",
    }
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    (budget,) = store.manifest.parameter_budgets
    assert budget.middle["gravity"] == 10
    assert budget.middle["solref.timeconst"] == pytest.approx(0.03**0.5 / 10)
    assert budget.run == pytest.approx(0, abs=1e-6)
    worth = {row.axis: row.share for row in budget.rows}
    window, step = 0.04, 0.002
    apart = 5 * window - step * 5
    assert worth["gravity"] == pytest.approx(apart / (1.1 * 10 * window), rel=1e-6)
    assert worth["solref.timeconst"] == 0
    assert axes_of_starts(budget) == ["drop_height"]
    lines = [*budget_lines(store)]
    assert lines[1].startswith("  gravity at 5 or 15: 4")
    assert "drop_height" in lines[-1]
    again = contactlab.sweep(sweep, output=tmp_path / "again", workers=0)
    assert again.manifest.parameter_budgets == store.manifest.parameter_budgets


@pytest.mark.long
def test_the_page_shows_it_of_a_sweep_whose_runs_form_no_pairs(tmp_path: Path) -> None:
    """It stands for itself: no knob of such a sweep is changed alone."""
    sweep = {
        "version": 1,
        "scene": "ball_drop",
        "duration": 0.1,
        "axes": {
            "drop_height": {"uniform": [0.005, 0.02]},
            "solref.timeconst": {"uniform": [0.01, 0.03]},
        },
        "sample": {"method": "saltelli", "n": 8},
        "trace": "none",
        "checks": "none",
        "effects": "all",
    }
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    assert "penetration_max" in {found.metric for found in find_sensitivities(store)}
    contactlab.report(store, output=tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert 'id="sensitivity"' in page
    assert "rror budget of the run at drop_height" in page
