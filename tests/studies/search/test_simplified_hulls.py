"""Hulls of fewer vertices: how far they reach less, in closed form, and in the files of a model."""

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.plan.task_options import read_task_options
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.studies.search.simplified_hulls import (
    colliding_meshes,
    fewest_vertices,
    hull_distance,
    hull_vertices,
)
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

SIDES, RADIUS = 48, 0.1
ANGLES = 2 * math.pi * np.arange(SIDES) / SIDES
RIM = np.stack([RADIUS * np.cos(ANGLES), RADIUS * np.sin(ANGLES)], axis=1)
PRISM = np.concatenate([np.c_[RIM, np.full(SIDES, z)] for z in (-0.03, 0.03)])
BACK, FRONT = np.arange(SIDES), np.arange(SIDES) + SIDES
FACES = np.concatenate(
    [
        np.c_[np.zeros(SIDES), np.roll(BACK, -1), BACK][1:-1],
        np.c_[np.full(SIDES, SIDES), FRONT, np.roll(FRONT, -1)][1:-1],
        np.c_[BACK, np.roll(BACK, -1), FRONT],
        np.c_[np.roll(BACK, -1), np.roll(FRONT, -1), FRONT],
    ]
).astype(int)
PUCK = """<mujoco>
  <asset><mesh name="puck" vertex="{}" face="{}"/></asset>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body name="puck" pos="0 0 .1"><freejoint/><geom type="mesh" mesh="puck"/></body>
  </worldbody>
</mujoco>
""".format(" ".join(f"{number:.9f}" for number in PRISM.ravel()), " ".join(map(str, FACES.ravel())))


def made(vertices: dict[str, int], text: str = PUCK) -> mujoco.MjModel:
    """Return the puck with hulls of so many vertices."""
    spec = mujoco.MjSpec.from_string(text)
    for name, count in vertices.items():
        spec.mesh(name).maxhullvert = count
    return spec.compile()


@pytest.mark.parametrize("every", [1, 2, 3, 4, 6])
def test_a_prism_of_fewer_sides_reaches_less_by_the_height_of_its_segments(every: int) -> None:
    """A vertex in the middle of a chord over `every` sides of a circle lies r (1 - cos) beyond.

    Of an odd number none lies in the middle: the nearest lies half a side off. The tolerance is
    what a weight of 1e3 on the sum of the weights leaves of 1, over the size.
    """
    angle = 2 * math.pi / SIDES
    off = (every % 2) * angle / 2
    height = RADIUS * (math.cos(off) - math.cos(every * angle / 2)) if every > 1 else 0.0
    fewer = np.concatenate([PRISM[:SIDES:every], PRISM[SIDES::every]])
    assert hull_distance(PRISM, fewer) == pytest.approx(height, abs=1e-5 * RADIUS)


def test_the_fewest_vertices_within_a_distance_are_found() -> None:
    model = made({})
    (mesh,) = colliding_meshes(model)
    assert len(hull_vertices(model, mesh)) == 2 * SIDES
    counts = list[int]()
    for within in (2e-3, 1e-2, 3e-2):
        found = fewest_vertices(model, made, within)
        smaller = made(found)
        assert hull_distance(hull_vertices(model, mesh), hull_vertices(smaller, mesh)) <= within
        assert len(hull_vertices(smaller, mesh)) <= found.get("puck", 2 * SIDES)
        counts.append(found.get("puck", 2 * SIDES))
    assert counts[0] > counts[1] > counts[2]
    assert not fewest_vertices(model, made, 1e-9)


def test_a_mesh_that_is_its_hull_keeps_it() -> None:
    """Without faces, volume and inertia are the hull's: with fewer vertices it weighs less."""
    faceless = re.sub(' face="[^"]*"', "", PUCK)

    def compiled(vertices: dict[str, int]) -> mujoco.MjModel:
        return made(vertices, faceless)

    assert compiled({"puck": 24}).body_mass[1] < compiled({}).body_mass[1]
    assert made({"puck": 24}).body_mass[1] == made({}).body_mass[1]
    assert not fewest_vertices(compiled({}), compiled, 1e-2)


def test_a_model_is_written_with_fewer_vertices_and_is_what_was_meant(tmp_path: Path) -> None:
    path = tmp_path / "puck.xml"
    path.write_text(PUCK)
    task = read_task_options(drive="none", duration="0.1s")
    examined = open_model(str(path), Session(tmp_path / "out"), task)
    edits = ModelEdits(hulls={"puck": 12})
    written = write_model(examined.scene, edits, tmp_path / "made")
    assert 'maxhullvert="12"' in written.path.read_text()
    own, meant = mujoco.MjModel.from_xml_path(str(written.path)), made({"puck": 12})
    assert np.array_equal(hull_vertices(own, 0), hull_vertices(meant, 0))
