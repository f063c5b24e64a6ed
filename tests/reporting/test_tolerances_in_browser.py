"""Tolerances that are changed on a page, against `contactlab tradeoff`."""

import re
from collections.abc import Callable
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.configurations import (
    ResolvedCriteria,
    StoredRuns,
    evaluate_configurations,
    group_runs,
)
from contactlab.pareto.criteria import Criteria
from contactlab.pareto.recommendation import (
    EQUALLY_FAST,
    MORE_ACCURATE,
    SAFE_MARGIN,
    equally_fast,
    feasible_front,
    setting_text,
)
from contactlab.schema.tradeoff_report import ErrorMeasure, TimeMeasure, TradeoffReport
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import CodedColumn

pytestmark = pytest.mark.long

Swept = Callable[[str], Store]
Reported = Callable[[str], Path]
Visit = Callable[..., Any]

RULES = {
    "equallyFast": EQUALLY_FAST,
    "equallyAccurate": MORE_ACCURATE,
    "safeMargin": SAFE_MARGIN,
    "configurations": [[0, 0], *([number, number % 2] for number in range(1, 12))],
}
SCRIPT = resources.files("contactlab.page").joinpath("script/evaluation.js")


def text(page: Any, selector: str) -> str:
    return re.sub(r"\s+", " ", page.locator(selector).first.text_content())


def analysed(store: Store, **limits: float) -> TradeoffReport:
    return analyze_tradeoff(store, Criteria(None, limits))


def recommended_settings(page: Any) -> dict[str, str]:
    read = "list => [...list.children].map(each => [...each.children].map(one => one.textContent))"
    settings = page.locator("#recommendation-text dl.settings").evaluate(read)
    return {name.split(" ")[0]: value for name, value in settings}


def test_tolerances_are_evaluated_as_tradeoff_does(
    visit: Visit, reported: Reported, swept: Swept
) -> None:
    page = visit(reported("tradeoff"), "#tab=tradeoff").page
    outcomes: set[bool] = set()
    for error, depth in product((0.5, 0.08, 0.05, 0.03, 0.012, 1e-6), (0.03, 0.01)):
        page.fill("tr[data-name=oracle_error] input", str(error))
        page.fill("tr[data-name=penetration_max] input", str(depth))
        report = analysed(swept("tradeoff"), oracle_error=error, penetration_max=depth)
        check_recommendation(page, report)
        outcomes.add(report.recommendation is not None)
    assert outcomes == {True, False}


def check_recommendation(page: Any, report: TradeoffReport) -> None:
    feasible = sum(each.feasible for each in report.configurations)
    page.wait_for_function(
        "count => document.querySelector('#chart-picture').textContent.includes(count)",
        arg=f"{feasible} of {len(report.configurations)} configurations",
    )
    chosen = report.recommendation
    if chosen is None:
        assert "No configuration is feasible" in text(page, "#recommendation-text")
        return
    shown = recommended_settings(page)
    assert shown["integrator"] == chosen.configuration["integrator"]
    assert shown["timestep"] == setting_text(chosen.configuration["timestep"], "s")
    assert shown["solref"] == chosen.configuration["solref"]
    for name, margin in chosen.margins.items():
        assert margin is not None
        assert text(page, f"tr[data-name={name}] .margin") == f"x {float(f'{margin:.3g}'):g}"


def random_runs(rng: np.random.Generator) -> StoredRuns:
    """Return a run of each of 12 configurations, many of them equal in time or error."""
    count = 12
    coarse = rng.integers(1, 6, (3, count)) / 4
    numbers = {
        name: np.where(rng.random(count) < 0.1, np.nan, row)
        for name, row in zip(("error", "time", "depth"), coarse, strict=True)
    }
    return StoredRuns(
        knobs={
            "knob": CodedColumn(np.arange(count), tuple(range(count))),
            "odd": CodedColumn(np.arange(count) % 2, (0, 1)),
        },
        scenarios={},
        seeds=CodedColumn(np.zeros(count, dtype=np.int64), (0,)),
        labels=CodedColumn(rng.choice(2, count, p=[0.8, 0.2]), ("stable", "chatter")),
        numbers=numbers,
    )


def test_random_configurations_are_evaluated_as_tradeoff_does(browser: Any) -> None:
    """Feasible ones, both recommendations and the front, of ties and unknown values too."""
    rng = np.random.default_rng(7)
    error = ErrorMeasure(name="error", unit="1", kind="metric", against=None, resolution=0.0)
    time = TimeMeasure(name="time", source="timing", spread=None)
    limits = {"depth": 1.0, "error": 1.0}
    cases: list[dict[str, Any]] = []
    expected: list[list[Any]] = []
    for number in range(200):
        runs = random_runs(rng)
        groups = group_runs(runs)
        free = evaluate_configurations(runs, ResolvedCriteria(error, time, {}), groups)
        found = evaluate_configurations(runs, ResolvedCriteria(error, time, limits), groups)
        places = None if number % 3 else [*range(0, len(found), 2)]
        cases.append(
            {
                "otherwiseFeasible": [int(each.summary.feasible) for each in free],
                "worst:depth": runs.numbers["depth"].tolist(),
                "worst:error": runs.numbers["error"].tolist(),
                "time": runs.numbers["time"].tolist(),
                "error": runs.numbers["error"].tolist(),
                "baseline": number % 2,
                "recommendable": places,
            }
        )
        possible = found if places is None else [found[place] for place in places]
        own = found[0].values if number % 2 else None
        best = [equally_fast(possible, margin, own)[:1] for margin in (0.0, SAFE_MARGIN)]
        expected.append(
            [
                [each.summary.feasible for each in found],
                *([each.first for each in chosen] for chosen in best),
                [each.first for each in feasible_front(found)],
            ]
        )
    page = browser.new_page()
    shown = page.evaluate(
        """({code, rules, cases, limits}) => {
          const load = new Function('metadata', `${code}; return evaluate;`);
          const evaluate = load({ tradeoff: rules });
          const listed = (place) => place === null ? [] : [place];
          return cases.map((columns) => {
            const found = evaluate(columns, limits, {
              ...rules, baseline: columns.baseline, recommendable: columns.recommendable });
            return [found.feasible, listed(found.recommended), listed(found.robust), found.front];
          });
        }""",
        {"code": SCRIPT.read_text(), "rules": RULES, "cases": cases, "limits": limits},
    )
    page.close()
    assert shown == expected


def test_a_tolerance_of_any_metric_can_be_added(
    visit: Visit, reported: Reported, swept: Swept
) -> None:
    store = swept("tradeoff")
    seen = visit(reported("tradeoff"), "#tab=tradeoff")
    seen.page.select_option("select[aria-label='add a tolerance']", "solver_iterations_mean")
    seen.page.fill("tr[data-name=solver_iterations_mean] input", "nonsense")
    assert seen.page.get_attribute("tr[data-name=solver_iterations_mean] input", "aria-invalid")
    seen.page.fill("tr[data-name=solver_iterations_mean] input", "1e-9")
    assert analysed(store, solver_iterations_mean=1e-9).recommendation is None
    assert "No configuration is feasible" in text(seen.page, "#recommendation-text")
    assert "--tolerance solver_iterations_mean=1e-9" in text(seen.page, "#tradeoff-command")
    assert seen.complaints == []


def test_a_point_of_the_chart_leads_to_its_runs(visit: Visit, reported: Reported) -> None:
    page = visit(reported("tradeoff"), "#tab=tradeoff").page
    page.locator("#chart-picture .mark-symbol path").nth(3).click(force=True)
    heads = page.locator("#run-list li")
    assert heads.count() == 4, "two scenarios and two seeds"
