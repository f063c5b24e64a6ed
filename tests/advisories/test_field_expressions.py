"""Expressions over fields equal slow loops over a model's objects, and refuse all else."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.advisories.field_expressions import FieldExpression, ModelFacts
from contactlab.expression import ExpressionError, NoValueError
from contactlab.scene.compiled_scene import compile_scene
from contactlab.scene.model_xml import ET, list_elements
from contactlab.scene.scene_source import find_scene

TEXT = """
<mujoco>
  <option solver="CG" integrator="RK4"/>
  <default><geom euler="90 0 0"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" euler="0 0 0"/>
    <body name="one" pos="0 0 .09">
      <freejoint name="free"/>
      <geom name="ball" size=".1" margin=".01"/>
      <body name="two" pos=".5 0 0"><joint name="hinge" axis="0 1 0"/>
        <geom name="box" type="box" size=".1 .2 .3"/>
      </body>
      <body name="three" pos="-.5 0 0"><joint name="slide" type="slide"/>
        <geom name="other" type="box" size=".1 .1 .1"/>
      </body>
    </body>
  </worldbody>
  <sensor><jointpos joint="hinge"/><framepos name="place" objtype="body" objname="two"/></sensor>
</mujoco>
"""


@pytest.fixture(scope="module")
def facts() -> ModelFacts:
    model = mujoco.MjModel.from_xml_string(TEXT)
    data = mujoco.MjData(model)
    data.qvel[:] = np.arange(1, model.nv + 1)
    mujoco.mj_forward(model, data)
    return ModelFacts(model, data, lambda: list_elements(ET.fromstring(TEXT)))


LOOPS: dict[str, Callable[[mujoco.MjModel, mujoco.MjData], Any]] = {
    "nv": lambda model, _: model.nv,
    "solver == 'CG' and integrator == 'RK4' and not nmesh > 0": lambda *_: 1,
    "timestep * 2": lambda model, _: 2 * model.opt.timestep,
    "smallest(gravity)": lambda model, _: min(model.opt.gravity),
    "count(geom_type == 'box' and geom_margin == 0)": lambda model, _: sum(
        model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX and model.geom_margin[geom] == 0
        for geom in range(model.ngeom)
    ),
    "count(not geom_type == 'box' or geom_margin > 0)": lambda *_: 2,
    "any(jnt_type == 'ball')": lambda *_: 0,
    "largest(geom_size[2])": lambda model, _: max(model.geom_size[:, 2]),
    "sum(body_mass[geom_bodyid])": lambda model, _: sum(
        model.body_mass[model.geom_bodyid[geom]] for geom in range(model.ngeom)
    ),
    "qvel['hinge']": lambda model, data: data.qvel[model.joint("hinge").dofadr[0]],
    "qvel['free', 4]": lambda _, data: data.qvel[4],
    "qpos['slide']": lambda _, data: data.joint("slide").qpos[0],
    "xpos['two', 2]": lambda _, data: data.body("two").xpos[2],
    "sensordata['place', 1]": lambda _, data: data.sensor("place").data[1],
    "norm(qacc)": lambda _, data: float(np.linalg.norm(data.qacc)),
    "largest(contact.dist)": lambda _, data: max(data.contact.dist),
    "depth('floor', 'ball')": lambda *_: 0.01,
    "contacts('ball', 'box')": lambda *_: 0,
    "distance('ball', 'other')": lambda *_: 0.3,
    "pairs(geom_type == 'box', geom_type == 'box')": lambda *_: 1,
    "pairs(geom_type == 'plane', geom_type == 'box')": lambda *_: 2,
    "sparse_jacobian": lambda *_: 0,
    "branching_trees": lambda *_: 1,
    "singular_inertia": lambda *_: 0,
    "elements('default/geom', 'euler')": lambda *_: 1,
    "elements('geom', 'type', 'box') + 10 * elements('geom', 'type', 'torus')": lambda *_: 2,
    "elements('body/geom', 'euler') + elements('geom', 'type')": lambda *_: 3,
    "any(site_bodyid == 3) or largest(mesh_vertnum) > 0": lambda *_: 0,
}


@pytest.mark.parametrize("text", LOOPS)
def test_an_expression_equals_the_loop(text: str, facts: ModelFacts) -> None:
    assert facts.data is not None
    expected = LOOPS[text](facts.model, facts.data)
    assert FieldExpression(text).evaluate_facts(facts) == pytest.approx(
        expected, rel=1e-12, abs=1e-12
    )


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        ("geom_margin > 0", ExpressionError, "any, count or largest"),
        ("qacc['nobody']", ExpressionError, "no joint 'nobody'"),
        ("xpos['two', 3]", ExpressionError, "smaller index"),
        ("pairs('box', 'mesh') > 0", ExpressionError, "truth values of geoms"),
        ("no_such_field > 0", NoValueError, "no_such_field"),
        ("ptr > 0", NoValueError, "ptr"),
        ("opt.__class__ == 1", NoValueError, "opt.__class__"),
    ],
)
def test_a_value_that_is_missing_is_named(
    text: str, error: type[ExpressionError], said: str, facts: ModelFacts
) -> None:
    with pytest.raises(error, match=said):
        FieldExpression(text).evaluate_facts(facts)


@pytest.mark.parametrize(
    "text",
    [
        *("qacc[1, 2]", "qacc['a', 'b']", "0 < nv < 3", "pick(qacc, 1)", "any(1, 2)", "pairs(1)"),
        *("__import__('os')", "qacc.__class__()", "[1, 2]", "lambda: 1", "qacc[1:2]", "{}"),
    ],
)
def test_other_syntax_is_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        FieldExpression(text)


def test_a_singular_inertia_is_seen() -> None:
    text = TEXT.replace('<joint name="hinge" axis="0 1 0"/>', '<joint axis="0 1 0"/>' * 2)
    text = text.replace('<jointpos joint="hinge"/>', "")
    model = mujoco.MjModel.from_xml_string(text)
    assert FieldExpression("singular_inertia").evaluate_facts(ModelFacts(model)) == 1


def test_sensors_that_record_runs_are_not_those_of_the_model() -> None:
    """A scene gets sensors of its energy; a predicate about sensors does not meet them."""
    base = compile_scene(find_scene("ball_drop"), {}).model
    assert base.nsensor
    facts = ModelFacts(base)
    found = FieldExpression("any(sensor_type == 'e_potential')").evaluate_facts(facts)
    assert not found
    assert len(facts.read_value("sensor_dim")) == 0
