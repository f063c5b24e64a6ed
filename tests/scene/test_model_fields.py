"""An edited model is the one that MuJoCo compiles from the edited MJCF."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.scene.model_edits import field_axis
from contactlab.scene.scene import Scene

# Derived quantities sum a few products, so that equal models agree to a few last bits.
REL = 1e-12
DEFAULTS = {
    "density": "1000", "mass": "", "margin": "0", "gap": "0", "stiffness": "3", "damping": "0.1",
    "armature": "0.01", "frictionloss": "0", "range": "-90 90", "inner": "1", "place": "0 0 0",
    "friction": "1 0.005 0.0001", "floor": "",
}  # fmt: skip
MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" {floor}/>
    <body name="cart" pos="0 0 .5">
      <freejoint/>
      <geom name="hull" type="box" size=".1 .2 .05" density="{density}" {mass}
            margin="{margin}" gap="{gap}" friction="{friction}"/>
      <geom name="knob" pos=".1 0 .1" size=".03" density="{density}"/>
      <body name="arm" pos="0 0 .2">
        <joint name="hinge" axis="0 1 0" stiffness="{stiffness}" damping="{damping}" range="{range}"
               armature="{armature}" frictionloss="{frictionloss}" limited="true" springref="10"/>
        <geom name="rod" type="capsule" size=".02 .1" pos="{place}" mass="{inner}"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="hinge" kp="3"/></actuator>
</mujoco>
"""
Make = Callable[..., Scene]


def open_scene(make_scene: Make, **values: str) -> Scene:
    return make_scene(MODEL.format(**{**DEFAULTS, **values}), "subject: cart\n")


def edited(scene: Scene, **values: Any) -> mujoco.MjModel:
    run = scene.resolve(values, 0, None)
    return scene.base({}).prepare(run.list_edits()).model


@pytest.mark.parametrize("density", ["1e-3", "50", "20000"])
def test_mass_is_another_density(density: str, make_scene: Make, differing: Any) -> None:
    wanted = edited(open_scene(make_scene, density=density))
    mass = float(wanted.body("cart").mass[0])
    assert differing(edited(open_scene(make_scene), mass=mass), wanted, REL) == set()


def test_mass_of_a_body_of_one_geom(make_scene: Make, differing: Any) -> None:
    ball = "<body><freejoint/><geom size='.1' mass='{}'/></body>"
    text = f"<mujoco><worldbody>{ball}</worldbody></mujoco>"
    wanted = edited(make_scene(text.format(7.5)))
    assert differing(edited(make_scene(text.format(1)), mass=7.5), wanted, REL) == set()


def test_mass_in_the_ball_scene_moves_subtree_and_weights() -> None:
    model = edited(Scene.open("ball_drop"), mass=4.0)
    ball = model.body("ball")
    assert ball.mass[0] == ball.subtreemass[0] == model.body_subtreemass[0] == 4.0
    # A solid sphere: I = 2/5 m r^2, and the inverse weight of translation is 1/m.
    assert ball.inertia == pytest.approx([0.4 * 4.0 * 0.05**2] * 3, rel=1e-12)
    assert ball.invweight0[0] == pytest.approx(0.25, rel=1e-12)


@pytest.mark.parametrize(("name", "value"), [("margin", 0.006), ("gap", 0.004)])
def test_margin_and_gap_are_those_of_two_geoms(
    name: str, value: float, make_scene: Make, differing: Any
) -> None:
    manifest = "pairs: [{geoms: [floor, hull]}]\n"
    plain = make_scene(MODEL.format(**DEFAULTS), manifest)
    half = str(value / 2)
    both = make_scene(
        MODEL.format(**{**DEFAULTS, name: half, "floor": f'{name}="{half}"'}), manifest
    )
    assert differing(edited(plain, **{name: value}), edited(both), REL) == set()


@pytest.mark.long
@pytest.mark.parametrize(
    ("field", "value", "attribute", "text"),
    [
        ("jnt_stiffness[hinge]", (9.0,), "stiffness", "9"),
        ("dof_damping[hinge]", 0.7, "damping", "0.7"),
        ("dof_armature[hinge]", 0.2, "armature", "0.2"),
        ("dof_frictionloss[hinge]", 0.3, "frictionloss", "0.3"),
        ("jnt_range[hinge]", tuple(np.radians([-5.0, 8.0])), "range", "-5 8"),
        ("geom_friction[hull]", (0.3, 0.01, 0.002), "friction", "0.3 0.01 0.002"),
        ("geom_friction[hull,1]", 0.02, "friction", "1 0.02 0.0001"),
        ("geom_margin[hull]", 0.01, "margin", "0.01"),
        ("geom_gap[hull]", 0.01, "gap", "0.01"),
    ],
)
def test_a_field_is_the_attribute_it_came_from(
    field: str, value: Any, attribute: str, text: str, make_scene: Make, differing: Any
) -> None:
    scene = open_scene(make_scene)
    axis = scene.catalogue.find_axis(field)
    assert axis is not None
    parsed = axis.parse(value)
    wanted = edited(open_scene(make_scene, **{attribute: text}))
    assert differing(edited(scene, **{field: parsed}), wanted, REL) == set()
    assert differing(edited(scene), wanted, REL)


def test_places_that_the_compiler_uses_are_followed(make_scene: Make) -> None:
    # MuJoCo takes a short cut for geoms at their body's own place; an edit must end it.
    model = edited(open_scene(make_scene), **{"geom_pos[rod]": (0.0, 0.3, 0.0)})
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.geom("rod").xpos == pytest.approx(data.body("arm").xpos + np.array([0, 0.3, 0]))


@pytest.mark.parametrize(
    "name",
    [
        "dof_damping", "dof_damping[]", "dof_damping[wheel]", "geom_friction[hull,3]",
        "dof_damping[hinge,0]", "geom_frictoin[hull]", "jnt_qposadr[hinge]", "geom_bodyid[hull]",
        "geom_size[hull]", "body_parentid[arm]", "geom_type[hull]", "body_subtreemass[cart]",
        "dof_invweight0[hinge]", "geom_sameframe[hull]", "body_simple[cart]", "ngeom[hull]",
        "__class__[hull]", "body_margin[cart]", "geom_contype[hull]", "geom_conaffinity[hull]",
        "actuator_trnid[x]",
    ],
)  # fmt: skip
def test_what_is_no_field_to_sweep_is_not_found(name: str, make_scene: Make) -> None:
    assert open_scene(make_scene).catalogue.find_axis(name) is None


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("dof_damping[hinge]", (1.0, 2.0), "write 1 numbers"),
        ("geom_friction[hull]", 1.0, "write 3 numbers"),
        ("geom_friction[hull,0]", "rough", "write a number"),
        ("geom_priority[hull]", 1.5, "whole number"),
        ("geom_group[hull]", 1e12, "at most"),
        ("geom_priority[hull]", True, "write a number"),
        ("geom_condim[hull]", 5, "write 1, 3, 4 or 6"),
    ],
)
def test_wrong_values_say_what_to_write(
    field: str, value: Any, message: str, make_scene: Make
) -> None:
    axis = field_axis(open_scene(make_scene).base({}).model, field)
    assert axis is not None
    with pytest.raises(ValueError, match=message):
        axis.parse(value)
