"""Pages of real sweeps in a real browser."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.small_films import small_films

from contactlab.page.map_cells import STATISTICS, cell_statistic
from contactlab.page.report_files import write_page
from contactlab.printable import visible
from contactlab.reporting.map_axes import MapAxes
from contactlab.reporting.report import read_report_data
from contactlab.store.finished_store import Store

Swept = Callable[[str], Store]
Reported = Callable[[str], Path]
Visit = Callable[..., Any]
READ = "list => [...list.children].map(each => [...each.children].map(one => one.textContent))"
SWEEPS = ("bounce", "tradeoff", "hard", "grasp")


def text(page: Any, selector: str) -> str:
    return re.sub(r"\s+", " ", page.locator(selector).first.text_content())


def read_amount(text: str, unit: str) -> float:
    """Return the value of a number with a prefix and this SI unit."""
    number, _, shown = text.partition(" ")
    return float(number) * {"": 1, "m": 1e-3, "µ": 1e-6, "n": 1e-9}[shown.removesuffix(unit)]


def pairs(page: Any, place: int) -> dict[str, str]:
    """Return the names and values of one list of the run that is shown."""
    return dict(page.locator("#drawer dl.pairs").nth(place).evaluate(READ))


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [pytest.param(each, marks=[] if each == "bounce" else pytest.mark.night) for each in SWEEPS],
)
def test_a_page_works_alone(visit: Visit, reported: Reported, name: str) -> None:
    """No message, no error, and nothing is asked for but the file itself."""
    path = reported(name)
    seen = visit(path)
    seen.page.evaluate("() => new Promise(requestAnimationFrame)")
    assert seen.complaints == []
    assert seen.requests == [path.as_uri()]


@pytest.mark.long
def test_the_axes_of_the_map_can_be_changed(visit: Visit, reported: Reported) -> None:
    page = visit(reported("bounce")).page
    before = text(page, "#map-picture svg")
    assert "timestep [ms]" in before
    page.select_option("[data-key=x] select", "drop_height")
    page.wait_for_function("document.querySelector('#map-picture').textContent.includes('height')")
    assert "drop_height [m]" in text(page, "#map-picture svg")
    page.select_option("[data-key=what] select", "penetration_max")
    page.wait_for_function("document.querySelector('#map-picture').textContent.includes('worst')")
    page.select_option("[data-key=facet] select", "timestep")
    page.wait_for_function(
        "document.querySelectorAll('#map-picture svg .role-axis-title').length >= 6"
    )
    page.reload()
    page.wait_for_selector("body[data-ready]")
    assert page.input_value("[data-key=x] select") == "drop_height"
    assert page.input_value("[data-key=what] select") == "penetration_max"


@pytest.mark.long
def test_the_table_has_the_statistics_of_the_store(
    visit: Visit, reported: Reported, swept: Swept
) -> None:
    """The script aggregates the runs of each cell as `cell_statistics` does."""
    page = visit(reported("bounce"), "#what=penetration_max&x=timestep&y=drop_height").page
    page.locator("#map-data summary").click()
    data = read_report_data(swept("bounce"))
    axes = {axis.name: axis for axis in data.axes}
    drawn = MapAxes(axes["timestep"], axes["drop_height"])
    [depth] = data.quantities_named("penetration_max")
    for kind in STATISTICS:
        page.select_option("[data-key=stat] select", kind)
        rows = page.locator("#map-data tbody tr").all()
        expected = cell_statistic(drawn, depth, kind)[::-1]
        for row, values in zip(rows, expected.tolist(), strict=True):
            texts = row.locator("td").all_inner_texts()
            assert all(text.startswith("2 runs; ") for text in texts)
            shown = [re.findall(rf"{kind} penetration_max (\S+ \w+)", text)[0] for text in texts]
            assert [read_amount(each, "m") for each in shown] == pytest.approx(values, rel=5e-4)


@pytest.mark.long
def test_a_click_leads_to_the_run(visit: Visit, reported: Reported, swept: Swept) -> None:
    """Its numbers are those of the table, to the three digits that are shown."""
    page = visit(reported("bounce"), "#x=timestep&y=drop_height&only.restitution=1").page
    cell = page.locator("#map-picture .mark-rect").first.locator("path").last
    cell.scroll_into_view_if_needed()
    box = cell.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 4)
    page.wait_for_function("location.hash.includes('run=')")
    run = re.findall(r"run=([0-9a-f]{16})", page.evaluate("location.hash"))[0]
    record = swept("bounce").record(run)
    assert record.axes["restitution"] == 0.9
    shown = dict(page.locator("#metrics dl").evaluate(READ))
    assert len(shown) > 20
    known = record.metrics | {"cost_cpu_per_sim_s": record.cost and record.cost.cpu_per_sim_s}
    units = swept("bounce").columns.metric_columns
    for name, value in shown.items():
        amount = read_amount(value, units[name].unit)
        assert amount == pytest.approx(known[name], rel=5e-3, abs=1e-12)
    assert f"contactlab verify {swept('bounce').path} {run}" in text(page, "#run-more pre")
    assert record.trace is not None
    assert record.trace.file in text(page, "#run-more")
    assert all(each.label in text(page, "#run ul") for each in record.labels)


@pytest.mark.long
def test_time_series_end_as_the_trace_does(visit: Visit, reported: Reported, swept: Swept) -> None:
    store = swept("bounce")
    run = store.columns.identify([0])[0]["run_id"]
    page = visit(reported("bounce"), f"#run={run}").page
    page.wait_for_selector("#timeline svg")
    shown = text(page, "#timeline svg")
    assert "ball z [m]" in shown
    assert "contact force [N]" in shown
    assert "normal" in shown
    assert "floor-ball" in shown
    trace = store.trace(run)
    packed = page.evaluate(
        """async () => {
          const packed = JSON.parse(document.getElementById('series').textContent);
          return packed.runs[0].signals.map((each) => each[0]);
        }"""
    )
    assert packed[0] == "ball z"
    assert trace.pairs[0].name in packed[-1]


@pytest.mark.long
def test_the_keyboard_reaches_a_run(visit: Visit, reported: Reported) -> None:
    page = visit(reported("bounce"), "#x=timestep&y=drop_height&only.restitution=0").page
    page.focus("#map-picture")
    for key in ("ArrowRight", "ArrowRight", "ArrowRight", "ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    assert text(page, "#map-cell").startswith("timestep [ms] 20, drop_height [m] 1: 1 run")
    page.keyboard.press("Enter")
    page.wait_for_function("location.hash.includes('run=')")
    assert page.evaluate("document.activeElement.id") == "run"
    page.focus("[data-key='only.restitution'] button:last-child")
    page.keyboard.press("Enter")
    page.wait_for_function("location.hash.includes('only.restitution=1')")
    assert page.evaluate("document.activeElement.textContent") == "0.9"


@pytest.mark.long
def test_a_click_in_one_of_several_maps_leads_to_its_runs(visit: Visit, reported: Reported) -> None:
    page = visit(reported("bounce"), "#x=timestep&y=restitution&facet=drop_height").page
    cell = page.locator("#map-picture .concat_1_group .mark-rect").first.locator("path").last
    cell.scroll_into_view_if_needed()
    box = cell.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 4)
    page.wait_for_function("location.hash.includes('run=')")
    shown = pairs(page, 0)
    assert (shown["drop_height [m]"], shown["timestep [ms]"]) == ("1", "20")
    assert text(page, "#map-cell").startswith("drop_height 1, timestep [ms] 20, restitution 0.9:")


@pytest.mark.night
@pytest.mark.parametrize(("sides", "place"), [("x=tilt&y=cone", "x"), ("x=cone&y=tilt", "y")])
def test_a_line_parts_cells_where_the_closed_form_expects_motion(
    visit: Visit, reported: Reported, sides: str, place: str
) -> None:
    """The angle of friction, atan(0.5) = 26.6 degrees, lies between 26 and 27 degrees."""
    page = visit(reported("incline"), f"#{sides}").page
    line = page.locator("#map-picture .mark-line path").first.bounding_box()
    cells = page.locator("#map-picture .mark-rect").first.locator("path")
    boxes = [each.bounding_box() for each in cells.all()]
    size = "width" if place == "x" else "height"
    first = min(box[place] for box in boxes)
    last = max(box[place] + box[size] for box in boxes)
    share = (line[place] + line[size] / 2 - first) / (last - first)
    assert share == pytest.approx(2 / 4, abs=0.01)


STRICT = "default-src 'none'; img-src 'self'; style-src 'self'"


@pytest.mark.long
@pytest.mark.parametrize("name", ["bounce", "tradeoff"])
def test_a_strict_policy_still_shows_the_essentials(
    visit: Visit, reported: Reported, tmp_path: Path, name: str
) -> None:
    """As Jenkins sends it: neither script nor style in the page may run."""
    page = reported(name).read_text()
    meta = f'<meta http-equiv="Content-Security-Policy" content="{STRICT}">'
    strict = tmp_path / "strict.html"
    strict.write_text(page.replace("<head>", f"<head>{meta}", 1))
    shown = visit(strict, script=False).page
    assert shown.locator(".bar svg").bounding_box()["width"] > 300
    assert shown.locator("#runs tbody tr").count() >= 10
    assert shown.locator("#map-picture svg").bounding_box()["height"] > 60
    assert shown.locator("#chart-picture svg").bounding_box()["height"] > 300
    assert "runs not stable" in text(shown, "header")
    assert "timestep" in text(shown, "#recommendation-text")
    assert shown.locator("#labels tbody tr").count() >= 2
    fills = shown.locator("#map-picture .mark-rect path").evaluate_all(
        "cells => [...new Set(cells.map(each => getComputedStyle(each).fill))]"
    )
    assert len(fills) >= 2, "colours do not need the style sheet"


@pytest.mark.night
@pytest.mark.parametrize("media", ["light", "dark", "print"])
def test_words_stand_out_from_the_page(visit: Visit, reported: Reported, media: str) -> None:
    """WCAG's contrast of 4.5 between words and page, of the text and of the charts."""
    scheme = {"color_scheme": "dark" if media == "dark" else "light"}
    page = visit(reported("tradeoff"), "#tab=tradeoff", **scheme).page
    page.click("#tab-map")
    page.wait_for_selector("#map-picture svg .role-axis-label text")
    if media == "print":
        page.emulate_media(media="print", color_scheme="dark")
    colours = page.evaluate(
        """() => {
          const shown = (selector, key) => getComputedStyle(document.querySelector(selector))[key];
          return [shown('body', 'backgroundColor'), shown('body', 'color'),
            shown('.lead, .caption', 'color'), shown('.tile', 'color'),
            shown('#drawer li', 'color'),
            shown('#map-picture svg .role-axis-label text', 'fill'),
            shown('#chart-picture svg .role-title-subtitle text', 'fill')];
        }"""
    )
    back, *front = [luminance(colour) for colour in colours]
    for each in front:
        bright, dark = max(back, each), min(back, each)
        assert (bright + 0.05) / (dark + 0.05) >= 4.5
    assert (back > 0.5) == (media != "dark")


def luminance(colour: str) -> float:
    """Return the relative luminance of a colour, as WCAG defines it."""
    parts = np.array([float(each) for each in re.findall(r"[\d.]+", colour)[:3]]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.long
def test_a_narrow_page_does_not_scroll_sideways(visit: Visit, reported: Reported) -> None:
    page = visit(reported("tradeoff"), device_scale_factor=1).page
    page.set_viewport_size({"width": 390, "height": 800})
    page.reload()
    page.wait_for_selector("body[data-ready]")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


@pytest.mark.long
def test_names_are_text(visit: Visit, swept: Swept, tmp_path: Path) -> None:
    """A name that looks like markup is shown, and does nothing."""
    evil = "</script><b id=evil>&\u2028"
    store = swept("bounce")
    sweep = store.manifest.sweep.model_copy(
        update={
            "scene": evil,
            "name": evil,
            "resolved": {**store.manifest.sweep.resolved, "scene": evil, "description": evil},
        }
    )
    manifest = store.manifest.model_copy(update={"sweep": sweep})
    path = tmp_path / "evil.html"
    with small_films():
        write_page(replace(store, manifest=manifest), path)
    seen = visit(path)
    assert seen.complaints == []
    assert visible(evil) in seen.page.locator("h1").text_content()
    assert seen.page.locator("#evil").count() == 0
    for name in ("columns", "series"):
        assert json.loads(seen.page.locator(f"#{name}").text_content())


@pytest.mark.long
def test_the_script_formats_amounts_with_prefixes(visit: Visit, reported: Reported) -> None:
    """Three digits, a prefix below a tenth of the unit, a power of ten where no prefix helps."""
    page = visit(reported("bounce")).page
    data_script = resources.files("contactlab.page").joinpath("script/data.js").read_text()
    start, end = data_script.index("// Significant digits"), data_script.index("const axisOf")
    code = data_script[start:end] + data_script[data_script.index("const unitless") :]
    shown = page.evaluate(
        "([code, cases]) => new Function('cases', `${code};"
        " return cases.map((each) => amount(...each));`)(cases)",
        [code, [[*each] for each in AMOUNTS]],
    )
    assert shown == list(AMOUNTS.values())
    for (value, unit), text in AMOUNTS.items():
        assert read_amount(text.replace(",", ""), unit) == pytest.approx(value, rel=5e-3)


AMOUNTS = {
    (0.0271703, "m"): "27.2 mm",
    (1.83308e-6, "m"): "1.83 µm",
    (5.89684e-12, "m"): "5.9e-12 m",
    (0.62784, "N s"): "0.628 N s",
    (0.0042, "m/s"): "4.2 mm/s",
    (1.06142e-6, "1"): "1.06e-6",
    (0.000118937, "1/s"): "1.19e-4 1/s",
    (12345.6, "N"): "12346 N",
    (0, "m"): "0 m",
}


@pytest.mark.long
def test_neighboring_ticks_have_different_texts(visit: Visit, reported: Reported) -> None:
    page = visit(reported("bounce")).page
    scripts = resources.files("contactlab.page").joinpath("script")
    data_script, plots = (scripts.joinpath(name).read_text() for name in ("data.js", "plots.js"))
    start, end = data_script.index("// Significant digits"), data_script.index("const number =")
    ticks = plots[plots.index("// Round numbers") : plots.index("function extent")]
    shown = page.evaluate(
        "code => new Function(`${code}; return tickTexts(roundTicks(19.99711, 19.99999, 3));`)()",
        data_script[start:end] + ticks,
    )
    assert shown == ["19.998", "19.999"]


@pytest.mark.long
@pytest.mark.parametrize(("name", "tab"), [("bounce", "physics"), ("tradeoff", "tradeoff")])
def test_words_of_charts_are_readable_on_a_phone(
    visit: Visit, reported: Reported, name: str, tab: str
) -> None:
    """A chart that does not fit scrolls, or wraps its words; it does not shrink."""
    page = visit(reported(name), f"#tab={tab}").page
    page.set_viewport_size({"width": 390, "height": 800})
    page.reload()
    page.wait_for_selector("body[data-ready]")
    scales = page.locator(f"#{tab} .picture svg text").evaluate_all(
        "words => words.map(each => each.getScreenCTM()).map(({a, b}) => Math.hypot(a, b))"
    )
    assert scales
    # Words of 11 pixels, in letters of at least 9.
    assert 11 * min(scales) >= 9
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
