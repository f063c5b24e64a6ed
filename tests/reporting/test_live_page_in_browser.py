"""The page that simulates, opened from disk without a network."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from tests.reporting.conftest import run

from contactlab.errors import OutputError
from contactlab.live.browser_build import BrowserBuild, find_build
from contactlab.live.live_page import write_live_page
from contactlab.store.finished_store import Store

pytestmark = pytest.mark.long

HOSTILE = "<img src=x onerror='window.hit=1'>"
HOSTILE_MODEL = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="b" pos="0 0 .09"><freejoint/><geom name="{name}" size=".1"/></body></worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def build() -> BrowserBuild:
    try:
        return find_build()
    except OutputError as error:
        pytest.skip(str(error))


def state_of(end: dict[str, list[float]]) -> np.ndarray:
    return np.array([*end["qpos"], *end["qvel"]])


def stored_end(store: Store, run_id: str) -> np.ndarray:
    trace = store.trace(store.record(run_id))
    return np.concatenate([trace.qpos[-1], trace.qvel[-1]])


def move(page: Any, axis: str, place: int) -> None:
    page.locator(f"input[data-axis='{axis}']").fill(str(place))
    page.evaluate("live.making")


@pytest.mark.parametrize("name", ["bounce", "grasp"])
def test_the_last_state_is_held_against_the_record(
    swept: Callable[[str], Store],
    visit: Callable[..., Any],
    build: BrowserBuild,
    tmp_path: Path,
    name: str,
) -> None:
    """Bit for bit where the versions are one; else the page says by how much."""
    store = swept(name)
    write_live_page(store, tmp_path / "live.html")
    assert (tmp_path / "live.html").stat().st_size < 16e6
    seen = visit(tmp_path / "live.html")
    page = seen.page
    for run_id in [*page.locator("#run option").evaluate_all("all => all.map(e => e.value)")][:3]:
        page.select_option("#run", run_id)
        page.evaluate("live.making")
        page.evaluate("live.compareWithRecord()")
        stored = stored_end(store, run_id)
        made = state_of(page.evaluate("live.end()"))
        said = float(page.locator("#verdict").get_attribute("data-difference"))
        assert said == pytest.approx(np.abs(made - stored).max(), abs=5e-324)
        if build.mujoco == mujoco.__version__ and name == "bounce":
            assert made.tobytes() == stored.tobytes()
        # Releases of MuJoCo part by 5e-6 in these runs.
        assert said < 1e-4
        words = page.inner_text("#verdict")
        assert ("bit for bit" in words) == (made.tobytes() == stored.tobytes())
    assert [url for url in seen.requests if not url.startswith(("file:", "blob:", "data:"))] == []
    assert [text for text in seen.complaints if "error" in text.lower()] == []


def test_a_slider_leads_to_the_other_runs_end_and_the_link_holds_it(
    swept: Callable[[str], Store],
    visit: Callable[..., Any],
    build: BrowserBuild,
    tmp_path: Path,
) -> None:
    del build
    store, path = swept("bounce"), tmp_path / "live.html"
    ids = {tuple(record.axes.values()): record.run_id for record in store.records()}
    one, other = ids[0.9, 5e-4, 1.0], ids[0.9, 2e-3, 1.0]
    write_live_page(store, path, [one, other])
    page = visit(path).page
    stops = page.evaluate(f"live.page.runs.find(r => r.id === '{one}').sliders[1].stops")
    move(page, "timestep", [stop["text"] for stop in stops].index("0.002"))
    moved = state_of(page.evaluate("live.end()"))
    again = visit(path, page.evaluate("location.hash")).page
    np.testing.assert_array_equal(state_of(again.evaluate("live.end()")), moved)
    model = mujoco.MjModel.from_xml_string(again.evaluate("live.mjcf()"))
    assert model.opt.timestep == 2e-3
    assert model.nkey == 1
    page.select_option("#run", other)
    page.evaluate("live.making")
    np.testing.assert_array_equal(state_of(page.evaluate("live.end()")), moved)
    np.testing.assert_allclose(moved, stored_end(store, other), rtol=0, atol=1e-12)


def test_going_back_in_time_changes_no_bit(
    swept: Callable[[str], Store], visit: Callable[..., Any], build: BrowserBuild, tmp_path: Path
) -> None:
    del build
    write_live_page(swept("grasp"), tmp_path / "live.html")
    page = visit(tmp_path / "live.html").page
    first = page.evaluate("live.end()")
    page.locator("#time").fill("37")
    page.keyboard.press("Escape")
    page.locator("#step").click()
    assert page.locator("body").get_attribute("data-step") == "38"
    assert page.evaluate("live.end()") == first


def test_hostile_names_are_text(
    visit: Callable[..., Any], build: BrowserBuild, tmp_path: Path
) -> None:
    del build
    name = HOSTILE.replace("<", "&lt;").replace(">", "&gt;")
    (tmp_path / "model.xml").write_text(HOSTILE_MODEL.format(name=name))
    sweep = (
        f"{{version: 1, scene: {tmp_path}/model.xml, duration: 0.02, axes: {{timestep: [2.0e-3]}}}}"
    )
    store = run(sweep, tmp_path, json.dumps(HOSTILE)[1:-1])
    write_live_page(store, tmp_path / "live.html")
    page = visit(tmp_path / "live.html").page
    assert HOSTILE in page.inner_text("#depth")
    assert page.evaluate("document.querySelectorAll('img').length") == 0
    assert page.evaluate("window.hit") is None
    # Neither script of others, nor anything from a network, is let in.
    violated = page.evaluate(
        """() => new Promise(resolve => {
          addEventListener("securitypolicyviolation", event => resolve(event.effectiveDirective));
          const script = document.createElement("script");
          script.textContent = "window.hit = 2";
          document.body.append(script);
        })"""
    )
    assert violated.startswith("script-src")
    assert page.evaluate("window.hit") is None
    assert "connect" in page.evaluate(
        """() => new Promise(resolve => {
          addEventListener("securitypolicyviolation", event => resolve(event.effectiveDirective));
          fetch("https://example.org").catch(() => undefined);
        })"""
    )
