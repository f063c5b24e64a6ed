"""Pages on a phone: no page is wider than its window, and causes are next to their names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.small_films import small_films

import contactlab
from contactlab.page.front_page import build_front_page
from contactlab.page.report_files import write_page
from contactlab.rendering.document import Facts, document_of, table_of
from contactlab.reporting.report import PageRequest
from contactlab.schema.examination import Examination
from contactlab.store.finished_store import Store

Visit = Callable[..., Any]
BLOCK = """
<mujoco>
  <option timestep=".01"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1" group="3"/></body>
  </worldbody>
</mujoco>
"""
LONG = "a cause in many words, of contact_of_the_left_front_foot_with_the_uneven_floor_of_the_hall"
# Left sides of the texts of each list of causes, and the bottom of the first list.
LISTS = """() => [...document.querySelectorAll('dl.causes')].map((list) => ({
  left: [...new Set([...list.querySelectorAll('dd')].map(
    (each) => each.getBoundingClientRect().left))],
  names: [...list.querySelectorAll('dt')].map((each) => each.getBoundingClientRect().right),
  narrowest: Math.min(...[...list.querySelectorAll('dd')].map((each) => each.clientWidth)),
}))"""


@pytest.fixture(scope="module")
def examined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of an examination with several long causes."""
    folder = tmp_path_factory.mktemp("examined")
    (folder / "block.xml").write_text(BLOCK)
    with small_films():
        report = contactlab.examine(
            folder / "block.xml", output=folder / "out", duration=0.3, workers=1
        )
        assert isinstance(report, Examination)
        report = report.model_copy(update={"why": (LONG, LONG, LONG), "fix": LONG})
        write_page(
            Store.open(folder / "out" / "run"),
            folder / "page.html",
            PageRequest(examination=report),
        )
    return folder / "page.html"


@pytest.mark.long
@pytest.mark.parametrize("width", [390, 1100, 1440])
def test_causes_of_an_examination_are_next_to_their_names(
    visit: Visit, examined: Path, width: int
) -> None:
    page = visit(examined).page
    page.set_viewport_size({"width": width, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    lists = page.evaluate(LISTS)
    assert lists
    for each in lists:
        assert len(each["left"]) == 1
        assert max(each["names"]) <= each["left"][0]
        assert each["narrowest"] > 0.7 * width - 30
    sizes = "each => [each.scrollWidth, each.parentElement.clientWidth]"
    table, room = page.locator("table.budget").first.evaluate(sizes)
    assert table <= room
    fix = page.locator("dl.causes dd").nth(3).bounding_box()
    assert fix["y"] + fix["height"] < 844
    assert "page.html" not in page.inner_text("body")
    if width == 390:
        bar, row = (page.locator(f".bars tbody {part}").first for part in (".along svg", "tr"))
        assert bar.bounding_box()["width"] > 300
        assert row.bounding_box()["width"] <= 390


@pytest.mark.long
def test_a_page_of_a_search_fits_a_phone(visit: Visit, tmp_path: Path) -> None:
    values = [[LONG, number, number / 3, LONG] for number in range(9)]
    body = document_of(
        [Facts((("why", LONG), ("", LONG))), table_of(("name", "a", "b", "c"), values)]
    )
    spec = {
        "mark": "point",
        "width": 640,
        "data": {"values": [{"x": 1}]},
        "encoding": {"x": {"field": "x", "type": "quantitative"}},
    }
    (tmp_path / "front.html").write_text(
        build_front_page(LONG, body, {"wide": spec, "narrow": spec})
    )
    page = visit(tmp_path / "front.html", script=False).page
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
