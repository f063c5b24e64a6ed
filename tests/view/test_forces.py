"""Frames are the nearest states; forces keep their peaks and obey the law of momentum."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import DISTANCE, FORCE, NORMAL, POSITION, SLOT_WIDTH, TANGENT
from contactlab.store.mcap.trace_reader import StoredPair
from contactlab.view.drawn_motion import frame_rows, peak_forces, read_motion, world_force

TIMES = st.lists(st.floats(1e-3, 0.5), max_size=30).map(lambda steps: np.cumsum([0.0, *steps]))


@given(time=TIMES, rate=st.floats(0.5, 100), moments=st.lists(st.floats(0, 20), max_size=3))
def test_frames_are_the_nearest_states(time: Any, rate: float, moments: list[float]) -> None:
    rows = frame_rows(time, rate, moments)
    wanted = [frame / rate for frame in range(2000) if frame / rate <= time[-1] * (1 + 1e-9)]
    gaps = {float(np.abs(time - each).min()) for each in [*wanted, *moments]}
    found = {float(np.abs(time[rows] - each).min()) for each in [*wanted, *moments]}
    assert found == gaps
    assert (np.diff(rows) > 0).all()
    assert (rows[0], rows[-1]) == (0, len(time) - 1)
    assert len(rows) <= len(wanted) + len(moments) + 1


def pair_of(rng: np.random.Generator, steps: Sequence[int]) -> StoredPair:
    count = len(steps)
    contacts = rng.integers(1, 4, count).astype(np.int32)
    points = rng.standard_normal((int(contacts.sum()), SLOT_WIDTH))
    strengths = rng.permutation(count).astype(float)
    return StoredPair(
        name="a-b",
        steps=np.array(steps, np.int32),
        contacts=contacts,
        found=contacts,
        mode=rng.integers(0, 3, count).astype(np.int8),
        normal=strengths,
        tangential=np.zeros(count),
        usage=np.zeros(count),
        slip=np.zeros(count),
        distance=np.zeros(count),
        points=points,
    )


@given(
    steps=st.sets(st.integers(0, 39)).map(sorted),
    frames=st.sets(st.integers(1, 39)).map(lambda rows: [0, *sorted(rows), 40]),
    seed=st.integers(0, 2**32 - 1),
)
def test_each_frame_keeps_the_step_with_the_largest_force(
    steps: list[int], frames: list[int], seed: int
) -> None:
    pair = pair_of(np.random.default_rng(seed), steps)
    forces = peak_forces([pair], np.array(frames))
    starts = np.cumsum(pair.contacts) - pair.contacts
    for frame, row in enumerate(frames):
        until = [*frames, 41][frame + 1]
        within = [each for each in range(len(steps)) if row <= steps[each] < until]
        if frame == len(frames) - 1:
            within += [each for each in range(len(steps)) if steps[each] == row - 1]
        mine = forces.of(frame)
        if not within:
            assert mine.start == mine.stop
            continue
        best = max(within, key=lambda each: pair.normal[each])
        points = pair.points[starts[best] : starts[best] + pair.contacts[best]]
        np.testing.assert_array_equal(forces.position[mine], points[:, POSITION])
        np.testing.assert_array_equal(forces.force[mine], world_force(points))
        assert set(forces.mode[mine].tolist()) == {int(pair.mode[best])}


@given(seed=st.integers(0, 2**32 - 1))
def test_forces_turn_from_the_contact_frame_to_the_world(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    frame[2] = np.cross(frame[0], frame[1])
    point = np.zeros((1, SLOT_WIDTH))
    point[0, NORMAL], point[0, TANGENT] = frame[0], frame[1]
    point[0, FORCE] = force = rng.standard_normal(3)
    expected = sum(part * axis for part, axis in zip(force, frame, strict=True))
    np.testing.assert_allclose(world_force(point)[0], expected, atol=1e-14)


@pytest.mark.parametrize("name", ["ball", "slide", "stack"])
def test_forces_act_on_the_second_side(name: str, drawn: Callable[[str], Any]) -> None:
    """What contacts give a body in a step is its change of momentum less its weight.

    Each step is a frame here. MuJoCo's semi-implicit Euler step adds h M^-1 f to the velocity of a
    free body. Its solver stops when a step lowers its cost, of the order of f^2 / m, by less than
    1e-8; so a force of about 1e-4 N may remain unbalanced, of 10 to 1e4 N here.
    """
    run = drawn(name)
    model, trace = run.model, run.trace
    timestep = model.opt.timestep
    motion = read_motion(run.start.prepared_model, trace, 1 / timestep)
    assert len(motion.rows) == len(trace.time)
    found = np.zeros((len(trace.kinetic), model.nbody, 3))
    forces = motion.forces
    # The last frame shows the force of the step before once more.
    for index in np.flatnonzero(forces.frame < len(trace.kinetic)):
        first, second = motion.pairs[forces.pair[index]].split("-")
        for side, sign in ((first, -1), (second, 1)):
            body = model.geom_bodyid[model.geom(side).id]
            found[forces.frame[index], body] += sign * forces.force[index]
    for body in np.flatnonzero(motion.moving):
        start = int(model.jnt_dofadr[model.body_jntadr[body]])
        change = np.diff(trace.qvel[:, start : start + 3], axis=0) / timestep
        expected = model.body_mass[body] * (change - model.opt.gravity)
        np.testing.assert_allclose(found[:, body], expected, rtol=0, atol=1e-3)
    assert np.abs(found).max() > 1


@pytest.mark.parametrize("name", ["ball", "slide", "stack"])
def test_contact_points_lie_where_the_bodies_touch(name: str, drawn: Callable[[str], Any]) -> None:
    """On the floor, a contact lies half its depth below the surface, in the world frame."""
    run = drawn(name)
    floor = [pair for pair in run.trace.pairs if pair.name.startswith("floor-")]
    for pair in floor:
        depth = pair.points[:, DISTANCE]
        np.testing.assert_allclose(pair.points[:, POSITION][:, 2], depth / 2, atol=1e-12)
    assert floor


def test_an_impact_of_one_step_is_seen_at_any_rate(drawn: Callable[[str], Any]) -> None:
    run = drawn("ball")
    [pair] = run.trace.pairs
    for rate in (1.0, 7.0, 60.0):
        motion = read_motion(run.start.prepared_model, run.trace, rate)
        strongest = np.linalg.norm(motion.forces.force, axis=1).max()
        assert strongest == pytest.approx(np.hypot(pair.normal, pair.tangential).max())
