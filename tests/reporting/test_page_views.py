"""What a reader sees of each tab: nothing empty, clipped or written over, and all of it true.

With SCREENSHOTS=FOLDER in the environment each view is stored as a picture to look at.
"""

import csv
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactlab.measure import LABELS
from contactlab.reporting.finding import write_finding
from contactlab.reporting.report import read_report_data
from contactlab.store.finished_store import Store

Swept = Callable[[str], Store]
Reported = Callable[[str], Path]
Visit = Callable[..., Any]
TABS = ("map", "tradeoff", "runs", "parallel", "physics", "changes", "expected")
# Boxes of words within the shown panel and drawer, and of the pictures that they belong to.
LOOK = """() => {
  const seen = (each) => each.checkVisibility() && each.getAttribute('opacity') !== '0'
    && each.textContent.trim();
  const box = (each) => {
    const { left, top, right, bottom } = each.getBoundingClientRect();
    return [left, top, right, bottom];
  };
  const shown = 'main > section:not([hidden])';
  const panel = document.querySelector(shown);
  const pictures = [...document.querySelectorAll(`${shown} svg, #drawer svg`)].filter(
    (each) => each.checkVisibility() && !each.classList.contains('swatch'));
  return {
    height: panel.getBoundingClientRect().height,
    words: panel.textContent.trim().length,
    wide: document.documentElement.scrollWidth,
    pictures: pictures.map((svg) => ({
      box: box(svg),
      texts: [...svg.querySelectorAll('text')].filter(seen).map(
        (each) => [each.textContent, box(each)]),
    })),
  };
}"""


def overlap(one: list[float], other: list[float]) -> float:
    """Return how much of the smaller box lies in the other."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    return max(0.0, width) * max(0.0, height) / max(1e-9, min(areas))


@pytest.mark.night
@pytest.mark.parametrize("width", [1400, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_view_is_empty_clipped_or_written_over(
    visit: Visit, reported: Reported, width: int, scheme: str
) -> None:
    """Words of a picture lie within it; a haloed one of parallel coordinates may touch another."""
    for tab in TABS:
        seen = visit(reported("bounce"), f"#tab={tab}", color_scheme=scheme)
        page = seen.page
        page.set_viewport_size({"width": width, "height": 900})
        page.reload()
        page.wait_for_selector("body[data-ready]")
        if folder := os.environ.get("SCREENSHOTS"):
            page.screenshot(path=Path(folder) / f"{tab}-{width}-{scheme}.png", full_page=True)
        look = page.evaluate(LOOK)
        assert look["height"] > 80, tab
        assert look["words"] > 20, tab
        assert look["wide"] <= width, tab
        for picture in look["pictures"]:
            left, top, right, bottom = picture["box"]
            for text, box in picture["texts"]:
                beyond = max(left - box[0], top - box[1], box[2] - right, box[3] - bottom)
                assert beyond <= 2, (tab, text)
            if tab == "parallel":
                continue
            for place, (text, box) in enumerate(picture["texts"]):
                for other, beside in picture["texts"][:place]:
                    # The same words twice are a text and its halo.
                    assert text == other or overlap(box, beside) < 0.25, (tab, text, other)
        page.context.close()


@pytest.mark.long
def test_the_page_says_what_was_found(visit: Visit, reported: Reported, swept: Swept) -> None:
    page = visit(reported("bounce")).page
    data = read_report_data(swept("bounce"))
    assert page.inner_text("#finding") == write_finding(data.axes, data.labels)
    failing = 12 - swept("bounce").manifest.labels["stable"]
    assert page.inner_text(".tile").split() == [str(failing), "of", "12", "runs", "not", "stable"]
    assert page.inner_text("h1") == "ball_drop: 12 runs"


@pytest.mark.long
def test_dragging_along_an_axis_chooses_runs(
    visit: Visit, reported: Reported, swept: Swept
) -> None:
    """The runs with the upper of two values of the first axis; a click chooses all again."""
    page = visit(reported("bounce"), "#tab=parallel").page
    [first, *_] = read_report_data(swept("bounce")).axes
    upper = int((first.codes == len(first.ticks) - 1).sum())
    reading = page.locator("#parallel-picture .reading")
    assert reading.inner_text().startswith("12 of 12 runs")
    box = page.locator("#parallel-picture .axis").first.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"]
    page.mouse.move(x, y + 2)
    page.mouse.down()
    page.mouse.move(x, y + box["height"] / 6, steps=4)
    page.mouse.up()
    assert reading.inner_text().startswith(f"{upper} of 12 runs")
    assert page.locator("#run-list li").count() == upper
    page.mouse.click(x, y + box["height"] / 2)
    assert reading.inner_text().startswith("12 of 12 runs")


@pytest.mark.long
def test_a_label_has_one_colour_on_the_page(visit: Visit, reported: Reported) -> None:
    page = visit(reported("bounce")).page
    fill = "each => [...new Set(each.map((one) => getComputedStyle(one).fill))]"
    chips = page.locator("#chips .swatch rect").evaluate_all(fill)
    cells = page.locator("#map-picture .mark-rect").first.locator("path").evaluate_all(fill)
    assert set(cells) == set(chips)


@pytest.mark.long
def test_runs_are_sorted_searched_filtered_and_saved(
    visit: Visit, reported: Reported, swept: Swept
) -> None:
    """The order is that of the numbers, the CSV has every run with its numbers."""
    page = visit(reported("bounce"), "#tab=runs").page
    store = swept("bounce")
    page.click("[data-sort=penetration_max]")
    heads = page.locator("#run-table thead th").all_inner_texts()
    place = next(at for at, name in enumerate(heads) if "penetration_max" in name)
    rows = page.locator("#run-table tbody tr")
    shown = [float(row.locator("th, td").nth(place).inner_text()) for row in rows.all()]
    known = store.columns.numbers("penetration_max").values
    assert "[mm]" in heads[place]  # the deepest is less than a tenth of a meter
    assert [depth / 1e3 for depth in shown] == pytest.approx(
        sorted(known.tolist(), reverse=True), rel=1e-3
    )
    page.fill("#run-table input[type=search]", "stable 0.9")
    labels = store.columns.to_pydict(["label", "restitution"])
    wanted = [pair for pair in zip(*labels.values(), strict=True) if pair == ("stable", 0.9)]
    assert rows.count() == len(wanted)
    page.fill("#run-table input[type=search]", "")
    chip = page.locator("#chips button").first
    name, count = chip.inner_text().split("\n")[-1].rsplit(" ", 1)
    chip.click()
    assert rows.count() == int(count) == store.manifest.labels[name.split()[-1]]
    chip = page.locator("#chips button").first
    chip.click()
    with page.expect_download() as download:
        page.click("#run-table button:text('CSV')")
    text = Path(download.value.path()).read_text()
    saved = {row["run"]: row for row in csv.DictReader(io.StringIO(text))}
    assert {*saved} == {*map(str, store.columns.run_ids)}
    for run, depth in zip(store.columns.run_ids, known.tolist(), strict=True):
        assert float(saved[str(run)]["penetration_max"]) == pytest.approx(depth, rel=1e-6)


@pytest.mark.long
def test_what_to_change_is_the_nearest_stable_run(
    visit: Visit, reported: Reported, swept: Swept
) -> None:
    """By a loop over all pairs: no stable run that is clearly better differs in fewer settings.

    A run is clearly better if a metric of the failing labels differs by more than a tenth.
    """
    store = swept("bounce")
    data = read_report_data(store)
    settings = np.stack([axis.codes for axis in data.axes], axis=1)
    failed = np.flatnonzero(data.labels.failed)
    found = 0
    for row in failed.tolist():
        page = visit(reported("bounce"), f"#run={store.columns.run_ids[row]}").page
        labels = [LABELS[each.label] for each in store.record_at(row).labels]
        names = {threshold.name for label in labels for threshold in label.thresholds}
        stored = names & {*store.columns.metric_columns}
        known = [store.columns.numbers(name).values for name in stored]
        better = list[int]()
        for other in np.flatnonzero(~data.labels.failed).tolist():
            pairs = [(each[row], each[other]) for each in known]
            finite = [(here, there) for here, there in pairs if np.isfinite([here, there]).all()]
            if not finite or any(abs(here - there) > 0.1 * abs(here) for here, there in finite):
                better.append(int((settings[row] != settings[other]).sum()))
        text = page.inner_text("#run .change")
        assert text.count("→") == min(better, default=0)
        assert ("hardly better" in text) == (not better)
        found += bool(better)
    assert found


@pytest.mark.long
def test_tabs_follow_the_keyboard_and_the_address(visit: Visit, reported: Reported) -> None:
    page = visit(reported("bounce")).page
    page.focus("#tab-map")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("document.activeElement.id") == "tab-tradeoff"
    assert page.get_attribute("#tab-tradeoff", "aria-selected") == "true"
    assert page.locator("main > section:visible").evaluate_all("s => s.map(e => e.id)") == [
        "tradeoff"
    ]
    page.reload()
    page.wait_for_selector("body[data-ready]")
    assert page.locator("#tradeoff").is_visible()
    assert not page.locator("#map").is_visible()


def test_charts_that_a_page_does_not_check_follow_their_schema(
    swept: Callable[[str], Store],
) -> None:
    """A page leaves out the checks of Altair, which take longer than its charts."""
    pytest.importorskip("altair", reason="charts are an extra")
    from contactlab.page.heatmap import label_map, number_map  # noqa: PLC0415 - an extra

    data = read_report_data(swept("bounce"))
    for chart in (label_map(data.map_axes, data.labels), number_map(None, np.empty((0, 0)), "")):
        spec = chart.to_dict(validate=True)
        assert chart.to_dict(validate=False) == spec
