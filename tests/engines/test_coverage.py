"""What runs exercised: planted motions, and equality with loops that look at every step."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.engines import ENGINES, Buffers, PreparedRuns
from contactlab.engines.rollout_trace import make_trace
from contactlab.engines.sampled_loads import sampled_steps
from contactlab.measure import assess_runs
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene
from contactlab.schema.coverage import Coverage

Make = Callable[..., Scene]
GRAVITY, FRICTION, SECONDS = 9.81, 0.5, 1.0
BOX_SPEED = 0.4 * FRICTION * GRAVITY * SECONDS
"""A box this fast slides for 0.4 of the time."""
# Its friction is FRICTION.
PLANTED = Path(__file__).with_name("planted_motions.xml").read_text(encoding="utf-8")
MANIFEST = f"""
subject: box
pairs: [{{geoms: [floor, box]}}, {{geoms: [floor, ball]}}, {{geoms: [box, ball]}}]
initial:
  slow: {{default: 0.4, unit: m/s, description: s, sets: {{mover.v: slow, stopped.v: slow}}}}
  fast: {{default: {BOX_SPEED}, unit: m/s, description: s, sets: {{box.vx: fast}}}}
  spin: {{default: 5, unit: rad/s, description: s, sets: {{ball.wy: spin, ball.vx: spin * 0.1}}}}
control: {{weak.ctrl: {{at: [0, 0.5], to: [0, 6]}}}}
"""


def rolled_out(
    scene: Scene, values: dict[str, Any], seed: int = 0
) -> tuple[Coverage, PreparedRuns]:
    """Return the coverage of one run of a scene, and the run."""
    run = scene.resolve(values, seed, SECONDS)
    runs = PreparedRuns.of(scene, run)
    trace = make_trace(runs.base, runs.prepared, ENGINES["mujoco"].roll_out(runs, Buffers()))
    setup = make_setup(runs.base, scene.source.manifest, [run], runs.models, {})
    coverage = assess_runs(trace, setup).coverage
    assert coverage is not None
    return coverage[0], runs


@pytest.mark.parametrize("timestep", [0.002, 0.001, 0.0005])
def test_a_planted_motion_is_what_is_covered(make_scene: Make, timestep: float) -> None:
    """Shares of time are off by the steps in which a contact begins or changes its mode."""
    found, _ = rolled_out(make_scene(PLANTED, MANIFEST), {"timestep": timestep})
    assert found.joints["mover"].moved == pytest.approx(0.4 * SECONDS, rel=1e-4)
    assert found.joints["mover"].share == pytest.approx(0.4 * SECONDS, rel=1e-4)
    ends = {name: each.ends for name, each in found.joints.items() if each.ends}
    assert ends == {"stopped": ("upper",)}
    assert not found.joints["idle"].counts
    assert set(found.pairs) == {"floor-box", "floor-ball"}
    box, ball = found.pairs["floor-box"], found.pairs["floor-ball"]
    # A slide ends below 5 mm/s, 1 ms early; steps of falling onto the contact come before.
    assert box.slid == pytest.approx(0.4, abs=0.02)
    assert box.stuck == pytest.approx(0.6, abs=0.02)
    assert box.friction == pytest.approx(FRICTION, rel=0.05)
    assert (ball.slid, ball.spun) == (0, 0)
    assert ball.rolled == pytest.approx(1, abs=0.02)
    weak = found.actuators["weak"]
    # The control is clamped to its range from -4 to 4, the force to 1.
    assert (weak.share, weak.ends, weak.force) == (0.5, ("upper",), 1)
    assert weak.saturated == pytest.approx(11 / 12, abs=timestep)
    slack, taut = found.tendons["slack"], found.tendons["taut"]
    assert (slack.ends, slack.stretched) == ((), None)
    # The sag of the body, a fraction of a millimetre, is what the tendon's length is off by.
    assert taut.stretched == pytest.approx(np.hypot(5, 1) - 0.5, rel=1e-3)
    lifted = taut.stretched / np.hypot(5, 1)
    everything = {"contact", "friction", "rolling", "motion", "actuation", "clamping"}
    # A joint does not reach its limit, an equality bears nothing, a tendon is slack.
    assert found.exercised == everything
    # The weld's time constant is 20 ms, the earliest sample at 62 ms, where 1 % is left to settle.
    assert found.equalities == {"loaded": pytest.approx(2 * GRAVITY - lifted, 0.02), "unloaded": 0}


STEPS = 600
FREE, BALL = 0, 1


def random_robot(seed: int) -> str:
    """Return chains with every kind of joint, limits with and without margins, and motors."""
    rng = np.random.default_rng(seed)
    bodies, motors, coupled = "", "", ""
    for chain in range(3):
        inner = ""
        for link in range(int(rng.integers(1, 4))):
            name, kind = f"j{chain}{link}", str(rng.choice(["hinge", "slide", "ball"]))
            low, high = rng.uniform(0.05, 1, 2)
            inner = (
                f'<body pos=".2 0 0"><joint name="{name}" type="{kind}" axis="0 1 0" damping=".2" '
                f'limited="{rng.choice(["true", "false"])}" margin="{rng.choice([0, 0.01])}" '
                f'range="{0 if kind == "ball" else -low} {high}"/>'
                f'<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>{inner}</body>'
            )
            if kind != "ball":
                coupled += f'<joint joint="{name}" coef="1"/>'
                motors += (
                    f'<general joint="{name}" gainprm="{rng.uniform(1, 30)}" forcerange="-2 2" '
                    f'forcelimited="{rng.choice(["true", "false"])}" ctrlrange="-1 1"/>'
                )
        joint = "<freejoint/>" if chain == 0 else ""
        bodies += (
            f'<body name="b{chain}" pos="0 {chain} .4">{joint}<geom size=".05"/>{inner}</body>'
        )
    fixed = f'<fixed limited="true" range="-.3 .3" stiffness="3">{coupled}</fixed>'
    return f"""
    <mujoco><compiler angle="radian"/>
      <worldbody><geom name="floor" type="plane" size="5 5 1"/>{bodies}</worldbody>
      <tendon>{fixed if coupled else ""}</tendon><actuator>{motors}</actuator>
      <equality><connect body1="b0" anchor="0 0 0"/></equality>
    </mujoco>"""


class Seen(NamedTuple):
    """What a loop saw: before each step and after the last, and within each step."""

    qpos: list[np.ndarray]
    length: list[np.ndarray]
    force: list[np.ndarray]
    limited: set[int]
    load: float


def looked_at(model: mujoco.MjModel, start: InitialStates) -> Seen:
    """Step with mj_step, and look at the constraints of every step."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = start.qpos[0], start.qvel[0], start.ctrl[0]
    seen, load, samples = Seen([], [], [], set(), 0), 0.0, set(sampled_steps(STEPS).tolist())
    for step in range(STEPS + 1):
        seen.qpos.append(data.qpos.copy())
        mujoco.mj_step(model, data) if step < STEPS else mujoco.mj_forward(model, data)
        seen.length.append(data.ten_length.copy())
        seen.force.append(data.actuator_force.copy())
        for kind, part, force in zip(data.efc_type, data.efc_id, data.efc_force, strict=True):
            if kind == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT:
                seen.limited.add(int(part))
            if kind == mujoco.mjtConstraint.mjCNSTR_EQUALITY and step in samples:
                load = max(load, abs(force))
    return seen._replace(load=load)


def angle_between(first: np.ndarray, other: np.ndarray) -> float:
    """Return the angle between two unit quaternions; 0 for what is no quaternion."""
    if len(first) < 4:
        return 0.0
    difference = np.zeros(3)
    mujoco.mju_subQuat(difference, other, first)
    return float(np.linalg.norm(difference))


@pytest.mark.long
@given(seed=st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_coverage_equals_a_loop_that_looks_at_every_step(make_scene: Make, seed: int) -> None:
    """Numbers are kept to four digits; forces at samples are solved again, from a cold start."""
    found, runs = rolled_out(make_scene(random_robot(seed)), {"timestep": SECONDS / STEPS}, seed)
    model = runs.models[0]
    seen = looked_at(model, runs.starts)
    states = np.array(seen.qpos)
    for index, joint in enumerate(found.joints.values()):
        place, kind = model.jnt_qposadr[index], model.jnt_type[index]
        rotations = (
            states[:, place + 3 : place + 7] if kind == FREE else states[:, place : place + 4]
        )
        turned = max(angle_between(rotations[0], each) for each in rotations)
        size = 3 if kind == FREE else 1
        span = np.linalg.norm(np.ptp(states[:, place : place + size], axis=0))
        assert joint.moved == pytest.approx(turned if kind == BALL else span, rel=1e-3, abs=1e-7)
        assert joint.turned == (pytest.approx(turned, rel=1e-3, abs=1e-7) if kind == FREE else None)
        assert bool(joint.ends) == (index in seen.limited)
    lengths = np.array(seen.length)[:STEPS]
    for place, tendon in enumerate(found.tendons.values()):
        away = np.abs(lengths[:, place] - model.tendon_lengthspring[place, 0])
        assert tendon.moved == pytest.approx(np.ptp(lengths[:, place]), rel=1e-3)
        assert tendon.stretched == pytest.approx(away.max(), rel=1e-3)
    forces = np.abs(np.array(seen.force)[:STEPS]).max(axis=0).tolist()
    assert [each.force for each in found.actuators.values()] == pytest.approx(forces, rel=1e-3)
    assert list(found.equalities.values()) == [pytest.approx(seen.load, rel=1e-2)]
