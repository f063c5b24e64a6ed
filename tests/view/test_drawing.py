"""Drawings without OpenGL: outlines are those of the points, and every part is in its place."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.view.conftest import Drawn

from contactlab.live.browser_models import shown_groups
from contactlab.view.drawing import draw_frame
from contactlab.view.drawn_motion import read_motion
from contactlab.view.drawn_shapes import body_shapes, drawn_geoms
from contactlab.view.film import set_looks
from contactlab.view.render import PictureOptions, render_run

SVG = "{http://www.w3.org/2000/svg}"


def corners(polygon: ET.Element) -> np.ndarray:
    return np.array(
        [[float(x) for x in pair.split(",")] for pair in polygon.get("points", "").split()]
    )


def test_a_ball_is_drawn_as_a_circle_where_it_is(drawn: Callable[[str], Drawn]) -> None:
    run = drawn("ball")
    motion = read_motion(run.start.prepared_model, run.trace, 60.0)
    for frame in (0, len(motion.time) // 2):
        picture = ET.fromstring(  # noqa: S314 - our own
            f"<svg>{draw_frame(motion, frame, (480, 360))}</svg>"
        )
        [ball] = [corners(each) for each in picture.iter("polygon") if each.get("opacity") == "0.8"]
        view = motion.view(frame)
        pixels = 0.95 * 180 / view.radius
        [radius] = [shape.size[0] / 2 for shape in motion.shapes if motion.moving[shape.body]]
        middle = (ball.min(axis=0) + ball.max(axis=0)) / 2
        reach = np.linalg.norm(ball - middle, axis=1)
        assert reach == pytest.approx(radius * pixels, rel=0.03)
        [body] = np.flatnonzero(motion.moving)
        height = (motion.positions[frame, body] - view.centre)[2]
        assert 180 - middle[1] == pytest.approx(height * np.cos(np.radians(18)) * pixels, abs=1)


def test_arrows_are_as_long_as_their_forces(drawn: Callable[[str], Drawn], tmp_path: Path) -> None:
    run, target = drawn("stack"), tmp_path / "run.svg"
    motion = render_run(run.store, run.run, target, PictureOptions(at=(0.05,)))
    picture = ET.parse(target).getroot()  # noqa: S314 - our own
    forces = motion.forces.of(int(np.argmin(np.abs(motion.time - 0.05))))
    lines = picture.findall(f".//{SVG}line")
    assert len(lines) == len(motion.forces.frame[forces]) > 0
    assert all(float(each.get("y1", "")) > float(each.get("y2", "")) for each in lines)
    assert "0.050 s" in "".join(picture.itertext())


LEG = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <geom name="wall" type="box" size="1 .1 1" pos="0 2 1" group="3"/>
    <body pos="0 0 1"><freejoint/>
      <geom name="trunk" type="box" size=".3 .1 .1" group="3"/>
      <body pos="0 0 -.1"><joint axis="0 1 0"/>
        <geom name="shank" type="capsule" size=".03" fromto="0 0 0 0 0 -.4" group="4"/>
        <geom name="foot" size=".04" pos="0 0 -.4"/>
      </body>
      <body pos=".3 0 0"><joint axis="0 1 0"/>
        <geom name="head" type="box" size=".1 .1 .1" group="1"/>
        <geom name="box of head" type="box" size=".09 .09 .09" group="3"/>
        <geom name="ghost" size=".5" group="1" rgba="0 0 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_collision_geoms_are_drawn_where_nothing_else_is() -> None:
    """A foot in a visible group does not hide the shank; a head hides the box within it."""
    model = mujoco.MjModel.from_xml_string(LEG)
    drawn = {model.geom(geom).name for geom in np.flatnonzero(drawn_geoms(model)).tolist()}
    assert drawn == {"floor", "wall", "trunk", "shank", "foot", "head"}
    assert {shape.name.partition("/")[0] for shape in body_shapes(model)} == drawn
    set_looks(model, (64, 64))
    renderer = {model.geom(geom).name for geom in np.flatnonzero(model.geom_group < 3).tolist()}
    assert renderer == drawn | {"ghost"}
    assert (drawn_geoms(model) == (model.geom_group < 3) & (model.geom_rgba[:, 3] > 0)).all()


def test_a_page_that_simulates_gives_drawn_geoms_a_visible_group() -> None:
    model = mujoco.MjModel.from_xml_string(LEG)
    [(field, (geoms, groups))] = shown_groups(model).items()
    getattr(model, field)[geoms] = groups
    shown = (model.geom_group < 3) & (model.geom_rgba[:, 3] > 0)
    assert (shown == drawn_geoms(mujoco.MjModel.from_xml_string(LEG))).all()
    assert shown_groups(model) == {}
