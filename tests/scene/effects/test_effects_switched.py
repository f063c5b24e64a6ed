"""Effects that a scene or a sweep switches by name, and what they do to a run's identity."""

from collections.abc import Callable

import numpy as np
import pytest

from contactlab.errors import SceneError
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.scene import Scene
from contactlab.schema.sweep_schema import Sweep, effect_switches, effects_base

MakeScene = Callable[..., Scene]
Prepare = Callable[..., PreparedModel]
FRICTIONS = [("tangential_friction", 1), ("torsional_friction", 3), ("rolling_friction", 4)]
BALL = Scene.open("ball_drop")
MANY = """
<mujoco>
  <option density="1.2" viscosity="1e-5" wind="1 0 0" impratio="5" noslip_iterations="2"
    cone="elliptic" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" condim="6"/>
    <body name="a" pos="0 0 1"><freejoint name="a"/><geom name="a" size=".1" condim="4"/>
      <site name="s"/></body>
    <body name="b" pos="1 0 1"><joint name="b"/><geom name="b" size=".1"/></body>
  </worldbody>
  <tendon><fixed name="t"><joint joint="b" coef="1"/></fixed></tendon>
  <sensor><gyro site="s"/><tendonpos tendon="t"/><touch site="s"/></sensor>
</mujoco>
"""


def run_id(scene: Scene, **values: object) -> str:
    return scene.run_id(scene.resolve(values, 0, None))


@pytest.mark.interface
@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_can_be_switched_off(
    prepared: Prepare, make_scene: MakeScene, name: str
) -> None:
    """By its axis; gravity and impratio take `false` for the value that leaves them out."""
    scene = make_scene(MANY)
    spec = scene.catalogue.find_axis(name)
    assert spec is not None
    found = prepared(scene, "all", **{name: spec.parse(False)})
    state = found.effects[name]
    assert not state.on or (name == "gravity" and not found.model.opt.gravity.any())


@pytest.mark.parametrize(("name", "most"), FRICTIONS)
def test_friction_effects_bound_every_contact(
    prepared: Prepare, unequal: Scene, name: str, most: int
) -> None:
    scene = unequal
    dims = [*scene.base({}).model.geom_condim, *scene.base({}).model.pair_dim]
    model = prepared(scene, "all", **{name: False}).model
    assert [*model.geom_condim, *model.pair_dim] == [min(dim, most) for dim in dims]
    # A sweep's own condim is bounded too.
    assert prepared(scene, "all", condim=6, **{name: False}).model.geom_condim.max() <= most


def test_on_makes_sure_of_an_effect(prepared: Prepare) -> None:
    found = prepared(BALL, "all", rolling_friction=True, elliptic=True, noslip=True, implicit=True)
    assert {pair.condim for pair in found.pairs.values()} == {6}
    assert (found.model.opt.cone, found.model.opt.noslip_iterations) == (1, 3)
    assert found.effects["implicit"].on


def test_tendons_and_sensors_are_not_compiled(prepared: Prepare, make_scene: MakeScene) -> None:
    scene = make_scene(MANY)
    whole = prepared(scene, "all")
    assert (whole.model.ntendon, whole.effects["sensor"].on) == (1, True)
    plain = prepared(scene, "auto")
    assert plain.model.ntendon == 0
    # Its own three, and the one that records the tendon.
    assert whole.model.nsensor - plain.model.nsensor == 4
    # The tendon's sensor needs its tendon.
    kept = prepared(scene, "auto", sensor=True)
    assert (kept.model.ntendon, kept.model.nsensor) == (1, whole.model.nsensor)
    silent = prepared(scene, "all", energy=False)
    assert whole.model.nsensor - silent.model.nsensor == 2


def test_a_tendon_that_a_sweep_names_is_kept(prepared: Prepare, make_scene: MakeScene) -> None:
    scene = make_scene(MANY)
    found = prepared(scene, "auto", **{"tendon_stiffness[t]": 10.0})
    assert found.model.tendon_stiffness.tolist() == [10.0]


def test_tendons_that_act_are_switched_off_by_their_coefficients(
    prepared: Prepare, make_scene: MakeScene
) -> None:
    text = MANY.replace('name="t"', 'name="t" stiffness="5" damping="2" range="0 1" limited="true"')
    model = prepared(make_scene(text), "all", tendon=False).model
    assert model.ntendon == 1
    assert not np.any([model.tendon_stiffness, model.tendon_damping, model.tendon_limited])


def test_what_a_sweep_sets_is_not_left_out(prepared: Prepare) -> None:
    assert prepared(BALL, "auto", condim=6).model.geom_condim.tolist() == [6, 6]


def test_what_changes_nothing_is_no_part_of_a_runs_identity() -> None:
    everything = BALL.with_effects("all")
    assert run_id(BALL) == run_id(everything) == run_id(everything, rolling_friction=False)
    assert run_id(BALL, elliptic=False) == run_id(BALL)
    other = {run_id(BALL), run_id(BALL, tangential_friction=False), run_id(BALL, elliptic=True)}
    assert len(other | {run_id(BALL, midphase=False), run_id(BALL, energy=False)}) == 5
    assert run_id(BALL, elliptic=True) == run_id(BALL, cone="elliptic")


def test_a_scene_switches_effects_and_a_sweep_overrides_it(
    prepared: Prepare, make_scene: MakeScene
) -> None:
    scene = make_scene(MANY, "effects: {base: all, warmstart: false, impratio: false}\n")
    found = prepared(scene, None)
    assert not found.effects["warmstart"].on
    assert found.effects["tendon"].on
    assert found.model.opt.impratio == 1
    assert prepared(scene, None, warmstart=True).effects["warmstart"].on


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ("{warmstrt: false}", "warmstart"),
        ("{iterations: true}", "no effect 'iterations'"),
        ("{gravity: true}", "gravity"),
        ("{base: some}", "invalid manifest"),
        ("{warmstart: auto}", "true or false"),
    ],
)
def test_a_wrong_effect_of_a_scene_is_named(
    make_scene: MakeScene, effects: str, message: str
) -> None:
    with pytest.raises(SceneError, match=message):
        make_scene(MANY, f"effects: {effects}\n")


@pytest.mark.parametrize(
    ("given", "base", "named"),
    [
        ("auto", "auto", {}),
        ("all", "all", {}),
        ({"island": True, "base": "auto"}, "auto", {"island": True}),
        ({"multiccd": False}, None, {"multiccd": False}),
    ],
)
def test_a_sweep_says_it_in_a_word_or_by_name(
    given: object, base: str | None, named: dict[str, bool]
) -> None:
    sweep = Sweep.model_validate({"version": 1, "scene": "ball_drop", "effects": given})
    assert (effects_base(sweep.effects), effect_switches(sweep.effects)) == (base, named)
    assert Sweep.model_validate(sweep.model_dump(mode="json")).effects == sweep.effects


def test_every_switch_of_the_engine_is_an_effect() -> None:
    assert set(FLAG_NAMES) <= set(EFFECTS)
