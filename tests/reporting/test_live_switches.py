"""Rows of a budget as switches of a page that simulates."""

import mujoco
import numpy as np
import pytest

from contactlab.live.browser_models import model_changes
from contactlab.live.budget_switches import rows_of, switched_models
from contactlab.modifications.catalogue import list_rows
from contactlab.schema.error_budget import BudgetPhase, BudgetReport, BudgetRow

MODEL = """
<mujoco><option impratio="3"/>
  <worldbody><geom type="plane" size="1 1 .1" friction=".8"/>
    <body pos="0 0 .1"><freejoint/><geom size=".1" mass="2" friction=".8"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


def found(name: str, share: float | None, *, exercised: bool = True) -> BudgetRow:
    nothing = dict.fromkeys(
        ("seeds", "median", "by_mass", "body", "place", "speed", "seed", "time", "time_ratio")
    )
    return BudgetRow.model_validate(
        {
            **nothing,
            "name": name,
            "summary": "",
            "kind": "model",
            "exercised": exercised,
            "infinite": exercised and share is None,
            "error": share,
        }
    )


def phase(*rows: BudgetRow) -> BudgetPhase:
    return BudgetPhase.model_construct(name="", numerical_error=rows[0], rows=rows)


def test_the_worst_phase_counts_and_what_is_not_exercised_is_last() -> None:
    report = BudgetReport.model_construct(
        phases=(
            phase(found("noslip", 0.02), found("margin", None, exercised=False)),
            phase(found("solver", 1e-9)),
            phase(found("noslip", 0.4), found("cone", 0.1), found("gravity", None)),
        )
    )
    told = [(row.name, words) for row, words in rows_of(report)]
    assert told == [
        ("gravity", "ends it"),
        ("noslip", "40 %"),
        ("cone", "10 %"),
        ("solver", "< 0.01 %"),
        ("margin", "not exercised"),
    ]


def test_a_switch_changes_what_its_row_says_and_nothing_else(model: mujoco.MjModel) -> None:
    rows = {row.name: row for row in list_rows()}
    before = {
        name: model_changes(model, made)
        for row in list_rows()
        for name, made in switched_models(model, row)
    }
    assert set(before["noslip"]) == {"opt.noslip_iterations", "opt.noslip_tolerance"}
    # In elliptic cones, as the budget makes it.
    assert before["impratio"] == {
        "opt.cone": ([0], [int(mujoco.mjtCone.mjCONE_ELLIPTIC)]),
        "opt.impratio": ([0], [30.0]),
    }
    for name, factor in (("friction 10 %, more", 1.1), ("friction 10 %, less", 0.9)):
        places, values = before[name]["geom_friction"]
        assert places == [0, 3]
        np.testing.assert_allclose(values, 0.8 * factor, rtol=1e-15)
    heavier = dict(switched_models(model, rows["mass 5 %"]))["mass 5 %, more"]
    np.testing.assert_allclose(heavier.body_mass, 1.05 * model.body_mass, rtol=1e-15)
    assert model.opt.noslip_iterations == 0
    assert model.body_mass[1] == 2
