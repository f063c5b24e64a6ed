"""Effects that recordings call for: those that they were made with, and no others."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.errors import SceneError
from contactlab.studies.effects.effects_request import EffectsRequest, read_setup
from contactlab.studies.effects.recorded_effects import compare_distances, study_recordings
from contactlab.tasks.session import Session

BALL = """<mujoco><option timestep="0.004" cone="elliptic"/>
<default><geom condim="{condim}" friction="1 .005 .004"/></default><worldbody>
<geom name="floor" type="plane" size="9 9 .1"/>
<body name="ball" pos="0 0 .05"><freejoint name="ball"/>
<geom name="ball" type="sphere" size=".05"/></body></worldbody></mujoco>"""
SCENE = """\
version: 1
title: t
description: d
duration: 1.0
pairs: [{geoms: [floor, ball], slots: 1}]
recording: {file: motion.csv, run: trial, units: {length: m, angle: rad, time: s}}
"""


def rolled(folder: Path, condim: int, trials: int = 30) -> str:
    """Write a scene of a ball without rolling friction, and rolls that were recorded with a condim.

    Positions have the noise of sensors, 0.3 mm.
    """
    (folder / "scene.xml").write_text(BALL.format(condim=3))
    (folder / "scene.yaml").write_text(SCENE)
    model = mujoco.MjModel.from_xml_string(BALL.format(condim=condim))
    rng, lines = np.random.default_rng(1), ["trial,time,ball.x,ball.y,ball.z"]
    for trial in range(trials):
        data = mujoco.MjData(model)
        data.qvel[:2] = rng.normal(size=2)
        for frame in range(100):
            place = data.qpos[:3] + 3e-4 * rng.normal(size=3)
            lines.append(",".join(map(repr, [trial, frame / 125, *place.tolist()])))
            mujoco.mj_step(model, data, nstep=2)
    (folder / "motion.csv").write_text("\n".join(lines) + "\n")
    return f"{folder}/"


@pytest.mark.night
@pytest.mark.parametrize(("condim", "missing"), [(6, True), (3, False)])
def test_rolling_friction_is_missing_if_the_recordings_had_it(
    tmp_path: Path, condim: int, missing: bool
) -> None:
    """Rolling friction changes every roll, but only one of two recordings has it."""
    request = EffectsRequest(rolled(tmp_path, condim), write=tmp_path / "small" / "ball.xml")
    report = study_recordings(request, Session(tmp_path / "stores", 0))
    found = {each.name: each for each in report.effects if each.adds}
    assert found["rolling_friction"].verdict == ("missing" if missing else "not needed")
    names = [each.name for each in report.effects if each.verdict == "missing"]
    assert names == (["rolling_friction"] if missing else [])
    added = report.smaller.added if report.smaller else ()
    assert ("rolling_friction" in added) == missing
    if missing:
        assert report.smaller
        assert report.smaller.file == str(tmp_path / "small" / "ball.xml")
        made = mujoco.MjModel.from_xml_path(report.smaller.file)
        assert made.geom_condim.max() == 6


@pytest.mark.parametrize(
    ("shift", "noise", "words"),
    [
        (0.2, 0.01, {"is_farther"}),
        (-0.2, 0.01, {"is_closer", "is_kept"}),
        (0.02, 0.001, {"is_kept"}),  # less than a twentieth of the distance
        (-0.02, 0.001, {"is_kept"}),
        (0.2, 2.0, set()),  # less than three standard errors
        (-0.2, 2.0, set()),
    ],
)
def test_the_mean_over_recorded_runs_counts(shift: float, noise: float, words: set[str]) -> None:
    base = np.linspace(0.5, 1.5, 30)
    other = base + shift + noise * np.tile([-1, 1], 15)
    found = compare_distances(base.tolist(), other.tolist())
    names = ("is_closer", "is_farther", "is_kept")
    assert {name for name in names if getattr(found, name)} == words
    assert found.change == pytest.approx(shift)
    assert found.limit == pytest.approx(0.05)
    assert found.spread == pytest.approx(3 * noise / np.sqrt(29))


def test_runs_that_end_early_are_farther() -> None:
    whole = compare_distances([0.1, 0.2, 0.3], [0.1, 0.1, 0.1], 0.5)
    early = compare_distances([0.1, 0.2, 0.3], [0.1, 0.1, None], 0.5)
    assert (whole.is_farther, early.is_farther, early.is_kept) == (False, True, False)


def test_a_scene_without_a_recording_is_refused() -> None:
    with pytest.raises(SceneError, match="needs a scene with a `recording`"):
        read_setup(EffectsRequest("box_slide"), recordings=True)


def test_fresh_scenarios_are_other_recorded_runs(tmp_path: Path) -> None:
    sweep = {"version": 1, "scene": "cube_toss", "axes": {"recorded_run": [5, 17, 42]}}
    (tmp_path / "toss.yaml").write_text(json.dumps(sweep))
    setup = read_setup(EffectsRequest(str(tmp_path / "toss.yaml")))
    assert {each["recorded_run"] for each in setup.fresh_scenarios} <= {5.0, 17.0, 42.0}
