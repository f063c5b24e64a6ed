"""Sentences of a page, against slow and obvious loops over what they tell of."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.planted_recordings import plant

from contactlab.errors import SceneError
from contactlab.reporting.report import ReportData, read_report_data, write_page
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store
from contactlab_page.header_films import header_films
from contactlab_page.html_page import first_look
from contactlab_page.sentences import closest_runs, reality_sentence, tradeoff_sentence
from contactlab_view.film import graphics

Swept = Callable[[str], Any]


def configuration(step: float, time: float, error: float | None, feasible: bool) -> Any:
    values = {"timestep": step}
    return SimpleNamespace(configuration=values, time=time, error=error, feasible=feasible)


def said(configurations: list[Any], chosen: Any) -> str:
    report = SimpleNamespace(
        configurations=configurations, recommendation=chosen, varying=["timestep"]
    )
    return tradeoff_sentence(cast(Any, report))


def test_a_trade_off_says_what_the_recommended_configuration_saves() -> None:
    slow, fast = configuration(0.001, 0.9, 0.01, True), configuration(0.002, 0.3, 0.02, True)
    wrong = configuration(0.004, 0.1, None, False)
    assert said([slow, fast, wrong], fast) == (
        "2 of 3 configurations are within every tolerance; the most accurate, timestep 0.001, "
        "takes 3 times as long as the recommended timestep 0.002."
    )
    assert said([slow, wrong], slow) == (
        "1 of 2 configurations are within every tolerance; "
        "the recommended timestep 0.001 is the most accurate of them."
    )
    none = "0 of 1 configuration is within every tolerance; none can be recommended."
    assert said([wrong], None) == none


def test_the_sentence_of_a_real_trade_off_counts_as_its_table(swept: Swept) -> None:
    report = read_report_data(swept("tradeoff")).tradeoff
    assert report is not None
    feasible = 0
    for each in report.configurations:
        feasible += each.feasible
    told = tradeoff_sentence(report)
    assert told.startswith(f"{feasible:,} of {len(report.configurations):,} configurations are ")


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """A recording of a sliding puck, simulated with three frictions, one of them the true one."""
    folder = tmp_path_factory.mktemp("compared")
    scene = folder / "scene"
    plant(scene, 0.3, seed=3)
    text = (
        f"{{version: 1, scene: {scene}, axes: {{friction.slide: [0.1, 0.3, 0.9]}}, checks: none}}"
    )
    ask = read_request(text, "compared", folder / "store", folder=folder, workers=0)
    run_sweep(ask, begin=lambda _total, _done: None, progress=lambda _: None)
    return read_report_data(Store.open(ask.store))


def test_the_closest_run_is_named_and_the_table_is_in_order(compared: ReportData) -> None:
    [reality] = compared.quantities_named("reality")
    best, least = 0, np.inf
    for row, value in enumerate(reality.values.tolist()):
        if value < least:
            best, least = row, value
    told = reality_sentence(compared)
    [axis] = [each for each in compared.axes if each.name == "friction.slide"]
    assert f"friction.slide {axis.ticks[axis.codes[best]]}" in told
    assert axis.ticks[axis.codes[best]] == "0.3"
    assert f"{least:.3g}" in told
    header, rows, floors = closest_runs(compared)
    assert floors == []
    assert rows[0][0] == str(compared.store.columns.run_ids[best])
    column = [float(row[header.index(reality.title)]) for row in rows]
    assert column == sorted(column)
    assert all(len(row) == len(header) for row in rows)


def test_a_page_has_a_tab_of_reality_only_where_runs_were_compared(
    compared: ReportData, swept: Swept, tmp_path: Path
) -> None:
    for store, has in ((compared.store, True), (swept("bounce"), False)):
        write_page(store, tmp_path / "page.html")
        assert ('href="#reality"' in (tmp_path / "page.html").read_text()) == has


def test_the_head_has_films_of_a_stable_and_of_the_worst_run(swept: Swept) -> None:
    try:
        with graphics(64, 64):
            pass
    except SceneError as error:
        pytest.skip(str(error))
    data = read_report_data(swept("bounce"))
    first = first_look(data)
    assert first is not None
    stable, worst = header_films(data, first[0])
    assert stable.label == "stable"
    assert (worst.run, worst.label) == first
    for film in (stable, worst):
        assert film.source.startswith("data:image/gif;base64,R0lGOD")
    assert header_films(read_report_data(swept("tradeoff")), None) == []
