"""A rollout equals a plain loop over mj_step, bit for bit, whatever a sweep varies."""

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab import resources
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.scene import Scene
from contactlab.store.control_tables import read_control_table

STEPS = 80

# A legal value other than the model's own for every parameter that there is.
OTHER: dict[str, Any] = {
    "timestep": 0.001,
    "integrator": "implicitfast",
    "cone": "elliptic",
    "solver": "CG",
    "jacobian": "sparse",
    "iterations": 3,
    "tolerance": 1e-3,
    "ls_iterations": 2,
    "ls_tolerance": 0.1,
    "noslip_iterations": 3,
    "noslip_tolerance": 1e-3,
    "ccd_iterations": 5,
    "ccd_tolerance": 1e-3,
    "sdf_iterations": 5,
    "sdf_initpoints": 7,
    "impratio": 10.0,
    "density": 1000.0,
    "viscosity": 0.5,
    "gravity": (1.0, 0.0, -5.0),
    "solref": (-1e4, -100.0),
    "solref.timeconst": 0.01,
    "solref.dampratio": 0.5,
    "solref.stiffness": 2e4,
    "solref.damping": 50.0,
    "restitution": 0.5,
    "solimp": (0.8, 0.99, 0.002, 0.4, 3.0),
    "solimp.dmin": 0.5,
    "solimp.dmax": 0.99,
    "solimp.width": 0.01,
    "solimp.midpoint": 0.3,
    "solimp.power": 4.0,
    "friction": (0.1, 0.03, 0.004),
    "friction.slide": 0.2,
    "friction.torsion": 0.05,
    "friction.roll": 0.03,
    "condim": 6,
    "margin": 0.01,
    **(AT_REST := {"stiffness": 2e4, "depth_at_rest": 1e-3}),
    "gap": 0.005,
}
FIELDS: dict[str, Any] = {
    "body_mass[box]": 3.0,
    "body_pos[hand]": (-0.5, 0.0, 0.24),
    "dof_damping[hinge]": 2.0,
    "dof_armature[hinge]": 0.1,
    "jnt_range[hinge]": (-0.01, 0.01),
    "geom_friction[box,1]": 0.5,
    "geom_solmix[box]": 7.0,
    "geom_priority[box]": 2,
    "pair_friction[rub,0]": 0.9,
    "eq_active0[grip]": 0,
}
SWITCHES = [flag for flag in FLAG_NAMES if flag not in PARAMETERS]
CHOICES = [(name, word) for name, each in PARAMETERS.items() for word in each.choices]


def test_every_parameter_is_tried() -> None:
    assert OTHER.keys() == PARAMETERS.keys()
    for name, value in OTHER.items():
        assert PARAMETERS[name].parse(value) == value


@pytest.mark.long
@pytest.mark.parametrize("name", PARAMETERS)
def test_parameter(name: str, mixed: Scene, roll: Any) -> None:
    if name in AT_REST:  # geoms of many pairs have no solref that gives it to each
        mixed = Scene.open("box_slide")
    rolled = roll(mixed, [{}, {name: OTHER[name]}, {}], STEPS)
    rolled.assert_equals_loop(STEPS)
    assert rolled.rollout.steps == (STEPS, STEPS, STEPS)


@pytest.mark.parametrize(("name", "word"), CHOICES)
def test_word(name: str, word: str, mixed: Scene, roll: Any) -> None:
    roll(mixed, [{name: word}, {}], STEPS).assert_equals_loop(STEPS)


@pytest.mark.parametrize("flag", SWITCHES)
def test_switch(flag: str, mixed: Scene, roll: Any) -> None:
    rolled = roll(mixed, [{flag: True}, {flag: False}, {flag: True}], STEPS)
    rolled.assert_equals_loop(STEPS)
    on, off, _ = (each.model.opt for each in rolled.prepared)
    assert (on.disableflags, on.enableflags) != (off.disableflags, off.enableflags)


@pytest.mark.parametrize("name", FIELDS)
def test_model_field(name: str, mixed: Scene, roll: Any) -> None:
    rolled = roll(mixed, [{}, {name: FIELDS[name]}], STEPS)
    rolled.assert_equals_loop(STEPS)
    assert rolled.rollout.steps == (STEPS, STEPS)
    own, other = (
        roll(mixed, [values], STEPS).rollout.state for values in ({}, {name: FIELDS[name]})
    )
    assert not np.array_equal(own, other)


def test_mass(roll: Any) -> None:
    values = [{"mass": mass} for mass in (0.01, 1.0, 50.0)]
    roll(Scene.open("ball_drop"), values, 400).assert_equals_loop(400)


@pytest.mark.long
@pytest.mark.parametrize("name", resources.scene_names())
def test_shipped_scene(name: str, roll: Any) -> None:
    scene = Scene.open(name, tables=read_control_table)
    roll(scene, [{}, {"cone": "elliptic", "timestep": 0.001}], 25).assert_equals_loop(25)


@pytest.mark.parametrize("boxes", [1, 2, 4])
def test_structure(boxes: int, roll: Any) -> None:
    values = [{"boxes": boxes}, {"boxes": boxes, "cone": "elliptic"}]
    rolled = roll(Scene.open("box_stack"), values, STEPS)
    rolled.assert_equals_loop(STEPS)
    assert rolled.prepared[0].model.nq == 7 * boxes


def test_pushes_and_controls(make_scene: Any, mixed: Scene, roll: Any) -> None:
    model = mixed.source.model.read_text()
    scene = make_scene(
        model,
        "initial:\n"
        "  push: {default: 0.0, unit: N, description: p, sets: {ball.fx: push, ball.tz: -push}}\n"
        "  drive: {default: 0.0, unit: N m, description: c, sets: {motor.ctrl: drive}}\n",
    )
    rolled = roll(scene, [{"push": 3.0}, {"drive": -0.7}, {"push": 1.0, "drive": 5.0}], STEPS)
    rolled.assert_equals_loop(STEPS)


def test_a_stack_that_falls_asleep(roll: Any) -> None:
    # It settles within half a second; runs that never sleep share the chunk.
    quick = {"boxes": 2, "solref": (0.005, 1.0)}
    values = [
        {**quick, "sleep": on, "friction.slide": mu} for on, mu in ((True, 1.0), (False, 0.7))
    ]
    rolled = roll(Scene.open("box_stack"), values, 900)
    rolled.assert_equals_loop(900)
    asleep = [not rolled.rollout.state[run, -1, -12:].any() for run in (0, 1)]
    assert asleep == [True, False]


@st.composite
def mixtures(draw: st.DrawFn) -> dict[str, Any]:
    pool = {**OTHER, **FIELDS, **{flag: draw(st.booleans()) for flag in SWITCHES}}
    names = draw(st.lists(st.sampled_from(sorted({*pool} - {*AT_REST})), unique=True, max_size=8))
    return {name: pool[name] for name in names}


@given(values=st.lists(mixtures(), min_size=2, max_size=4))
@settings(max_examples=15)
def test_any_mixture_in_one_batch(values: list[dict[str, Any]], mixed: Scene, roll: Any) -> None:
    roll(mixed, values, 40).assert_equals_loop(40)


def test_timesteps_share_a_batch_of_equal_step_count(roll: Any) -> None:
    values = [{"timestep": 0.0005 * (run + 1)} for run in range(4)]
    rolled = roll(Scene.open("ball_drop"), values, 300)
    rolled.assert_equals_loop(300)
    clock = rolled.rollout.state[:, :, 0]
    assert clock[:, -1] == pytest.approx([0.15, 0.3, 0.45, 0.6], rel=1e-12)


def test_recording_changes_nothing(roll: Any) -> None:
    # The model as MuJoCo loads it by itself, without our sensors, moves through the same states.
    rolled = roll(Scene.open("box_slide"), [{}], 300)
    bare = mujoco.MjModel.from_xml_path(str(rolled.scene.source.model))
    assert bare.nsensor == 0
    data = mujoco.MjData(bare)
    data.qpos[:], data.qvel[:] = rolled.starts.qpos[0], rolled.starts.qvel[0]
    for row in rolled.rollout.state[0]:
        assert np.array_equal(row[1:], [*data.qpos, *data.qvel])
        mujoco.mj_step(bare, data)
