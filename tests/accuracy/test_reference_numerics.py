"""Numerics share a reference; whatever else a run sets has one of its own."""

from typing import Any

import numpy as np
import pytest

from contactlab.accuracy.reference import NUMERICS, with_reference_numerics
from contactlab.scene.initial_states import perturbed_copy
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.run_setup import joints_of
from contactlab.scene.scene import Scene

DISCRETISING: list[dict[str, Any]] = [
    {"timestep": 1e-3},
    {"integrator": "RK4"},
    {"solver": "PGS"},
    {"iterations": 7},
    {"tolerance": 1e-4},
    {"ls_iterations": 3},
    {"ls_tolerance": 0.1},
    {"jacobian": "sparse"},
    {"ccd_iterations": 9},
    {"ccd_tolerance": 1e-3},
    {"warmstart": False},
    {"island": False},
    {"midphase": False},
    {"eulerdamp": False},
    {"sleep": True},
    {"implicit": True},
]
MODELLING: list[dict[str, Any]] = [
    {"solref": (0.01, 1.0)},
    {"restitution": 0.5},
    {"stiffness": 2e4},
    {"depth_at_rest": 1e-3},
    {"solimp": (0.8, 0.9, 0.001, 0.5, 2.0)},
    {"cone": "elliptic"},
    {"impratio": 10.0},
    {"friction": (0.4, 0.005, 0.0001)},
    {"condim": 6},
    {"margin": 0.01},
    {"gap": 0.001},
    {"noslip_iterations": 3},
    {"gravity": 1.0},
    {"mass": 2.0},
    {"density": 1.0},
    # Searches for the closest points of distance fields may end in different places.
    {"sdf_iterations": 7},
    {"sdf_initpoints": 7},
]
SWITCHES = ["refsafe", "multiccd", "nativeccd", "filterparent"]


MODEL = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="ball" pos="0 0 .2"><freejoint name="ball"/><geom name="ball" size=".1"/></body>
</worldbody></mujoco>"""
MANIFEST = """
version: 1
title: t
description: d
duration: 0.1
model: ball.xml
subject: ball
pairs: [{geoms: [floor, ball]}]
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("scene")
    (folder / "ball.xml").write_text(MODEL)
    (folder / "scene.yaml").write_text(MANIFEST)
    return Scene.open(str(folder))


def reference(scene: Scene, values: dict[str, Any], seed: int = 0) -> str:
    run = scene.resolve(values, seed, None)
    return scene.run_id(with_reference_numerics(run, "RK4", 1e-5))


def known(scene: Scene, values: dict[str, Any]) -> bool:
    return all(scene.catalogue.find_axis(name) is not None for name in values)


@pytest.mark.parametrize("values", DISCRETISING, ids=str)
def test_what_discretises_shares_a_reference(scene: Scene, values: dict[str, Any]) -> None:
    if not known(scene, values):
        pytest.skip("this engine lacks it")
    assert scene.run_id(scene.resolve(values, 0, None)) != scene.run_id(scene.resolve({}, 0, None))
    assert reference(scene, values) == reference(scene, {})


@pytest.mark.parametrize("values", MODELLING, ids=str)
def test_what_is_part_of_the_model_does_not(scene: Scene, values: dict[str, Any]) -> None:
    if not known(scene, values):
        pytest.skip("this engine lacks it")
    assert reference(scene, values) != reference(scene, {})


@pytest.mark.parametrize("name", SWITCHES)
def test_other_flags_are_part_of_the_model(scene: Scene, name: str) -> None:
    flags = scene.base({}).flags
    if name not in flags:
        pytest.skip("this engine lacks it")
    assert reference(scene, {name: not flags[name]}) != reference(scene, {})


def test_another_seed_has_its_own(scene: Scene) -> None:
    assert reference(scene, {}, seed=1) != reference(scene, {}, seed=0)


def test_every_option_was_decided_on() -> None:
    """An option that is neither here nor there would quietly share a reference, or quietly not."""
    decided = {name for values in (*DISCRETISING, *MODELLING) for name in values}
    decided |= {PARAMETERS[name].sets for name in decided & set(PARAMETERS)}
    # The passes that these bound are part of the model, and so are they; a medium is density too.
    decided |= {"noslip_tolerance", "viscosity"}
    assert {parameter.sets for parameter in PARAMETERS.values()} <= decided
    assert set(NUMERICS) <= decided


def test_a_reference_is_solved_to_the_end(scene: Scene) -> None:
    run = scene.resolve({"solver": "PGS", "iterations": 1, "island": False}, 0, None)
    settled = with_reference_numerics(run, "RK4", 1e-5)
    option = scene.prepare(settled, scene.initial_states([settled])).model.opt
    assert (option.timestep, option.iterations, option.tolerance) == (1e-5, 200, 1e-12)
    assert settled.settings["solver"] == "Newton"
    assert settled.flags["island"]


def test_a_perturbed_copy_differs_by_next_to_nothing(scene: Scene) -> None:
    run = scene.resolve({}, 0, None)
    start = scene.initial_states([run])
    joints = joints_of(scene.base_of(run).model)
    copy = perturbed_copy(start, joints, 3)
    apart = np.concatenate([(copy.qpos - start.qpos)[0], (copy.qvel - start.qvel)[0]])
    assert 0 < np.abs(apart).max() <= 1e-8
    assert (copy.qpos[0, 3:] == start.qpos[0, 3:]).all(), "rotations stay"
    assert (copy.qvel != start.qvel).all()
    assert (perturbed_copy(start, joints, 3).qpos == copy.qpos).all()
    assert (perturbed_copy(start, joints, 4).qpos != copy.qpos).any()
