"""The page that simulates, opened from disk without a network."""

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import mujoco
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from tests.reporting.conftest import run

from contactlab.errors import OutputError
from contactlab.live.browser_build import BrowserBuild, find_build
from contactlab.live.live_page import write_live_page
from contactlab.store.finished_store import Store

pytestmark = pytest.mark.long

ENDING = "</script></title><script>window.hit=1</script><iframe src=//example.org></iframe>"
RAMP = """<mujoco><worldbody>
  <geom name="ramp" type="plane" size="2 2 .1" euler="0 20 0" friction="1"/>
  <body name="box" pos="0 0 .0535" euler="0 20 0"><freejoint/>
    <geom name="box" type="box" size=".1 .1 .05" mass="1" friction="1"/></body>
</worldbody></mujoco>
"""
HOSTILE = "<img src=x onerror='window.hit=1'>"
HOSTILE_MODEL = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="b" pos="0 0 .03"><freejoint/><geom name="{name}" size=".1"/></body></worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def build() -> BrowserBuild:
    try:
        return find_build()
    except OutputError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def live(
    swept: Callable[[str], Store], build: BrowserBuild, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Path]:
    """Give the page that simulates of one of the sweeps, each of which is written once."""
    del build

    @cache
    def give(name: str) -> Path:
        path = tmp_path_factory.mktemp("live") / f"{name}.html"
        write_live_page(swept(name), path)
        return path

    return give


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
    live: Callable[[str], Path],
    name: str,
) -> None:
    """Bit for bit where the versions are one; else the page says by how much."""
    store = swept(name)
    assert live(name).stat().st_size < 16e6
    seen = visit(live(name))
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
    visit: Callable[..., Any], live: Callable[[str], Path]
) -> None:
    page = visit(live("grasp")).page
    first = page.evaluate("live.end()")
    page.locator("#time").fill("37")
    page.keyboard.press("Escape")
    page.locator("#step").click()
    assert page.locator("body").get_attribute("data-step") == "38"
    assert page.evaluate("live.end()") == first


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A store whose model, name and records a stranger wrote, for a browser to run them."""
    folder = tmp_path_factory.mktemp("hostile")
    name = HOSTILE.replace("<", "&lt;").replace(">", "&gt;")
    (folder / "model.xml").write_text(HOSTILE_MODEL.format(name=name))
    sweep = (
        f"{{version: 1, scene: {folder}/model.xml, duration: 0.02, axes: {{timestep: [2.0e-3]}}}}"
    )
    run(sweep, folder, json.dumps(HOSTILE)[1:-1])
    path = folder / "store/runs.parquet"
    table = parquet.read_table(path)
    for column in ("label_reason", "status_reason", "engine_version"):
        place = table.schema.get_field_index(column)
        text = pa.array([ENDING] * len(table), table.schema.field(column).type)
        table = table.set_column(place, table.schema.field(column), text)
    place = table.schema.get_field_index("label_reasons")
    texts = [[ENDING] * len(labels) for labels in table["labels"].to_pylist()]
    reasons = pa.array(texts, table.schema.field("label_reasons").type)
    parquet.write_table(table.set_column(place, table.schema.field("label_reasons"), reasons), path)
    # He states the bent table's hash, too.
    manifest = json.loads((folder / "store/manifest.json").read_text())
    manifest["files"]["runs.parquet"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (folder / "store/manifest.json").write_text(json.dumps(manifest))
    return Store.open(folder / "store")


def test_hostile_text_of_a_store_is_text(
    hostile: Store, visit: Callable[..., Any], build: BrowserBuild, tmp_path: Path
) -> None:
    del build
    write_live_page(hostile, tmp_path / "live.html")
    fragment = "#" + urlencode({"run": ENDING, "timestep": ENDING, "__proto__": ENDING})
    seen = visit(tmp_path / "live.html", fragment)
    page = seen.page
    assert HOSTILE in page.inner_text("#depth")
    assert page.inner_text("h1").startswith(HOSTILE)
    assert ENDING in page.inner_text("#finding")
    assert ENDING in page.inner_text("#notes")
    page.evaluate("live.compareWithRecord()")
    page.locator("#mjcf").click()
    assert "onerror" in page.locator("#text").input_value()
    assert page.evaluate("document.querySelectorAll('img, iframe, object').length") == 0
    assert page.evaluate("window.hit") is None
    assert [url for url in seen.requests if not url.startswith(("file:", "blob:"))] == []


ATTEMPTS = [
    ("add('script', {textContent: 'window.hit = 2'})", "script-src"),
    ("add('b', {}).setAttribute('onclick', 'window.hit = 3')", "script-src"),
    # What a debugger evaluates, as here, may itself evaluate; a timer's text is the page's own.
    ("setTimeout('window.hit = 4')", "script-src"),
    ("fetch('https://example.org').catch(() => undefined)", "connect-src"),
    ("add('img', {src: 'https://example.org/a.png'})", "img-src"),
    ("add('iframe', {src: 'https://example.org'})", "frame-src"),
    ("new Worker('data:text/javascript,')", "worker-src"),
]


def test_the_policy_lets_in_neither_code_nor_network(
    hostile: Store, visit: Callable[..., Any], build: BrowserBuild, tmp_path: Path
) -> None:
    """Even if a hole were found: each attempt is made by the page itself, past all escaping."""
    del build
    write_live_page(hostile, tmp_path / "live.html")
    seen = visit(tmp_path / "live.html")
    for attempt, directive in ATTEMPTS:
        violated = seen.page.evaluate(
            f"""() => new Promise(resolve => {{
              addEventListener("securitypolicyviolation", event => {{
                if (event.effectiveDirective.startsWith("{directive}")) resolve("{directive}");
              }});
              setTimeout(() => resolve("nothing"), 5000);
              const add = (tag, parts) => {{
                const made = Object.assign(document.createElement(tag), parts);
                document.body.append(made);
                return made;
              }};
              try {{ {attempt}; }} catch {{ }}
            }})"""
        )
        assert violated == directive, attempt
        assert seen.page.evaluate("window.hit") is None


def test_a_bent_model_is_told_and_ends_nothing(
    visit: Callable[..., Any], live: Callable[[str], Path]
) -> None:
    """What is packed into the page is bent: the engine refuses it, and the page lives on."""
    page = visit(live("bounce")).page
    page.evaluate(
        """async () => {
          await live.making;
          const model = live.page.models[0];
          delete model.bytes;
          model.alone = "<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>";
          live.models.read.clear();
          await live.make();
        }"""
    )
    assert "does not read this model" in page.inner_text("#message")
    page.keyboard.press("Space")
    assert page.locator("body").get_attribute("data-playing") == "false"
    assert page.locator("#play").is_disabled()


def test_noslip_switched_on_ends_the_creep(
    visit: Callable[..., Any], build: BrowserBuild, tmp_path: Path
) -> None:
    """A box on a ramp that friction holds creeps by softness; noslip leaves a hundredth of it."""
    del build
    path = tmp_path / "ramp.xml"
    path.write_text(RAMP)
    made = ["-o", str(tmp_path / "made"), "--duration", "1s", "--drive", "none", "--live"]
    subprocess.run([sys.executable, "-m", "contactlab", str(path), *made], check=True)
    page = visit(tmp_path / "made/page.live.html").page

    def crept() -> float:
        first, last = (
            np.array(page.evaluate(f"(live.seek({step}), [...live.simulation.data.qpos])"))
            for step in (150, 499)
        )
        return float(np.linalg.norm(last[:3] - first[:3]))

    as_written = crept()
    page.locator("input[data-switch='noslip']").check()
    page.evaluate("live.making")
    assert crept() < as_written / 100
    assert "noslip=on" in page.evaluate("location.hash")
    model = mujoco.MjModel.from_xml_string(page.evaluate("live.mjcf()"))
    assert model.opt.noslip_iterations == 10
