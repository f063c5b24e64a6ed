"""Row k of every sensor belongs to state row k, and its forces act during step k."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.trace_arrays import DISTANCE, FORCE, FOUND, NORMAL, TANGENT, Trace
from contactlab.engines.rollout_trace import make_trace
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.scene import Scene

INTEGRATORS = PARAMETERS["integrator"].choices
# RK4 takes four stages a step, and its sensors hold the first.
SINGLE_STAGE = tuple(name for name in INTEGRATORS if name != "RK4")
BOX = """
<mujoco>
  <option timestep="0.002" cone="elliptic"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="box" pos="0 0 .06" euler="5 10 20">
      <freejoint/>
      <geom name="box" type="box" size=".1 .07 .05" mass="3"/>
    </body>
  </worldbody>
</mujoco>
"""
SPHERES = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0">{flag}</option>
  <worldbody>
    <body name="one"><freejoint/><geom name="one" size=".05" mass="1" solref="0.02 0.2"/></body>
    <body name="two" pos=".14 .02 .01">
      <freejoint/><geom name="two" size=".08" mass="2.5" solref="0.02 0.2"/>
    </body>
  </worldbody>
</mujoco>
"""
COLLIDING = (
    "pairs: [{geoms: [one, two]}]\n"
    "initial: {speed: {default: 2, unit: m/s, description: s, "
    "sets: {one.vx: speed, two.wz: 3 * speed}}}\n"
)


def traced(rolled: Any) -> Trace:
    base = rolled.scene.base(rolled.scene.resolve({}, 0, None).structure)
    return make_trace(base, rolled.prepared, rolled.rollout)


def world_force(slots: np.ndarray) -> np.ndarray:
    """Return the net force (..., 3) on a pair's second side, world frame [N]."""
    normal, tangent = slots[..., NORMAL], slots[..., TANGENT]
    frame = np.stack([normal, tangent, np.cross(normal, tangent)], axis=-2)
    return np.einsum("...sk,...skj->...j", slots[..., FORCE], frame)


@pytest.mark.parametrize("integrator", SINGLE_STAGE)
@pytest.mark.parametrize(("order", "sign"), [("floor, box", 1.0), ("box, floor", -1.0)])
def test_net_force_gives_the_acceleration(
    integrator: str, order: str, sign: float, make_scene: Callable[..., Scene], roll: Any
) -> None:
    scene = make_scene(BOX, f"pairs: [{{geoms: [{order}], slots: 8}}]\n")
    # Forces and acceleration agree as far as the solver converges.
    rolled = roll(scene, [{"integrator": integrator, "tolerance": 0.0}], 400)
    trace = traced(rolled)
    pair = trace.pairs[0]
    assert (pair.found > 0).any()
    assert (pair.found <= 8).all()
    # One free body has no other force. Forces of some 100 N over 3 kg leave rounding near 1e-13.
    net = sign * world_force(pair.slots)[0] / 3.0 + [0.0, 0.0, -9.81]
    gained = np.diff(trace.qvel[0, :, :3], axis=0) / 0.002
    assert net == pytest.approx(gained, abs=1e-9)
    assert (pair.slots[..., NORMAL][pair.touching] * sign)[:, 2] == pytest.approx(1.0)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_ball_distance_is_that_of_the_state_before_the_step(integrator: str, roll: Any) -> None:
    rolled = roll(Scene.open("ball_drop"), [{"integrator": integrator, "drop_height": 0.2}], 300)
    trace = traced(rolled)
    pair = trace.pairs[0]
    touching = pair.touching[0, :, 0]
    assert touching.any()
    assert not touching.all()
    gap = trace.qpos[0, :-1, 2] - 0.05
    assert pair.slots[0, touching, 0, DISTANCE] == pytest.approx(gap[touching], abs=1e-15)
    assert np.array_equal(touching, gap < 0)
    assert np.array_equal(trace.contacts[0], touching)
    assert trace.least_distance[0] == pytest.approx(np.minimum(gap, 0.0), abs=1e-15)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_free_collision(integrator: str, make_scene: Callable[..., Scene], roll: Any) -> None:
    rolled = roll(make_scene(SPHERES.format(flag=""), COLLIDING), [{"integrator": integrator}], 200)
    trace, model = traced(rolled), rolled.prepared[0].model
    pair, data = trace.pairs[0], mujoco.MjData(model)
    assert pair.touching.any()
    for step in range(200):
        data.qpos[:], data.qvel[:] = trace.qpos[0, step], trace.qvel[0, step]
        mujoco.mj_forward(model, data)
        gap = mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None)
        assert bool(pair.touching[0, step, 0]) == (gap < 0)
        if gap < 0:
            assert pair.slots[0, step, 0, DISTANCE] == pytest.approx(gap, abs=1e-12)


@pytest.mark.parametrize("flag", ["", '<flag energy="enable"/>'])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_energy_and_momentum_are_those_of_the_state_before_the_step(
    integrator: str, flag: str, make_scene: Callable[..., Scene], roll: Any
) -> None:
    rolled = roll(
        make_scene(SPHERES.format(flag=flag), COLLIDING), [{"integrator": integrator}], 200
    )
    trace, model = traced(rolled), rolled.prepared[0].model
    masses, inertia = model.body_mass[1:], model.body_inertia[1:, 0]
    velocity = trace.qvel[0, :-1].reshape(-1, 2, 6)
    linear, angular = velocity[..., :3], velocity[..., 3:]
    kinetic = ((linear**2).sum(-1) * masses + (angular**2).sum(-1) * inertia).sum(-1) / 2
    # Sums of about 10 J carry rounding near 1e-15 J.
    assert trace.kinetic[0] == pytest.approx(kinetic, abs=1e-12)
    momentum = (linear * masses[:, None]).sum(1)
    assert trace.momentum is not None
    assert trace.momentum[0] == pytest.approx(momentum, abs=1e-12)
    position = trace.qpos[0, :-1].reshape(-1, 2, 7)[..., :3]
    centre = (position * masses[:, None]).sum(1) / masses.sum()
    orbital = np.cross(position - centre[:, None], linear * masses[:, None]).sum(1)
    # Spheres have equal inertia about every axis, and their body frame turns with them.
    assert trace.angular_momentum is not None
    own = np.linalg.norm(trace.angular_momentum[0] - orbital, axis=-1)
    assert own[0] == pytest.approx(inertia[1] * 6.0, rel=1e-12)
    # The collision conserves it but for rounding.
    assert trace.momentum[0] == pytest.approx(np.tile(momentum[0], (200, 1)), abs=1e-12)


def test_potential_energy_is_that_of_height(roll: Any) -> None:
    trace = traced(roll(Scene.open("ball_drop"), [{"mass": 3.0, "gravity": (0.0, 0.0, -2.0)}], 100))
    assert trace.potential[0] == pytest.approx(6.0 * trace.qpos[0, :-1, 2], rel=1e-14)


def test_counts_of_the_whole_model(mixed: Scene, roll: Any) -> None:
    rolled = roll(mixed, [{}], 60)
    trace, model = traced(rolled), rolled.prepared[0].model
    data = mujoco.MjData(model)
    for step in range(60):
        data.qpos[:], data.qvel[:] = trace.qpos[0, step], trace.qvel[0, step]
        mujoco.mj_forward(model, data)
        assert trace.contacts[0, step] == data.ncon
        assert trace.least_distance[0, step] == pytest.approx(data.contact.dist.min(), abs=1e-15)
        graded = sum(pair.slots[0, step, 0, FOUND] for pair in trace.pairs)
        assert graded == data.ncon


def test_the_least_distance_is_not_that_of_the_strongest_contact(
    make_scene: Callable[..., Scene], roll: Any
) -> None:
    ball = "<body pos='{} 0 {}'><freejoint/><geom size='.1' mass='{}' solref='{} 1'/></body>"
    balls = ball.format(0, 0.08, 0.001, 0.5) + ball.format(1, 0.099, 100, 0.005)
    floor = "<geom type='plane' size='2 2 1' priority='-1'/>"
    rolled = roll(make_scene(f"<mujoco><worldbody>{floor}{balls}</worldbody></mujoco>"), [{}], 1)
    trace = traced(rolled)
    light, heavy = (pair.slots[0, 0, 0, FORCE.start] for pair in trace.pairs[:2])
    assert heavy > 100 * light
    assert trace.least_distance[0, 0] == pytest.approx(-0.02, abs=1e-15)


def test_iterations_are_summed_over_islands(mixed: Scene, roll: Any) -> None:
    rolled = roll(mixed, [{}, {"island": False}], 60)
    trace = traced(rolled)
    recorded = rolled.rollout.iterations
    assert (np.count_nonzero(recorded[0], axis=1) > 1).any()
    assert np.count_nonzero(recorded[1], axis=1).max() == 1
    assert np.array_equal(trace.iterations, recorded.sum(axis=2))
    assert np.array_equal(trace.iterations_most, recorded.max(axis=2))
