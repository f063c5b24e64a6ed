"""Noise floors against a slow and obvious loop, and as `show` and the page tell them."""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.planted_recordings import plant

from contactlab.page.report_files import write_page
from contactlab.page.sentences import closest_settings, compared_settings, reality_sentence
from contactlab.reporting.report import PageRequest, read_report_data
from contactlab.reporting.start_noise import distance_to_reality, noise_floor
from contactlab.run.sweep_request import SceneLoader, read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

NOISE = "perturb: {coordinates: {puck.x: 1.0e-3, puck.vx: 0.02}}\n"


def slow_floor(keys: list[Any], values: list[float]) -> float | None:
    """Return the mean over keys of the mean distance of pairs."""
    floors: list[float] = []
    for key in sorted(set(keys)):
        here = [b for a, b in zip(keys, values, strict=True) if a == key and np.isfinite(b)]
        if pairs := [abs(a - b) for a, b in combinations(here, 2)]:
            floors.append(sum(pairs) / len(pairs))
    return sum(floors) / len(floors) if floors else None


def test_the_floor_is_the_mean_distance_of_pairs() -> None:
    rng = np.random.default_rng(2)
    keys, values = rng.integers(0, 30, size=90), rng.normal(size=90)
    values[rng.integers(0, 90, size=9)] = np.nan
    assert noise_floor(keys, values) == pytest.approx(slow_floor(keys.tolist(), values.tolist()))
    assert noise_floor(np.arange(4), np.arange(4.0)) is None
    assert noise_floor(np.zeros(3, np.int64), np.array([1, np.nan, np.nan])) is None


@pytest.mark.long
def test_show_and_page_tell_it_beside_the_error(tmp_path: Path) -> None:
    """Only runs that differ in seed or perturbation count, also where an axis is drawn in bins."""
    scene = plant(tmp_path / "puck", 0.3, seed=5, trials=3)
    manifest = tmp_path / "puck" / "scene.yaml"
    manifest.write_text(manifest.read_text() + NOISE)
    frictions = np.linspace(0.2, 0.4, 41).round(6).tolist()
    text = f"version: 1\nscene: {scene}\ntrace: none\nchecks: none\nseeds: 2\naxes:\n"
    text += f"  recorded_run: [0, 2]\n  friction.slide: {frictions}\n  perturbation: [0, 1]\n"
    ask = read_request(text, "noise", tmp_path / "store", folder=tmp_path, workers=0)
    run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
    data = read_report_data(Store.open(ask.store))
    rows = data.store.table.to_pylist()
    keys = [(row["recorded_run"], row["friction.slide"]) for row in rows]
    floor = slow_floor(keys, [row["reality"] for row in rows])
    assert floor is not None
    assert f" moves a run by {floor:.3g}" in distance_to_reality(data.axes, data.store.columns)
    assert f"Noise of the start alone moves a run by {floor:.3g} on" in reality_sentence(data)
    header, _, floors = closest_settings(data)
    settings = compared_settings(data)
    assert [len(each.rows) for each in settings] == [8] * len(frictions)
    assert sorted(each.name for each in settings) == [f"friction.slide {x:g}" for x in frictions]
    assert floors[header.index("mean reality")] == f"{floor:.3g}"
    turned = slow_floor(keys, [row["reality_rotation"] for row in rows])
    assert floors[header.index("mean reality_rotation [rad]")] == f"{turned:.3g}"
    write_page(data.store, tmp_path / "page.html", PageRequest(traces=0))
    assert '<th scope="row">start noise</th>' in (tmp_path / "page.html").read_text()


def test_each_coordinate_has_noise_of_its_own(tmp_path: Path) -> None:
    """A seed moves each by at most what is declared, and a scale counts for all."""
    scene = plant(tmp_path / "puck", 0.3, seed=5, trials=3)
    manifest = tmp_path / "puck" / "scene.yaml"
    manifest.write_text(manifest.read_text() + NOISE.replace("}}", "}, scale: 3}"))
    opened = SceneLoader(Path()).open(scene)
    runs = [opened.resolve({"perturbation": 1.0}, seed, None) for seed in range(40)]
    calm = opened.initial_states([opened.resolve({"perturbation": 0.0}, 0, None)])
    starts = opened.initial_states(runs)
    for values, still, most in (
        (starts.qpos[:, 0], calm.qpos[0, 0], 3e-3),
        (starts.qvel[:, 0], calm.qvel[0, 0], 0.06),
    ):
        assert 0.8 * most < np.abs(values - still).max() <= most
    assert np.all(starts.qpos[:, 1] == calm.qpos[0, 1])
