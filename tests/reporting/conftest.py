"""Reports of real, small sweeps."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.small_films import small_films

from contactlab.page.report_files import write_page
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

BOUNCE = """
version: 1
scene: ball_drop
description: Bounces, of which the longest step makes nonsense
duration: 1.0
axes:
  restitution: {values: [0.2, 0.9], role: scenario}
  timestep: [5.0e-4, 2.0e-3, 2.0e-2]
  drop_height: {values: [0.5, 1.0], role: scenario}
expect:
  - {where: {timestep: 5.0e-4}, label: stable, reason: the step is short}
  - {where: {timestep: 2.0e-2}, label: stable, reason: "a mistake, to be shown"}
"""
# Some configurations fail, some are beyond a tolerance, some are feasible.
TRADEOFF = """
version: 1
scene: ball_drop
duration: 0.8
seeds: 2
axes:
  timestep: [2.5e-4, 5.0e-4, 1.0e-3, 2.0e-3, 2.0e-2]
  integrator: [Euler, RK4]
  solref: ["-40000 -72.4", "-160000 -144.7"]
  drop_height: {values: [0.5, 1.0], role: scenario}
tolerances: {oracle_error: 0.02, penetration_max: 1.0e-2}
trace: none
checks: none
"""
HARD = """
version: 1
scene: deep_overlap
trace: flagged
axes:
  overlap: {values: [0.01, 0.05, 0.12], role: scenario}
zip:
  - solref: ["0.02 1", "0.005 1", "0.005 1"]
    timestep: [1.0e-3, 2.5e-4, 2.0e-3]
expect:
  - {where: {overlap: 0.12}, label: tunneling}
"""
HAND_HELD = """
version: 1
scene: grasp_mug
duration: 0.6
trace: all
axes:
  timestep: [2.0e-3, 4.0e-3]
  cone: [elliptic, pyramidal]
"""
# Sliding begins at atan(0.5) = 26.565 degrees.
INCLINE = """
version: 1
scene: incline
duration: 0.2
trace: none
checks: none
axes:
  tilt: {values: [20, 26, 27, 30], role: scenario}
  direction: {values: [0, 45], role: scenario}
  cone: [elliptic, pyramidal]
"""
SWEEPS = {
    "bounce": BOUNCE,
    "tradeoff": TRADEOFF,
    "hard": HARD,
    "grasp": HAND_HELD,
    "incline": INCLINE,
}
CHROMIUM = Path("/usr/bin/chromium")


def run(text: str, folder: Path, name: str = "tried") -> Store:
    """Run a sweep, given as text, into a store."""
    ask = read_request(text, name, folder / "store", folder=folder, workers=0)
    run_sweep(ask, lambda *_: None, lambda _: None)
    return Store.open(ask.store)


@pytest.fixture(scope="session")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Store]:
    """Give the store of one of the sweeps, each of which is run once."""
    stores: dict[str, Store] = {}

    def give(name: str) -> Store:
        if name not in stores:
            stores[name] = run(SWEEPS[name], tmp_path_factory.mktemp(name), name)
        return stores[name]

    return give


@pytest.fixture(scope="session")
def reported(
    swept: Callable[[str], Store], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Path]:
    """Give the page of one of the sweeps."""
    pages: dict[str, Path] = {}

    def give(name: str) -> Path:
        if name not in pages:
            pages[name] = tmp_path_factory.mktemp("page") / f"{name}.html"
            with small_films():
                write_page(swept(name), pages[name])
        return pages[name]

    return give


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Debian's Chromium, driven by Playwright."""
    api = pytest.importorskip("playwright.sync_api", reason="needs Playwright")
    if not CHROMIUM.exists():
        pytest.skip(f"needs Chromium at {CHROMIUM}")
    with api.sync_playwright() as driver:
        started = driver.chromium.launch(
            executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-gpu"]
        )
        yield started
        started.close()


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """Open a page; what it logs and asks of a network is kept beside it."""
    contexts: list[Any] = []

    def go(path: Path, fragment: str = "", *, script: bool = True, **context: Any) -> Any:
        opened = browser.new_context(
            viewport={"width": 1200, "height": 900}, java_script_enabled=script, **context
        )
        contexts.append(opened)
        page = opened.new_page()
        seen = SimpleNamespace(page=page, complaints=[], requests=[])
        page.on("console", lambda each: seen.complaints.append(f"{each.type}: {each.text}"))
        page.on("pageerror", lambda each: seen.complaints.append(str(each)))
        page.on("request", lambda each: seen.requests.append(each.url))
        page.goto(path.as_uri() + fragment)
        if script:
            page.wait_for_selector("body[data-ready]", timeout=60_000)
        return seen

    yield go
    for each in contexts:
        each.close()
