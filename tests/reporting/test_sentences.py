"""Sentences of a page, against slow and obvious loops over what they tell of."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.planted_recordings import plant
from tests.reporting.test_map_cells import axis

from contactlab.errors import OutputError, SceneError
from contactlab.page import header_films as page_pictures
from contactlab.page.header_films import header_films
from contactlab.page.page_view import first_look, list_stable_tiles, listed_runs
from contactlab.page.report_files import write_page
from contactlab.page.script_data import listed_metrics
from contactlab.page.sentences import (
    closest_settings,
    compared_settings,
    reality_sentence,
    tradeoff_sentence,
)
from contactlab.rendering.amounts import format_amount
from contactlab.rendering.text import render_text
from contactlab.reporting.report import PageRequest, ReportData, read_report_data
from contactlab.reporting.report_columns import Quantity, summary_metrics
from contactlab.reporting.store_document import describe_store
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store
from contactlab.store.table_layout import REAL, Column
from contactlab.view.film import graphics_context

Swept = Callable[[str], Any]


def configuration(step: float, time: float, error: float | None, feasible: bool) -> Any:
    values = {"timestep": step}
    return SimpleNamespace(configuration=values, time=time, error=error, feasible=feasible)


def said(configurations: list[Any], chosen: Any) -> str:
    report = SimpleNamespace(
        configurations=configurations,
        recommendation=chosen,
        varying=["timestep"],
        units={"timestep": "s"},
    )
    return tradeoff_sentence(cast(Any, report))


def test_a_trade_off_says_what_the_recommended_configuration_saves() -> None:
    slow, fast = configuration(0.001, 0.9, 0.01, True), configuration(0.002, 0.3, 0.02, True)
    wrong = configuration(0.004, 0.1, None, False)
    assert said([slow, fast, wrong], fast) == (
        "2 of 3 configurations are within every tolerance; the most accurate, timestep 1 ms, "
        "takes 3 times as long as the recommended timestep 2 ms."
    )
    assert said([slow, wrong], slow) == (
        "1 of 2 configurations are within every tolerance; "
        "the recommended timestep 1 ms is the most accurate of them."
    )
    none = "0 of 1 configuration is within every tolerance; none can be recommended."
    assert said([wrong], None) == none


@pytest.mark.long
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
    run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
    return read_report_data(Store.open(ask.store))


@pytest.mark.long
def test_the_closest_setting_is_named_and_the_table_is_in_order(compared: ReportData) -> None:
    [reality] = compared.quantities_named("reality")
    [axis] = [each for each in compared.axes if each.name == "friction.slide"]
    by_setting: dict[str, list[float]] = {}
    for code, value in zip(axis.codes.tolist(), reality.values.tolist(), strict=True):
        by_setting.setdefault(axis.ticks[code], []).append(value)
    means = {tick: sum(values) / len(values) for tick, values in by_setting.items()}
    order = sorted(means, key=means.__getitem__)
    assert order[0] == "0.3"
    least = f"{means['0.3']:.3g}"
    assert reality_sentence(compared) == (
        f"Of 3 settings, friction.slide 0.3 is closest to reality: {least} away "
        f"from its recording; friction.slide {order[-1]} is farthest, {means[order[-1]]:.3g}."
    )
    header, rows, floors = closest_settings(compared)
    assert floors == []
    assert [row[header.index(axis.title)] for row in rows] == order
    column = [row[header.index(f"mean {reality.title}")] for row in rows]
    assert column == [f"{means[tick]:.3g}" for tick in order]
    assert all(len(row) == len(header) for row in rows)


def test_settings_are_compared_over_all_their_recordings() -> None:
    """Two of three knobs vary together, one of which tells settings apart; a run has no value."""
    codes = {"recorded_run": [0, 1, 2, 0, 1, 2], "friction": [0, 0, 0, 1, 1, 1]}
    values = np.array([0.1, 0.3, np.nan, 0.2, 0.8, 0.2])
    axes = [
        axis("cone", [0] * 6, 2),
        axis("recorded_run", codes["recorded_run"], 3, "scenario"),
        axis("friction", codes["friction"], 2),
    ]
    [reality] = [Quantity(Column("reality", REAL, "1", "", "lower"), values)]
    told = SimpleNamespace(axes=axes, quantities=[reality], quantities_named=lambda _: [reality])
    settings = compared_settings(cast(Any, told))
    assert [(each.name, each.rows.tolist()) for each in settings] == [
        ("friction friction0", [0, 1]),
        ("friction friction1", [3, 4, 5]),
    ]
    assert [each.distance for each in settings] == pytest.approx([0.2, 0.4])


@pytest.mark.long
def test_a_page_has_a_tab_of_reality_only_where_runs_were_compared(
    compared: ReportData, swept: Swept, tmp_path: Path
) -> None:
    for store, has in ((compared.store, True), (swept("bounce"), False)):
        write_page(store, tmp_path / "page.html", PageRequest(traces=0))
        assert ('href="#reality"' in (tmp_path / "page.html").read_text()) == has


@pytest.mark.parametrize("drawable", [True, False])
def test_a_page_without_films_has_drawings_or_the_reason(
    swept: Swept, monkeypatch: pytest.MonkeyPatch, *, drawable: bool
) -> None:
    def load() -> None:
        raise OutputError("it needs av")

    found = dict(page_pictures.find_extensions("viewer"))
    found |= dict.fromkeys(
        ("gif", "png") if drawable else ("gif", "png", "svg"), SimpleNamespace(load=load)
    )
    monkeypatch.setattr(page_pictures, "find_extensions", lambda _: found)
    data = read_report_data(swept("bounce"))
    films = header_films(data, None, has_moment=False)
    assert films.missing == ("" if drawable else "it needs av")
    assert [(film.label, film.moves) for film in films.films] == [("stable", False)] * drawable
    for film in films.films:
        assert film.source.startswith("data:image/svg+xml;base64,")
        assert data.store.record(film.run)
    first = first_look(data)
    assert first is not None
    focal = page_pictures.focal_picture(data, first[0])
    assert (focal is not None) == drawable
    assert not header_films(data, first[0], has_moment=True).missing


def test_the_worst_run_of_each_label_comes_first(swept: Swept) -> None:
    """In the head, the list of runs, their series and the summary."""
    store = swept("bounce")
    data = read_report_data(store)
    gains = store.columns.numbers("energy_gain").values
    failing = data.labels.names.index("energy_injection")
    rows = data.labels.worst_rows(store, failing)
    assert rows.tolist() == sorted(
        np.flatnonzero(data.labels.codes == failing), key=lambda row: (-gains[row], row)
    )
    listed = [row[0] for row in listed_runs(data).rows if row[1] == "energy_injection"]
    assert listed == [store.columns.run_id(row) for row in rows]
    worst = store.columns.run_id(int(data.labels.worst_rows(store, 0)[0]))
    assert f"look closer: contactlab show {store.address} {worst[:8]}" in render_text(
        describe_store(store), width=200
    )


@pytest.mark.long
def test_the_head_has_films_of_a_stable_and_of_the_worst_run(swept: Swept) -> None:
    try:
        with graphics_context(64, 64):
            pass
    except SceneError as error:
        pytest.skip(str(error))
    data = read_report_data(swept("bounce"))
    first = first_look(data)
    assert first is not None
    stable, worst = header_films(data, first[0], has_moment=True).films
    assert stable.label == "stable"
    assert (worst.run, worst.label) == first
    for film in (stable, worst):
        assert film.source.startswith("data:image/gif;base64,R0lGOD")
    none = header_films(read_report_data(swept("tradeoff")), None, has_moment=False)
    assert not none.films
    assert "no trace of run" in none.missing


def test_a_sweep_without_failures_says_how_deep_and_how_fast(swept: Swept) -> None:
    data = read_report_data(swept("bounce"))
    assert data.labels.failed.any()
    assert not [*list_stable_tiles(data)]
    names = ("stable",) * len(data.labels.names)
    stable = replace(data.labels, names=names)
    deepest, speeds = list_stable_tiles(replace(data, labels=stable))
    [depth] = data.quantities_named("penetration_max")
    assert deepest.text == format_amount(float(np.nanmax(depth.values)), "mm")
    record = data.store.record(deepest.run)
    assert record.metrics["penetration_max"] == pytest.approx(np.nanmax(depth.values))
    timestep = record.settings["timestep"]
    assert isinstance(timestep, float)
    assert f"timestep {1e3 * timestep:g} ms" in deepest.meaning
    [cost] = data.quantities_named("cost_cpu_per_sim_s")
    slowest = float(speeds.text.split()[0].replace(",", ""))
    assert slowest == pytest.approx(1 / np.nanmax(cost.values), rel=0.01)


def test_error_and_depth_come_first_in_lists_of_metrics(swept: Swept) -> None:
    """The map of a stable sweep shows the first; one without an error shows the depth."""
    data = read_report_data(swept("bounce"))
    assert summary_metrics()[0] == "penetration_max"
    no_tradeoff = replace(data, tradeoff=None)
    assert listed_metrics(no_tradeoff)[:2] == ["backward_error", "penetration_max"]
    (depth,) = data.quantities_named("penetration_max")
    few = replace(data.quantities, columns=(depth.column,))
    assert listed_metrics(replace(no_tradeoff, quantities=few)) == ["penetration_max"]
