"""The effective parameters of a pair are those that MuJoCo puts into its contacts."""

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.scene.contact_pairs import MonitoredPair, effective_parameters
from contactlab.scene.scene import Scene

TWO = """
<mujoco>
  <option>{option}</option>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1" {floor}/>
    <body pos="0 0 .09"><freejoint/><geom name="ball" size=".1" {ball}/></body>
  </worldbody>
  <contact>{pair}</contact>
</mujoco>
"""


def spelled(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def positive(most: float) -> st.SearchStrategy[float]:
    return st.just(0.0) | st.floats(1e-9, most)


FRICTION = positive(2)
STANDARD = st.tuples(st.floats(1e-3, 0.1), st.floats(0.05, 2))
DIRECT = st.tuples(st.floats(-1e6, -1), st.floats(-1e3, -1e-3) | st.just(0.0))
SOLIMP = st.tuples(
    st.floats(0.1, 0.99),
    st.floats(0.1, 0.99),
    st.floats(1e-4, 0.01),
    st.floats(0.1, 0.9),
    st.floats(1, 4),
)
SHELL = positive(0.01)
CONDIM = st.sampled_from([1, 3, 4, 6])


@st.composite
def attributes(draw: st.DrawFn, frictions: int = 3) -> str:
    values = {
        "friction": spelled(draw(st.tuples(*[FRICTION] * frictions))),
        "solref": spelled(draw(STANDARD | DIRECT)),
        "solimp": spelled(draw(SOLIMP)),
        "condim": draw(CONDIM),
        "margin": draw(SHELL),
        "gap": draw(SHELL),
    }
    return " ".join(f'{name}="{value}"' for name, value in values.items())


@st.composite
def geoms(draw: st.DrawFn) -> str:
    priority = draw(st.integers(0, 1))
    solmix = draw(st.sampled_from([0.0, 1e-16, 0.3, 1.0, 7.0]))
    return f'{draw(attributes())} priority="{priority}" solmix="{solmix}"'


def assert_effective(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 1
    contact = data.contact[0]
    for order in ((0, 1), (1, 0)):
        found = effective_parameters(
            model, MonitoredPair("p", ("", ""), False, ((order[0],), (order[1],)), 1)
        )
        assert found.condim == contact.dim
        assert found.margin == pytest.approx(contact.includemargin, rel=1e-15)
        # A weighted mean is rounded otherwise when its terms change places.
        for name in ("friction", "solref", "solimp"):
            assert getattr(found, name) == pytest.approx(getattr(contact, name).tolist(), rel=1e-14)


@pytest.mark.long
@given(geoms(), geoms())
@settings(max_examples=200)
def test_geoms_mix_as_in_mujoco(floor: str, ball: str) -> None:
    text = TWO.format(option="", floor=floor, ball=ball, pair="")
    assert_effective(mujoco.MjModel.from_xml_string(text))


@pytest.mark.long
@given(geoms(), geoms(), attributes(frictions=5), st.booleans())
@settings(max_examples=60)
def test_an_explicit_pair_decides(floor: str, ball: str, own: str, swapped: bool) -> None:
    names = ("ball", "floor") if swapped else ("floor", "ball")
    pair = f'<pair geom1="{names[0]}" geom2="{names[1]}" {own}/>'
    model = mujoco.MjModel.from_xml_string(TWO.format(option="", floor=floor, ball=ball, pair=pair))
    assert_effective(model)


@given(geoms(), geoms(), st.tuples(*[FRICTION] * 5), STANDARD | DIRECT, SOLIMP, SHELL)
@settings(max_examples=40)
def test_override_replaces(
    floor: str, ball: str, friction: Any, solref: Any, solimp: Any, margin: float
) -> None:
    model = mujoco.MjModel.from_xml_string(
        TWO.format(option='<flag override="enable"/>', floor=floor, ball=ball, pair="")
    )
    model.opt.o_friction[:], model.opt.o_margin = friction, margin
    model.opt.o_solref[:], model.opt.o_solimp[:] = solref, solimp
    assert_effective(model)


@pytest.mark.parametrize("distance", [-0.001, 0.003, 0.007, 0.02])
def test_margin_bounds_force_and_gap_bounds_contact(distance: float) -> None:
    shell = 'margin="0.0025" gap="0.002"'
    model = mujoco.MjModel.from_xml_string(TWO.format(option="", floor=shell, ball=shell, pair=""))
    found = effective_parameters(model, MonitoredPair("p", ("", ""), False, ((0,), (1,)), 1))
    data = mujoco.MjData(model)
    data.qpos[2] = 0.1 + distance
    mujoco.mj_forward(model, data)
    assert (data.ncon == 1) == (distance < found.margin + found.gap)
    assert (data.nefc > 0) == (distance < found.margin)


def test_friction_of_bodies_bounds_every_contact(make_scene: Any) -> None:
    # The visual geom comes first and touches nothing: it must not stand for its body.
    scene: Scene = make_scene(
        """
        <mujoco><worldbody>
          <body name="table"><geom type="box" size="1 1 .1" friction="0.1"/></body>
          <body name="cart" pos="0 0 .14"><freejoint/>
            <geom size=".2" contype="0" conaffinity="0" friction="9" solref="0.9 0.9"/>
            <geom pos="-.2 0 0" size=".05" friction="0.6" solref="0.01 1"/>
            <geom pos=".2 0 0" size=".05" friction="0.2" solref="0.01 1"/>
          </body>
        </worldbody></mujoco>""",
        "pairs: [{bodies: [table, cart]}]\n",
    )
    prepared = scene.base({}).prepare({"solref": (0.01, 1.0)})
    data = mujoco.MjData(prepared.model)
    mujoco.mj_forward(prepared.model, data)
    (pair,) = prepared.pairs.values()
    assert data.ncon == 2
    assert pair.friction[0] == data.contact.friction[:, 0].max() == 0.6
    assert np.all(data.contact.solref == [0.01, 1.0])
    assert pair.solref == (0.01, 1.0)
