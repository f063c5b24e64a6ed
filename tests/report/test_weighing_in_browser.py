"""Tolerances that are changed on a page, against `contactlab tradeoff`."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.schema import TradeoffReport
from contactlab.store import Store
from contactlab.tradeoff import Criteria, analyse

Swept = Callable[[str], Store]
Reported = Callable[[str], Path]
Visit = Callable[..., Any]


def text(page: Any, selector: str) -> str:
    return re.sub(r"\s+", " ", page.locator(selector).first.text_content())


def weighed(store: Store, **limits: float) -> TradeoffReport:
    return analyse(store, Criteria(None, limits))


def shown_settings(page: Any) -> dict[str, str]:
    read = "list => [...list.children].map(each => [...each.children].map(one => one.textContent))"
    found = page.locator("#advice dl.settings")
    return dict(found.evaluate(read)) if found.count() else {}


@pytest.mark.parametrize("error", [0.5, 0.08, 0.05, 0.03, 0.012, 1e-6])
@pytest.mark.parametrize("depth", [0.03, 0.01])
def test_tolerances_are_weighed_as_tradeoff_does(
    visit: Visit, reported: Reported, swept: Swept, error: float, depth: float
) -> None:
    page = visit(reported("tradeoff")).page
    page.fill("tr[data-name=oracle_error] input", str(error))
    page.fill("tr[data-name=penetration_max] input", str(depth))
    report = weighed(swept("tradeoff"), oracle_error=error, penetration_max=depth)
    pick = report.recommendation
    if pick is None:
        assert "No configuration is feasible" in text(page, "#advice")
        return
    told = {name.split(" ")[0]: value for name, value in shown_settings(page).items()}
    assert told["integrator"] == pick.configuration["integrator"]
    assert float(told["timestep"]) == pick.configuration["timestep"]
    assert told["solref"] == pick.configuration["solref"]
    assert text(page, "#advice pre").replace(" ", "") == re.sub(r"\s", "", "".join(pick.mjcf))
    for name, margin in pick.margins.items():
        assert margin is not None
        assert text(page, f"tr[data-name={name}] .margin") == f"x {float(f'{margin:.3g}'):g}"
    feasible = sum(each.feasible for each in report.configurations)
    page.wait_for_function(
        "told => document.querySelector('#chart-picture').textContent.includes(told)",
        arg=f"{feasible} of {len(report.configurations)} configurations",
    )


def test_a_tolerance_of_any_metric_can_be_added(
    visit: Visit, reported: Reported, swept: Swept
) -> None:
    store = swept("tradeoff")
    seen = visit(reported("tradeoff"))
    seen.page.select_option("select[aria-label='add a tolerance']", "solver_iterations_mean")
    seen.page.fill("tr[data-name=solver_iterations_mean] input", "nonsense")
    assert seen.page.get_attribute("tr[data-name=solver_iterations_mean] input", "aria-invalid")
    seen.page.fill("tr[data-name=solver_iterations_mean] input", "1e-9")
    assert weighed(store, solver_iterations_mean=1e-9).recommendation is None
    assert "No configuration is feasible" in text(seen.page, "#advice")
    assert "--tolerance solver_iterations_mean=1e-9" in text(seen.page, "#weigh-command")
    assert seen.complaints == []


def test_a_point_of_the_chart_leads_to_its_runs(visit: Visit, reported: Reported) -> None:
    page = visit(reported("tradeoff")).page
    page.locator("#chart-picture .mark-symbol path").nth(3).click(force=True)
    heads = page.locator("#run-list table tbody tr")
    assert heads.count() == 4, "two scenarios and two seeds"
