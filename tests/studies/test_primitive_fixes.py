"""Hulls of meshes that primitives may stand for: which, and what is written."""

import itertools
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.budget_reasons import budget_reason

from contactlab.budget import Verdict
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_draft import PRIMITIVES
from contactlab.scene.model_writer import write_model
from contactlab.studies.examine.primitive_fixes import list_primitives, measure_distances
from contactlab.tasks.task_motions import task_motions

HALF = (0.05, 0.04, 0.03)
CORNERS = [np.multiply(HALF, signs) for signs in itertools.product((-1, 1), repeat=3)]
WEDGE = [corner for corner in CORNERS if corner[0] < 0 or corner[2] < 0]


def model(corners: list[np.ndarray], height: float = 0.029) -> str:
    vertices = " ".join(f"{value:g}" for corner in corners for value in corner)
    return f"""<mujoco><asset><mesh name="block" vertex="{vertices}"/></asset><worldbody>
    <geom type="plane" size="1 1 .1"/><body name="brick" pos="0 0 {height}"><freejoint/>
    <geom name="shell" type="mesh" mesh="block"/></body></worldbody></mujoco>"""


def proposed(text: str, folder: Path, body: str = "brick"):  # noqa: ANN201 - scene and candidates
    path = folder / "brick.xml"
    path.write_text(text)
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    motions = task_motions(scene, {}, scene.task({}, 0.02))
    verdict = Verdict("inaccurate", 0.1, (budget_reason("inaccurate", "", "run", 1, body, ""),))
    return scene, [*list_primitives(scene, {}, motions, verdict)]


def test_the_hull_of_a_box_may_be_a_box(tmp_path: Path) -> None:
    scene, (candidate,) = proposed(model(CORNERS), tmp_path)
    assert (candidate.apply, candidate.changes_model) == ("primitive", True)
    assert candidate.name == "a box in place of the hull of shell"
    made = write_model(scene, candidate.edits, tmp_path / "new")
    written = mujoco.MjModel.from_xml_path(str(made.path))
    geom = written.geom("shell")
    assert geom.type[0] == mujoco.mjtGeom.mjGEOM_BOX
    np.testing.assert_allclose(np.sort(geom.size), np.sort(HALF), rtol=1e-6)
    assert 'type="box"' in made.lines[0]


def test_no_primitive_stands_for_what_none_resembles(tmp_path: Path) -> None:
    """Corners of a wedge are far from whatever has its inertia."""
    assert proposed(model(WEDGE), tmp_path)[1] == []


@pytest.mark.parametrize(("body", "height"), [("other", 0.029), ("brick", 1.0)])
def test_what_no_verdict_names_or_touches_nothing_keeps_its_hull(
    body: str, height: float, tmp_path: Path
) -> None:
    assert proposed(model(CORNERS, height), tmp_path, body)[1] == []


@pytest.mark.parametrize("shape", PRIMITIVES)
def test_distances_are_those_that_mujoco_finds_of_a_small_ball(shape: str) -> None:
    """Within a part in a million of the ball's radius; an ellipsoid's are of first order."""
    size, radius = np.array([0.3, 0.2, 0.1]), 1e-3
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=PRIMITIVES[shape], size=size)
    ball = spec.worldbody.add_body()
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0])
    made = spec.compile()
    data, random = mujoco.MjData(made), np.random.default_rng(0)
    for direction in random.normal(size=(20, 3)):
        point = 0.6 * direction / np.linalg.norm(direction)
        data.qpos[:3] = point
        mujoco.mj_kinematics(made, data)
        found = mujoco.mj_geomDistance(made, data, 0, 1, 10, None) + radius
        said = measure_distances(shape, size, point[None])[0]
        if shape == "ellipsoid":
            assert 0 < said < 2 * found
        else:
            assert said == pytest.approx(found, abs=1e-6)
