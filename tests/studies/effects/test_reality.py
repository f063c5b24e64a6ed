"""Effects that recordings call for: those that they were made with, and no others."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.errors import SceneError
from contactlab.schema.study_reports import EffectFinding
from contactlab.studies.effects import ablation
from contactlab.studies.effects.configuration_runs import ConfigurationRows
from contactlab.studies.effects.effect_toggles import difference
from contactlab.studies.effects.effects_request import EffectsRequest
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
@pytest.mark.parametrize(("condim", "asked"), [(6, True), (3, False)])
def test_rolling_friction_is_asked_for_where_it_was(
    tmp_path: Path, condim: int, asked: bool
) -> None:
    """Rolling friction changes every roll, but only one of two recordings has it."""
    request = EffectsRequest(rolled(tmp_path, condim), rounds=None, metric="reality")
    report = ablation.find_smallest_set(request, Session(tmp_path / "stores", 0))
    found: dict[str, EffectFinding] = {each.effect: each for each in report.effects}
    rolling = found["rolling_friction"]
    assert rolling.verdict == ("missing" if asked else "no effect")
    [change] = rolling.metric_changes
    assert change.change is not None
    assert (change.change < 0) == asked
    assert ("rolling_friction" in report.smallest_set.added) == asked
    assert [each.effect for each in found.values() if each.verdict == "missing"] == (
        ["rolling_friction"] if asked else []
    )
    assert report.verification.holds
    # The runs that verify it were recorded apart from those that it was found with.
    used, fresh = (
        {each["recorded_run"] for each in every}
        for every in (report.scenarios, report.verification.scenarios)
    )
    assert len(used) == 24
    assert len(fresh) == 6
    assert not used & fresh


@pytest.mark.parametrize(
    ("shift", "noise", "words"),
    [
        (0.2, 0.01, ["if farther", "if unsure"]),
        (-0.2, 0.01, ["if closer"]),
        (0.02, 0.001, []),  # less than a twentieth of the distance
        (-0.02, 0.001, []),
        (0.2, 2.0, ["if unsure"]),  # less than three standard errors
        (-0.2, 2.0, ["if unsure"]),
    ],
)
def test_the_mean_over_recorded_runs_counts(shift: float, noise: float, words: list[str]) -> None:
    base = np.linspace(0.5, 1.5, 30)
    other = base + shift + noise * np.tile([-1, 1], 15)
    first, second = (
        ConfigurationRows([{}] * 30, [[{"reality": x, "label": "stable"}] for x in each.tolist()])
        for each in (base, other)
    )
    for word in ("if closer", "if farther", "if unsure"):
        found = difference({"reality": 0.0}, first, second, matters=word)
        assert found.is_significant == (word in words)
        assert found.metric_changes[0].change == pytest.approx(shift)
        assert found.metric_changes[0].tolerance == pytest.approx(0.05)
        assert found.metric_changes[0].spread == pytest.approx(3 * noise / np.sqrt(29))


def test_runs_that_end_early_matter_and_other_labels_do_not() -> None:
    def rows(*each: Any) -> ConfigurationRows:
        return ConfigurationRows([{}] * 3, [[{"reality": x, "label": y}] for x, y in each])

    base = rows((0.1, "stable"), (0.2, "stable"), (0.3, "stable"))
    tolerances = {"reality": 0.5}
    assert not difference(tolerances, base, rows(*[(0.1, "bounce")] * 3)).is_significant
    ended = difference(tolerances, base, rows((0.1, "stable"), (0.2, "stable"), (None, "diverged")))
    assert ended.labels == {"compared -> ends early": 1}


def test_a_scene_without_a_recording_is_refused() -> None:
    with pytest.raises(SceneError, match="needs a scene with a `recording`"):
        _ = EffectsRequest("box_slide", metric="reality").setup
