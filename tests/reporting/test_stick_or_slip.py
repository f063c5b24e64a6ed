"""Stick or slip over angle and friction: points as recorded, and the boundary of closed forms."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.reporting.conftest import run

from contactlab.contact.trace_arrays import SLIDE
from contactlab.page.paper_figures import figure_list, figure_specs
from contactlab.page.stick_or_slip import slope_runs, stick_slip_panel
from contactlab.reporting.report import read_report_data
from contactlab.store.finished_store import Store

SLOPES = """
version: 1
scene: incline
duration: 0.5
trace: all
checks: none
axes:
  tilt: {values: [10, 20, 30, 40], role: scenario}
  friction.slide: {values: [0.2, 0.5, 0.8], role: scenario}
  direction: {values: [0, 45], role: scenario}
  cone: [elliptic, pyramidal]
"""
# The plane is level, and gravity is not: by 20 and by 40 degrees.
TILTED_GRAVITY = """
version: 1
scene: box_slide
trace: all
checks: none
axes:
  speed: {values: [0], role: scenario}
  gravity: {values: ["3.3552 0 -9.2184", "6.3057 0 -7.5149"], role: scenario}
  friction.slide: {values: [0.3, 0.6], role: scenario}
"""
ROLLING = """
version: 1
scene: roll_down
trace: all
checks: none
axes: {tilt: {values: [5, 20, 30], role: scenario}}
"""


@pytest.fixture(scope="module")
def slopes(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Give boxes on slopes on either side of their angle of friction."""
    return run(SLOPES, tmp_path_factory.mktemp("slopes"))


@pytest.mark.long
def test_points_are_what_a_slow_loop_finds_in_the_records(slopes: Store) -> None:
    """The tilt of the force is an axis; the trace has what the box does at last."""
    rows = slope_runs(slopes)
    assert len(rows) == 48
    for row, record in zip(rows, slopes.records(), strict=True):
        assert row["angle"] == pytest.approx(record.axes["tilt"])
        assert row["friction"] == record.axes["friction.slide"]
        assert row["cone"] == record.axes["cone"]
        slides = slopes.trace(record).pairs[0].mode[-1] == SLIDE
        assert row["contact"] == ("slides" if slides else "sticks")


@pytest.mark.long
def test_runs_are_on_their_side_of_the_boundary(slopes: Store) -> None:
    """That of the scene's closed form, max(1 - mu / tan(tilt), 0), which is 0 for what sticks.

    At 45 degrees, between its edges, a pyramid holds 1 / sqrt 2 of the friction only.
    """
    for row, record in zip(slope_runs(slopes), slopes.records(), strict=True):
        steepness = np.tan(np.radians(row["angle"]))
        assert (steepness > row["friction"]) == ((record.metrics["oracle_expected"] or 0) > 0)
        is_weak = (record.axes["cone"], record.axes["direction"]) == ("pyramidal", 45)
        held = row["friction"] / np.sqrt(2) if is_weak else row["friction"]
        assert (row["contact"] == "slides") == (steepness > held)


@pytest.mark.long
def test_the_line_is_the_boundary(slopes: Store) -> None:
    values = stick_slip_panel(slope_runs(slopes))["data"]["values"]
    line = [each for each in values if each.get("line")]
    assert {each["cone"] for each in line} == {"elliptic", "pyramidal"}
    for each in line:
        assert each["friction"] == pytest.approx(np.tan(np.radians(each["angle"])))


def test_gravity_is_a_load(tmp_path: Path) -> None:
    rows = slope_runs(run(TILTED_GRAVITY, tmp_path))
    assert sorted(round(each["angle"], 2) for each in rows) == [20, 20, 40, 40]
    for each in rows:
        slides = np.tan(np.radians(each["angle"])) > each["friction"]
        assert (each["contact"] == "slides") == slides


@pytest.mark.long
@pytest.mark.parametrize("name", ["bounce", "grasp"])
def test_level_ground_and_grips_have_none(swept: Callable[[str], Store], name: str) -> None:
    data = read_report_data(swept(name))
    assert slope_runs(data.store) == []
    assert "at rest on a plane" in dict(figure_list(data))["stick-slip"]


@pytest.mark.long
def test_what_rolls_needs_less_friction_and_has_none(tmp_path: Path) -> None:
    assert slope_runs(run(ROLLING, tmp_path)) == []


@pytest.mark.long
def test_a_page_and_papers_have_it(slopes: Store) -> None:
    assert not isinstance(figure_specs(read_report_data(slopes))["stick-slip"], str)
