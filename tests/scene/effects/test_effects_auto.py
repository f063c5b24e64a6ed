"""What `effects: auto` leaves out changes nothing; what could change something is kept."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from contactlab import resources
from contactlab.engines import Buffers
from contactlab.engines.mujoco_batch import roll_out
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.effects.proofs import RunState
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.scene import Scene
from contactlab.store.control_tables import read_control_table

MakeScene = Callable[..., Scene]
Prepare = Callable[..., PreparedModel]
SCENES = resources.scene_names()
_STEPS = 150
_BALL = (
    '<body name="ball" pos="0 0 1"><freejoint name="ball"/><geom name="ball" size=".05"/></body>'
)
_FLOOR = '<geom name="floor" type="plane" size="2 2 .1"/>'


def states(scene: Scene, model: mujoco.MjModel) -> np.ndarray:
    """Return the states of a short run of a scene's own start."""
    silence_mujoco()
    start = scene.initial_states([scene.resolve({}, 0, None)])
    return roll_out([model], start, _STEPS, Buffers()).state[0].copy()


def off(found: PreparedModel) -> set[str]:
    """Return the effects that are off."""
    return {name for name, choice in found.effects.items() if not choice.on}


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_no_shipped_scene_moves_otherwise(prepared: Prepare, name: str) -> None:
    """Bit for bit, or, where friction is left out of a straight drop, to rounding.

    The cone's rows then sum to the normal force in another order: an error of 1e-16 of the
    force a step, which 150 steps and one bounce grow to less than 1e-12.
    """
    scene = Scene.open(name, tables=read_control_table)
    auto, everything = prepared(scene), prepared(scene, "all")
    exact = auto.effects["tangential_friction"].on == everything.effects["tangential_friction"].on
    difference = np.abs(states(scene, auto.model) - states(scene, everything.model)).max()
    assert difference <= (0 if exact else 1e-12)


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_what_is_off_is_not_in_the_model(prepared: Prepare, name: str) -> None:
    scene = Scene.open(name, tables=read_control_table)
    found = prepared(scene)
    base = scene.base_of(scene.resolve({}, 0, None))
    run = RunState(found.model, base.facts, straight=False)
    assert set(found.effects) == set(EFFECTS)
    assert off(found) == {each for each, effect in EFFECTS.items() if not effect.switch.is_on(run)}
    assert all(choice.reason for choice in found.effects.values())


def test_a_straight_drop_has_contacts_of_one_dimension(prepared: Prepare) -> None:
    found = prepared(Scene.open("ball_drop"))
    assert {pair.condim for pair in found.pairs.values()} == {1}
    assert found.model.geom_condim.tolist() == [1, 1]
    assert "straight" in found.effects["tangential_friction"].reason


@pytest.mark.parametrize(
    "start",
    [
        "ball.vx: speed",
        "ball.wz: speed",
        "ball.fx: speed",
        "ball.ty: speed",
    ],
)
def test_a_drop_that_is_not_straight_keeps_friction(
    prepared: Prepare, make_scene: MakeScene, start: str
) -> None:
    coordinate, value = start.split(": ")
    manifest = (
        f"initial: {{speed: {{default: 0.1, unit: m/s, description: s, "
        f"sets: {{{coordinate}: {value}}}}}}}\n"
    )
    scene = make_scene(f"<mujoco><worldbody>{_FLOOR}{_BALL}</worldbody></mujoco>", manifest)
    assert prepared(scene).effects["tangential_friction"].on
    assert not prepared(scene, speed=0.0).effects["tangential_friction"].on


@pytest.mark.parametrize(
    "world",
    [
        _FLOOR.replace("/>", ' euler="1 0 0"/>') + _BALL,
        _FLOOR.replace("/>", ' friction="0.5"/>').replace("<geom", "<geom") + _BALL,
        _FLOOR
        + _BALL.replace('size=".05"', 'size=".05" pos=".01 0 0"').replace(
            "<freejoint", '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><freejoint'
        ),
        _FLOOR + _BALL + _BALL.replace('"ball"', '"other"').replace("0 0 1", ".05 0 2"),
        _FLOOR + _BALL.replace('size=".05"', 'type="box" size=".05 .05 .05"'),
    ],
    ids=["tilted", "pyramid", "off_centre", "two_balls", "box"],
)
def test_other_drops_keep_friction(prepared: Prepare, make_scene: MakeScene, world: str) -> None:
    """A pyramid of friction 0.5 gives another normal force than no friction at all."""
    ball = world.replace('name="ball"/><geom', 'name="ball"/><geom friction="0.5"', 1)
    world = ball if 'friction="0.5"' in world else world
    scene = make_scene(f"<mujoco><worldbody>{world}</worldbody></mujoco>", "")
    assert prepared(scene).effects["tangential_friction"].on


def _pendulum(joint: str = "", more: str = "", option: str = "", side: str = "") -> str:
    return (
        f"<mujoco><option {option}/><worldbody><body><joint name='j' {joint}/>"
        f"<geom size='.1' pos='0 0 -1'/>{side}</body></worldbody>{more}</mujoco>"
    )


_TWO = "<body pos='1 0 0'><joint name='k'/><geom size='.1' pos='0 0 1'/></body>"
_TENDON = "<tendon><fixed name='t' {}><joint joint='j' coef='1'/></fixed></tendon>"
# For each effect, a model in which it acts.
ACTING = {
    "air": _pendulum(option="density='1'"),
    "spring": _pendulum(joint="stiffness='1'"),
    "damper": _pendulum(joint="damping='1'"),
    "eulerdamp": _pendulum(joint="damping='1'"),
    "frictionloss": _pendulum(joint="frictionloss='1'"),
    "limit": _pendulum(joint="range='-1 1' limited='true'"),
    "equality": _pendulum(more="<equality><joint joint1='j'/></equality>"),
    "actuation": _pendulum(more="<actuator><motor joint='j'/></actuator>"),
    "clampctrl": _pendulum(
        more="<actuator><motor joint='j' ctrlrange='-1 1' ctrllimited='true'/></actuator>"
    ),
    "tendon": _pendulum(more=_TENDON.format("stiffness='1'")),
    "gravity": _pendulum(),
    "implicit": _pendulum(option="integrator='implicitfast'"),
    "warmstart": _pendulum(joint="frictionloss='1'"),
    "island": _pendulum().replace("<worldbody>", f"<worldbody>{_TWO}"),
    "contact": _pendulum().replace("<worldbody>", f"<worldbody>{_TWO}"),
    "tangential_friction": _pendulum().replace("<worldbody>", f"<worldbody>{_TWO}"),
    "midphase": _pendulum(side="<geom size='.1'/>").replace("<worldbody>", f"<worldbody>{_FLOOR}"),
    "multiccd": _pendulum()
    .replace("<geom", "<geom type='cylinder'")
    .replace("size='.1'", "size='.1 .1'")
    .replace("<worldbody>", "<worldbody><geom type='box' size='1 1 1' pos='0 0 -3'/>"),
}


@pytest.mark.parametrize("name", ACTING)
def test_what_acts_is_kept(prepared: Prepare, make_scene: MakeScene, name: str) -> None:
    found = prepared(make_scene(ACTING[name], ""))
    assert found.effects[name].on
    if name != "gravity":
        assert not prepared(make_scene(_pendulum(), "")).effects[name].on


@pytest.mark.skipif(
    not hasattr(mujoco.MjModel, "tendon_dampingpoly"), reason="this engine's damping is linear"
)
@pytest.mark.parametrize(
    "more",
    [
        _TENDON.format("damping='0 3'"),
        "<actuator><motor joint='j' damping='0 3'/></actuator>",
    ],
    ids=["tendon", "actuator"],
)
def test_damping_without_a_linear_part_is_kept(
    prepared: Prepare, make_scene: MakeScene, more: str
) -> None:
    assert prepared(make_scene(_pendulum(more=more), "")).effects["damper"].on


def test_air_stays_though_springs_and_damping_are_left_out(
    prepared: Prepare, make_scene: MakeScene
) -> None:
    """Without either, the engine leaves out all passive forces."""
    for option, body in (("density='1000' wind='1 0 0'", "<body>"), ("", "<body gravcomp='1'>")):
        scene = make_scene(_pendulum(option=option).replace("<body>", body), "")
        auto, everything = prepared(scene), prepared(scene, "all")
        assert np.array_equal(states(scene, auto.model), states(scene, everything.model))


@pytest.mark.skipif("speculative" not in FLAG_NAMES, reason="speculative came with MuJoCo 4.0")
def test_contacts_ahead_of_touch_need_the_general_collision_function(prepared: Prepare) -> None:
    scene = Scene.open("thin_plate")
    assert not prepared(scene).effects["multiccd"].on
    assert prepared(scene, speculative=True).effects["multiccd"].on


def test_a_bare_model_is_taken_as_written(prepared: Prepare, make_scene: MakeScene) -> None:
    scene = make_scene(_pendulum(more=_TENDON.format("")))
    assert prepared(scene, None).effects["tendon"].on
    assert not prepared(scene, "auto").effects["tendon"].on
