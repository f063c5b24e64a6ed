"""What is drawn of a run: the poses of its trajectory, a sphere around it, readable arrows."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from tests.written_traces import assert_viewable

from contactlab.errors import StoreError
from contactlab.schema.evidence import LabelEntry
from contactlab.store.mcap.trace_reader import read_trace
from contactlab.view.drawn_motion import (
    arrow_scale,
    failing_pair,
    picture_times,
    read_motion,
    run_events,
    widen_stage,
)
from contactlab.view.render import render_run


@pytest.mark.long
@pytest.mark.parametrize("name", ["ball", "slide", "stack"])
def test_poses_in_the_file_are_those_of_the_trajectory(
    name: str, drawn: Callable[[str], Any], target: Callable[[str], Path]
) -> None:
    """Each transform equals kinematics of the state of its very time, bit for bit."""
    run = drawn(name)
    path = target(".mcap")
    motion = render_run(run.store, run.run, path)
    assert_viewable(path)
    rows = {round(time * 1e9): row for row, time in enumerate(run.trace.time)}
    data, seen = mujoco.MjData(run.model), 0
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, message, transforms in reader.iter_decoded_messages(topics="/tf"):
            data.qpos[:] = run.trace.qpos[rows[message.log_time]]
            mujoco.mj_kinematics(run.model, data)
            for each in transforms.transforms:
                body = motion.bodies.index(each.child_frame_id)
                place, turn = each.translation, each.rotation
                assert [place.x, place.y, place.z] == data.xpos[body].tolist()
                assert [turn.w, turn.x, turn.y, turn.z] == data.xquat[body].tolist()
            seen += 1
    # 60 a second and the first; the last state has one of its own if it lies between two.
    assert seen - 1 - run.trace.time[-1] * 60 == pytest.approx(0.5, abs=0.5 + 1e-9)
    np.testing.assert_array_equal(read_trace(path).qpos, run.trace.qpos)


@pytest.mark.parametrize("name", ["ball", "slide", "stack"])
def test_the_stage_holds_all_that_moves(name: str, drawn: Callable[[str], Any]) -> None:
    run = drawn(name)
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    data = mujoco.MjData(run.model)
    for row in motion.rows:
        data.qpos[:] = run.trace.qpos[row]
        mujoco.mj_kinematics(run.model, data)
        for geom in np.flatnonzero(motion.moving[run.model.geom_bodyid]):
            far = np.linalg.norm(data.geom_xpos[geom] - motion.centre)
            assert far + 0.99 * run.model.geom_rbound[geom] <= motion.radius


def test_a_body_that_flies_away_leaves_the_stage_at_the_contact(
    drawn: Callable[[str], Any],
) -> None:
    run = drawn("ball")
    away = run.trace.qpos.copy()
    away[-20:, 2] = np.linspace(10, 1e6, 20)
    motion = read_motion(run.start.prepared_model, replace(run.trace, qpos=away), 60)
    # The ball's radius is 0.05 m; contacts are on the floor.
    assert motion.radius == pytest.approx(25 * 0.05)
    np.testing.assert_allclose(motion.centre, 0, atol=0.01)


def test_a_run_is_drawn_up_to_its_first_bad_state(drawn: Callable[[str], Any]) -> None:
    run = drawn("ball")
    broken = run.trace.qpos.copy()
    broken[100:, 2] = np.nan
    motion = read_motion(run.start.prepared_model, replace(run.trace, qpos=broken), 60)
    assert motion.rows[-1] == 99
    assert np.isfinite(motion.positions).all()
    with pytest.raises(StoreError, match="no finite state to draw"):
        read_motion(run.start.prepared_model, replace(run.trace, qpos=broken[:0]), 60)


@given(
    strengths=st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=30),
    radius=st.floats(1e-3, 1e3),
)
def test_usual_arrows_are_seen_and_none_is_longer_than_the_stage(
    strengths: list[float], radius: float
) -> None:
    force = np.array([[0, 0, each] for each in strengths])
    scale, longest = arrow_scale(force, radius)
    usual = float(np.percentile(strengths, 90))
    # Steps of 1, 2, 5 and 10 are at most sqrt(2.5) off what is wanted, half the radius.
    assert 1 / 2.5**0.5 <= scale * usual / (0.5 * radius) * (1 + 1e-9) <= 2.5**0.5 * (1 + 2e-9)
    assert f"{scale:.0e}"[0] in "125"
    assert longest == radius


def test_arrows_are_forces_to_scale_and_cut_at_their_longest(
    make_trace: Callable[..., Any], make_motion: Callable[..., Any]
) -> None:
    trace, _ = make_trace(pairs=("a-b",), steps=40)
    motion = make_motion(trace, [0, 7, 8, 30, 40])
    lengths = np.linalg.norm(motion.arrows, axis=1)
    forces = np.linalg.norm(motion.forces.force, axis=1)
    assert {True, False} == {*(forces * motion.scale > motion.longest)}, "of both kinds"
    assert lengths == pytest.approx(np.minimum(forces * motion.scale, motion.longest))
    along = (motion.arrows * motion.forces.force).sum(axis=1)
    assert along == pytest.approx(lengths * forces)


def test_moments_are_where_labels_begin_and_force_peaks(drawn: Callable[[str], Any]) -> None:
    run = drawn("ball")
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    pair, time = run.trace.pairs[0], run.trace.time
    peak, most = 0, 0.0
    for step, force in zip(pair.steps.tolist(), pair.normal.tolist(), strict=True):
        if force > most:
            peak, most = step, force
    events = run_events([LabelEntry(label="chatter", reason="often", step=77)], time)
    found = picture_times(motion, run.trace, events, pair.name, 6)
    assert len(found) == 6
    assert found == sorted(found)
    assert {time[0], time[77], time[peak], time[-1]} <= {*found}


def test_the_stage_widens_for_what_was_recorded(drawn: Callable[[str], Any]) -> None:
    run = drawn("ball")
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    beside = motion.positions + np.array([0.3, 0, 0])
    wide = widen_stage(motion, beside, motion.rotations)
    far = np.linalg.norm(beside[:, 1] - wide.centre, axis=1).max()
    assert motion.radius < far + 0.05 <= wide.radius * (1 + 1e-9)


def test_the_failing_pair_is_the_one_that_the_reason_names(drawn: Callable[[str], Any]) -> None:
    run = drawn("ball")
    weak, strong = run.trace.pairs[0], replace(run.trace.pairs[0], name="floor-ball2")
    strong = replace(strong, normal=2 * strong.normal)
    said = [LabelEntry(label="chatter", reason="floor-ball switches often", step=None)]
    record = run.start.record
    named = failing_pair(record.model_copy(update={"labels": said}), [strong, weak])
    assert named == "floor-ball"
    assert failing_pair(record.model_copy(update={"labels": []}), [weak, strong]) == "floor-ball2"
    assert failing_pair(record, []) is None


def test_forceless_runs_have_a_scale_too() -> None:
    scale, longest = arrow_scale(np.zeros((0, 3)), 1.0)
    assert (scale, longest) == (0.5, 1.0)
