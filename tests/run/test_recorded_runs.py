"""Recorded runs as scenarios of a sweep: planted recordings, drawn runs, means, replays."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.errors import SweepFileError
from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.criteria import Criteria
from contactlab.run.recomputed_runs import recomputed_problems
from contactlab.run.stored_runs import replay_run
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

MODEL = """<mujoco><option timestep="0.002" cone="elliptic"/>
<default><geom friction="{friction}"/></default><worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="puck" pos="0 0 .1"><freejoint name="puck"/>
<geom name="puck" type="box" size=".06 .04 .03"/></body></worldbody></mujoco>"""
SCENE = """\
version: 1
title: t
description: d
duration: 2.0
subject: puck
pairs: [{geoms: [floor, puck], slots: 4}]
recording: {file: motion.csv, run: trial, units: {length: m, angle: rad, time: s}}
"""
SWEEP = "version: 1\nscene: planted/\ntrace: none\nchecks: none\n"
TRUE = 0.3  # friction with which the recordings were made
PARTS = ("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")


@pytest.fixture
def planted(tmp_path: Path) -> Path:
    """Write a scene of the wrong friction with six recordings of the right one, at 100 Hz."""
    folder = tmp_path / "planted"
    folder.mkdir()
    (folder / "scene.xml").write_text(MODEL.format(friction=1.0))
    (folder / "scene.yaml").write_text(SCENE)
    model = mujoco.MjModel.from_xml_string(MODEL.format(friction=TRUE))
    rng, lines = (
        np.random.default_rng(1),
        [",".join(["trial", "time", *(f"puck.{x}" for x in PARTS)])],
    )
    for trial in range(10, 16):
        data = mujoco.MjData(model)
        data.qvel[:] = rng.normal(size=6) * [1, 1, 0.1, 0.5, 0.5, 3]
        for frame in range(50 + 20 * (trial % 2)):
            state = [trial, frame / 100, *data.qpos.tolist(), *data.qvel.tolist()]
            lines.append(",".join(map(repr, state)))
            mujoco.mj_step(model, data, nstep=5)
    (folder / "motion.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.long
@pytest.mark.usefixtures("planted")
def test_the_planted_friction_explains_the_recordings(sweeper: Any) -> None:
    """Only it has no error; a wrong one is off by much more, and each run ends when recorded."""
    sweeper.run(f"{SWEEP}axes: {{recorded_run: all, friction.slide: [{TRUE}, 1.0]}}\n")
    rows = sweeper.rows()
    assert len(rows) == 12
    right = [row for row in rows if row["friction.slide"] == TRUE]
    wrong = [row for row in rows if row["friction.slide"] == 1]
    # What the text of a number loses, amplified by contact.
    assert max(row["reality"] for row in right) < 1e-6
    assert {row["reality_side"] for row in right} == {1}
    assert min(row["reality"] for row in wrong) > 0.1
    assert {row["recorded_run"]: row["duration"] for row in right} == {
        float(run): 0.7 if run % 2 else 0.5 for run in range(10, 16)
    }
    store = Store.open(sweeper.folder / "store")
    assert find_problems(store.address) == []
    assert list(recomputed_problems(store)) == []
    assert replay_run(store, rows[3]["run_id"]).equal
    report = analyze_tradeoff(store, Criteria(metric="reality"))
    assert report.scenarios == ("recorded_run",)
    errors = {each.configuration["friction.slide"]: each.error for each in report.configurations}
    assert errors[1.0] == pytest.approx(np.mean([row["reality"] for row in wrong]))


@pytest.mark.long
@pytest.mark.parametrize("form", ["messages", "compact"])
def test_a_trace_is_a_recording(sweeper: Any, planted: Path, form: str) -> None:
    """A run is its own recording to the last bits; another friction is not."""
    axes = "axes: {recorded_run: [11]}\n"
    sweeper.run(f"version: 1\nscene: planted/\ntrace: all\ntrace_format: {form}\n{axes}", "once")
    [trace] = (sweeper.folder / "once").rglob("*.mcap")
    (planted / "own.mcap").write_bytes(trace.read_bytes())
    (planted / "scene.yaml").write_text(
        SCENE.replace("file: motion.csv, run: trial", "file: own.mcap")
    )
    sweeper.run(f"{SWEEP}axes: {{friction.slide: [1.0, {TRUE}]}}\n", "again")
    own, other = (row["reality"] for row in sweeper.rows("again"))
    assert own < 1e-12
    assert other > 1e-2


@pytest.mark.long
def test_runs_are_drawn_and_seeds_perturb_them(sweeper: Any, planted: Path) -> None:
    text = "axes: {recorded_run: {sample: 4, seed: 3}}\n"
    sweeper.run(SWEEP + text, "first")
    sweeper.run(SWEEP + text, "again")
    drawn = [row["recorded_run"] for row in sweeper.rows("first")]
    assert drawn == sorted(set(drawn))
    assert len(drawn) == 4
    assert drawn == [row["recorded_run"] for row in sweeper.rows("again")]
    (planted / "scene.yaml").write_text(SCENE + "perturb: {coordinates: [puck.x], scale: 1.0e-3}\n")
    sweeper.run(f"{SWEEP}seeds: 2\naxes: {{recorded_run: [10], perturbation: [0, 1]}}\n", "noise")
    ends = [row["reality_position_end"] for row in sweeper.rows("noise")]
    assert ends[0] == ends[1]
    assert len({*ends}) == 3


@pytest.mark.usefixtures("planted")
@pytest.mark.parametrize(
    ("axes", "message"),
    [
        ("recorded_run: [10, 17]", "there is no 17; the nearest is 15"),
        ("recorded_run: {sample: 7}", "has 6 listed values of its own"),
        ("timestep: all", "has no listed values of its own"),
        ("recorded_run: {sample: 0}", "must be greater than"),
    ],
)
def test_runs_that_are_not_there(sweeper: Any, axes: str, message: str) -> None:
    with pytest.raises(SweepFileError) as raised:
        sweeper.run(f"{SWEEP}axes: {{{axes}}}\n")
    assert message in str(raised.value)


@pytest.mark.usefixtures("planted")
def test_all_takes_every_word_of_an_axis(sweeper: Any) -> None:
    plan = sweeper.ask(f"{SWEEP}axes: {{solver: all}}\n").plan
    assert [row.values["solver"] for row in plan.iterate_rows()] == ["PGS", "CG", "Newton"]


@pytest.mark.usefixtures("planted")
def test_means_over_runs_are_expected(sweeper: Any) -> None:
    text = f"{SWEEP}axes: {{recorded_run: all, friction.slide: [{TRUE}, 1.0]}}\n"
    text += "expect:\n  - {where: {friction.slide: 1.0}, mean: {reality: {max: 0.01}}}\n"
    text += f"  - {{where: {{friction.slide: {TRUE}}}, mean: {{reality: {{max: 0.01}}}}}}\n"
    sweeper.run(text)
    store = Store.open(sweeper.folder / "store")
    (unmet,) = store.manifest.unmet_means
    assert unmet.startswith("expected a mean reality of at most 0.01, found ")
    assert not [*recomputed_problems(store)]
    silent = replace(store, manifest=store.manifest.model_copy(update={"unmet_means": ()}))
    assert [*recomputed_problems(silent)] == [
        "manifest.json: its unmet means contradict the expectations of the sweep"
    ]
