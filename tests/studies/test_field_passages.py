"""Geoms that fall through a height field are found by its surface, at any step."""

from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.studies.examine.field_passages import find_field_passages, surface_heights

FIELD = """<mujoco><option timestep="{step}"/>
<asset><hfield name="hills" nrow="{cells}" ncol="{cells}" size="2 1 .3 .1"
elevation="{elevation}"/></asset>
<worldbody><geom name="ground" type="hfield" hfield="hills"/>
  <body name="box" pos=".21 .17 {height}"><freejoint/>
    <geom type="box" size=".02 .02 .02" mass=".2"/></body></worldbody></mujoco>"""


def model_of(cells: int, height: float = 0.5, step: float = 0.002) -> mujoco.MjModel:
    ways = np.arange(cells)
    hills = 0.5 + 0.5 * np.sin(1.7 * ways)[:, None] * np.cos(1.7 * ways)
    elevation = " ".join(f"{one:.4f}" for one in hills.ravel())
    text = FIELD.format(cells=cells, elevation=elevation, height=height, step=step)
    return mujoco.MjModel.from_xml_string(text)


def drop_box(model: mujoco.MjModel, seconds: float = 1.0) -> Motion:
    data = mujoco.MjData(model)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, data, start[0], INTEGRATION)
    steps = round(seconds / model.opt.timestep)
    return Motion(model, start, np.empty((1, steps, model.nu)), name="rest")


@cache
def field_at_rest() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a field, and its data after a forward computation."""
    model = model_of(6)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@given(st.floats(-1.99, 1.99), st.floats(-0.99, 0.99))
def test_the_surface_is_where_a_ray_meets_the_field(x: float, y: float) -> None:
    """MuJoCo cuts each cell in one of two ways; the surface is the lower one of them."""
    model, data = field_at_rest()
    geom = np.zeros(1, np.int32)
    only = np.ones(6, np.uint8)
    far = mujoco.mj_ray(
        model, data, np.array([x, y, 5.0]), np.array([0, 0, -1.0]), only, True, 1, geom
    )
    met = 5.0 - far
    (height,) = surface_heights(model, 0, np.array([[x, y]]))
    assert height <= met + 1e-9
    assert height >= 0


def test_the_surface_of_a_plane_is_that_plane_and_ends_with_the_field() -> None:
    model = model_of(7)
    grid = np.add.outer(np.arange(7), 2 * np.arange(7)) / 18
    model.hfield_data[:] = grid.ravel()
    places = np.array([[-2.0, -1.0], [0.3, 0.1], [2.0, 1.0], [2.1, 0.0]])
    heights = surface_heights(model, 0, places)
    across, along = (places[:, 0] + 2) / 4 * 6, (places[:, 1] + 1) / 2 * 6
    flat = 0.3 * (along + 2 * across) / 18
    assert heights[:3] == pytest.approx(flat[:3])
    assert np.isnan(heights[3])


@pytest.mark.skipif(
    int(mujoco.__version__.partition(".")[0]) < 4, reason="MuJoCo 3.17 does not let this box pass"
)
@pytest.mark.parametrize("step", [0.002, 0.0005])
def test_a_small_box_falls_through_large_cells_at_any_step(step: float) -> None:
    motion = drop_box(model_of(6, step=step))
    (passage,) = find_field_passages([motion], [0.0])
    assert passage.depth > 0.02
    assert 0 < passage.time < 1


def test_a_box_on_small_cells_or_that_begins_below_has_not_passed() -> None:
    assert find_field_passages([drop_box(model_of(80))], [0.0]) == []
    assert find_field_passages([drop_box(model_of(6, height=-1.0))], [0.0]) == []


def test_a_plate_over_many_cells_misses_contacts_if_it_fails() -> None:
    # A floor of cells of 1 cm under a plate that covers 3,600 of them; 50 are the most of a pair.
    heights = " ".join(["1"] * 101**2)
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <asset><hfield name="f" nrow="101" ncol="101" size=".5 .5 .1 .1" elevation="{heights}"/>
      </asset>
      <worldbody><geom type="hfield" hfield="f" pos="0 0 -.1"/>
      <body pos="0 0 .021"><freejoint/><geom type="box" size=".3 .3 .02"/></body></worldbody>
      </mujoco>""")
    motion = drop_box(model)
    (crowded,) = find_field_passages([motion], [0.0], failing=True)
    assert (crowded.depth, crowded.field, crowded.geom) == (0, 0, 1)
    assert not any(passage.depth == 0 for passage in find_field_passages([motion], [0.0]))
