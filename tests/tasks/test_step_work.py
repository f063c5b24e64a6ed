"""Counted work is the same in each run, and goes with the work that MuJoCo does."""

import copy

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.step_work import UNITS, StepWork
from contactlab.studies.search.configuration import Configuration
from contactlab.tasks.counted_cost import CountedCost

BOXES = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="5 5 .1"/>
  <body pos="0 0 .099"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body pos=".5 0 .099"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body pos="0 0 1"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"
   contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


def motion() -> Motion:
    model = mujoco.MjModel.from_xml_string(BOXES)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    return Motion(model, start, np.zeros((1, 100, 0)))


def cost_of(cost: CountedCost, base: mujoco.MjModel, **settings: object) -> float:
    return cost.count_cost(Configuration(settings).apply_to(base), 1)


def test_the_cost_of_a_model_is_one_and_goes_with_the_number_of_its_steps() -> None:
    moved = motion()
    cost = CountedCost([moved], moved.model, 1)
    assert cost.count_cost(moved.model, 1) == 1.0
    assert cost.count_cost(moved.model, 2) == pytest.approx(0.5, rel=0.1)
    again = CountedCost([moved], moved.model, 1)
    assert again.pass_seconds == cost.pass_seconds


def test_more_work_costs_more() -> None:
    moved = motion()
    cost, base = CountedCost([moved], moved.model, 1), moved.model
    assert 2.5 < cost_of(cost, base, integrator="RK4") < 4
    assert cost_of(cost, base, solver="PGS", iterations=500, tolerance=0.0) > 2
    assert cost_of(cost, base, noslip_iterations=50) > 1.05
    assert cost_of(cost, base, contact=False) < 0.7
    assert cost_of(cost, base, island=False) < 1


def test_counted_units_are_those_of_the_engine() -> None:
    """A box at rest has four contacts of four rows each; two boxes are two islands."""
    model = copy.copy(motion().model)
    data, work = mujoco.MjData(model), StepWork(model)
    work.count_steps(data, 50, None, 0)
    counts = dict(zip(UNITS, work.total / work.steps, strict=True))
    assert work.steps == 49
    assert counts["contact"] == pytest.approx(8, abs=1)
    assert counts["row"] == pytest.approx(32, abs=4)
    assert counts["island"] == pytest.approx(2, abs=0.2)
    assert (counts["round"], counts["box"]) == (2, 0)  # each box near the plane, not the other
    assert counts["stage"] == 1


TERRAIN = """<mujoco><asset><hfield name="h" nrow="21" ncol="41" size="2 2 .1 .1"/></asset>
  <worldbody><geom type="hfield" hfield="h"/>
    <body pos="{place}"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("place", "columns", "rows"),
    [
        ("0 0 .1", 3, 2),  # a ball of 200 mm over cells of 100 mm by 200 mm
        ("1.95 0 .1", 2.5, 2),  # of 150 mm inside the edge
        ("0 0 .4", 0, 0),  # above the highest prism that the field may have
        ("2.2 0 .1", 0, 0),
    ],
)
def test_prisms_of_a_height_field_below_a_geom_are_work(
    place: str, columns: float, rows: float
) -> None:
    """A geom at the other end of a terrain adds no work, although its sphere contains it."""
    model = mujoco.MjModel.from_xml_string(TERRAIN.format(place=place))
    data, work = mujoco.MjData(model), StepWork(model)
    mujoco.mj_forward(model, data)
    work.look_at_pairs(data)
    work.count_step(data)
    assert work.total[UNITS.index("field")] == pytest.approx(2 * columns * rows)
