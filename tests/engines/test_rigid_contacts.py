"""Rigid contacts are what MuJoCo mixes, and what arrives in an engine is what was sent."""

import math
import re
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.contact_laws import damping_ratio, restitution_from_damping
from contactlab.resources import ADAPTERS

RIGID, ARRIVALS = (
    SimpleNamespace(**run_path(str(ADAPTERS / "beside" / f"{name}.py")))
    for name in ("rigid_contacts", "arrivals")
)
# All shapes overlap, so that MuJoCo itself says which pairs touch, and what it mixes for them.
HEAP = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" friction=".3" solref=".02 .5"/>
    <geom name="post" type="box" size=".1 .1 .1" solref="-900 -12" contype="2" conaffinity="3"/>
    <body name="arm"><joint/>
      <geom name="arm" size=".1" friction=".7 .02 .001" condim="4" solmix="3" solref=".01 .4"/>
      <body name="hand"><joint axis="1 0 0"/>
        <geom name="hand" size=".09" friction=".2" priority="1" condim="6" solref=".03 .2"/>
        <body name="nail"><geom name="nail" size=".05" friction=".9"/></body>
      </body>
    </body>
    <body name="cup"><freejoint/><geom name="cup" type="capsule" size=".08 .05" solmix="0"/></body>
    <body name="lid"><freejoint/><geom name="lid" type="cylinder" size=".08 .05" condim="1"/></body>
    <body name="tag"><freejoint/><geom name="tag" size=".05" contype="4" conaffinity="0"/></body>
  </worldbody>
  <contact>
    <exclude body1="cup" body2="hand"/>
    <pair geom1="tag" geom2="floor" friction=".6 .6 .1 .2 .2" condim="6" solref=".02 .3"/>
  </contact>
</mujoco>
"""


@pytest.mark.skipif(
    int(mujoco.__version__.partition(".")[0]) < 4,
    reason="older versions filter pairs of fixed bodies otherwise",
)
@pytest.mark.parametrize("flag", ["", '<flag filterparent="disable"/>'])
def test_pairs_and_what_they_have_are_those_that_mujoco_mixes(flag: str) -> None:
    text = HEAP.replace("<worldbody>", f"<option>{flag}</option><worldbody>", 1)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    expected = {}
    for contact in data.contact:
        sliding, _, torsion, rolling, _ = contact.friction.tolist()
        expected[tuple(sorted(contact.geom.tolist()))] = (
            sliding * (contact.dim > 1),
            torsion * (contact.dim > 3),
            rolling * (contact.dim > 4),
            float(restitution_from_damping(damping_ratio(contact.solref))),
            *contact.solref,
            *contact.solimp,
        )
    found = RIGID.pairs_of(model)
    assert found.keys() == expected.keys()
    for pair, law in found.items():
        assert np.hstack(law) == pytest.approx(expected[pair], abs=1e-12)


def test_nothing_touches_without_contact() -> None:
    text = HEAP.replace("<worldbody>", '<option><flag contact="disable"/></option><worldbody>', 1)
    assert RIGID.pairs_of(mujoco.MjModel.from_xml_string(text)) == {}


@pytest.mark.parametrize("zeta", [0.0, 0.2, 0.99, 1.0, 1.5, 20.0])
def test_restitution_is_the_closed_form_in_either_form_of_solref(zeta: float) -> None:
    expected = pytest.approx(float(restitution_from_damping(zeta)), rel=1e-9)
    assert RIGID.restitution_of(0.02, zeta) == expected
    assert RIGID.restitution_of(-1e4, -2 * zeta * 100) == expected


def test_numbers_of_geoms_combine_to_what_pairs_want() -> None:
    wanted = {(0, 1): 0.5, (0, 2): 0.2, (1, 3): 0.0}
    added = {(0, 1): 0.5, (0, 2): 0.2}
    products, sums = RIGID.as_products(wanted), RIGID.as_sums(added)
    assert products[0] * products[1] == pytest.approx(0.5)
    assert products[0] * products[2] == pytest.approx(0.2)
    assert 3 not in products
    assert [sums[a] + sums[b] for a, b in added] == pytest.approx(list(added.values()))
    assert min(sums.values()) >= 0
    # Around a square, opposite sides have equal products and equal sums.
    square = {(0, 1): 0.5, (1, 2): 0.5, (2, 3): 0.5, (0, 3): 0.2}
    with pytest.raises(ValueError, match="no numbers"):
        RIGID.as_products(square)
    with pytest.raises(ValueError, match="no numbers"):
        RIGID.as_sums(square)
    with pytest.raises(ValueError, match="no numbers"):  # one of them would be below 0
        RIGID.as_sums({(0, 1): 0.1, (1, 2): 0.1, (0, 2): 0.9})


def test_what_arrives_otherwise_is_named() -> None:
    sent, names = np.array([[1.0, 2.0], [3.0, 0.0]]), ["body 'a'", "body 'b'"]
    ARRIVALS.compare("the inertia", sent, sent * (1 + 5e-7), names)
    with pytest.raises(ValueError, match="the inertia of body 'b' was sent as 3 0 and arrived as"):
        ARRIVALS.compare("the inertia", sent, sent + np.diag([0, 1e-5]), names)
    with pytest.raises(ValueError, match="body 'a'"):
        ARRIVALS.compare("the inertia", sent, np.full((2, 2), np.nan), names)
    ARRIVALS.compare("the mass", [], [], [])
    masses = np.array([13.0, 0.0])
    ARRIVALS.compare("the mass", masses, ARRIVALS.positive(masses), names)
    with pytest.raises(ValueError, match="the mass of body 'b' was sent as 0 and arrived as 2e-08"):
        ARRIVALS.compare("the mass", masses, [13, 2e-8], names)


def test_dynamics_that_arrive_otherwise_are_named() -> None:
    """A joint farther along an axis, a heavier body and less gravity each tell in them."""
    text = """
    <mujoco><option gravity="0 0 GRAVITY"/><worldbody><body><joint name="swing" axis="0 1 .2"/>
      <geom size=".1" mass="1"/><body pos="PLACE"><joint name="turn" armature=".1"/>
        <geom type="box" size=".1 .2 .3" mass="MASS"/></body></body></worldbody></mujoco>"""
    sent = {"GRAVITY": "-9.81", "PLACE": ".5 0 .1", "MASS": "2"}

    def made(words: dict[str, str]) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(
            re.sub("GRAVITY|PLACE|MASS", lambda word: words[word[0]], text)
        )

    def check(arrived: mujoco.MjModel) -> None:
        def dynamics(qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            data, inertia = mujoco.MjData(arrived), np.zeros((2, 2))
            data.qpos[:], data.qvel[:] = qpos, qvel
            mujoco.mj_forward(arrived, data)
            mujoco.mj_fullM(arrived, data, inertia)
            return inertia, data.qfrc_bias

        ARRIVALS.check_dynamics(made(sent), dynamics)

    check(made(sent))
    for other, told in (
        ({"GRAVITY": "-9.8"}, "the bias of joint 'swing', dof 0,"),
        ({"PLACE": ".5 0 .101"}, "the inertia of joint 'swing'"),
        ({"MASS": "2.001"}, "the inertia of joint 'swing'"),
    ):
        with pytest.raises(ValueError, match=told):
            check(made(sent | other))


PRESSED = """
<mujoco>
  <option cone="elliptic"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="box" pos=".3 .1 .049"><freejoint/><geom name="box" type="box" size=".1 .1 .05"/>
      <geom name="bump" size=".03" pos="0 0 .06"/></body>
    <body name="ball" pos=".3 .1 .178"><freejoint/><geom name="ball" size=".04"/></body>
  </worldbody>
  <sensor>
    <contact name="one" geom1="floor" geom2="box" num="4"
      data="found force torque dist pos normal tangent linvel angvel"/>
    <contact name="other" body1="ball" body2="box" num="2"
      data="found force torque dist pos normal tangent linvel angvel"/>
    <contact name="all" num="1" reduce="mindist" data="found dist"/>
    <framepos objtype="body" objname="ball"/>
  </sensor>
</mujoco>
"""


def world_force(slot: np.ndarray) -> np.ndarray:
    normal, tangent = slot[11:14], slot[14:17]
    return slot[1:4] @ np.array([normal, tangent, np.cross(normal, tangent)])


def test_slots_of_an_engines_contacts_are_those_of_sensors() -> None:
    """The engine is MuJoCo itself: its contacts, given one by one, come back as its sensors'."""
    model = mujoco.MjModel.from_xml_string(PRESSED)
    data = mujoco.MjData(model)
    data.qvel[:] = [0.1, 0.2, -0.1, 0.3, 0.1, -0.4, 0.2, 0.1, -0.3, 1, 2, 3]
    mujoco.mj_forward(model, data)
    contacts = [contact_of(model, data, each) for each in range(data.ncon)]
    state = np.concatenate([data.qpos, data.qvel])[None]
    told = RIGID.measured(model, state, np.zeros((1, 0)), [contacts])[0]
    for name in ("one", "other"):
        slots = [each.reshape(-1, 23) for each in sensed(model, name, data.sensordata, told)]
        ours, theirs = ({tuple(slot[8:11].round(9)): slot for slot in rows} for rows in slots)
        assert ours.keys() == theirs.keys()
        for place in ours:
            one, other = ours[place], theirs[place]
            assert other[[0, 7]] == pytest.approx(one[[0, 7]])
            assert other[8:14] == pytest.approx(one[8:14], abs=1e-12)
            assert world_force(other) == pytest.approx(world_force(one), abs=1e-9)
            # Relative velocities, in a frame whose tangents may be others.
            for first in (17, 20):
                assert other[first] == pytest.approx(one[first], abs=1e-9)
                size = np.linalg.norm(one[first : first + 3])
                assert np.linalg.norm(other[first : first + 3]) == pytest.approx(size)
    assert told[-5:] == pytest.approx(data.sensordata[-5:])


def contact_of(model: mujoco.MjModel, data: mujoco.MjData, number: int) -> Any:
    contact, force = data.contact[number], np.zeros(6)
    mujoco.mj_contactForce(model, data, number, force)
    frame = contact.frame.reshape(3, 3)
    rest = force[:3] @ frame, contact.pos, frame[0], contact.dist
    one, other = contact.geom.tolist()
    # Told of either order, it is the same contact.
    if number % 2:
        return RIGID.Contact.of(other, one, -rest[0], rest[1], -rest[2], rest[3])
    return RIGID.Contact.of(one, other, *rest)


def sensed(model: mujoco.MjModel, name: str, *rows: np.ndarray) -> list[np.ndarray]:
    sensor = model.sensor(name)
    return [row[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]] for row in rows]


def test_a_filter_dropped_and_a_contact_overlooked_are_named() -> None:
    model = mujoco.MjModel.from_xml_string(PRESSED)
    data = mujoco.MjData(model)
    data.qpos[2] -= 0.01
    mujoco.mj_forward(model, data)
    contacts = [contact_of(model, data, each) for each in range(data.ncon)]
    pairs = RIGID.pairs_of(model)
    RIGID.check_contacts(model, data, contacts, pairs)
    others = [each for each in contacts if each.geoms != (0, 1)]
    with pytest.raises(ValueError, match=r"geom 'floor' and geom 'box' overlap by 0\.011"):
        RIGID.check_contacts(model, data, others, pairs)
    filtered = {pair: law for pair, law in pairs.items() if pair != (0, 1)}
    with pytest.raises(ValueError, match="geom 'floor' and geom 'box' touch, which the model"):
        RIGID.check_contacts(model, data, contacts, filtered)


def test_a_hull_has_the_corners_of_its_mesh_that_stand_out() -> None:
    corners = "0 0 0 1 0 0 0 1 0 0 0 1 .1 .1 .1"
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="a" vertex="{corners}"/></asset>'
        '<worldbody><body><freejoint/><geom type="mesh" mesh="a"/></body></worldbody></mujoco>'
    )
    hull = RIGID.hull_of(model, 0)
    assert len(hull) == 4
    # A regular corner's four points: three legs of 1 and three diagonals.
    lengths = sorted(math.dist(a, b) for k, a in enumerate(hull) for b in hull[:k])
    assert lengths == pytest.approx([1, 1, 1, *[math.sqrt(2)] * 3], rel=1e-6)


def test_what_lies_beside_adapters_knows_nothing_of_contactlab() -> None:
    for file in (ADAPTERS / "beside").glob("*.py"):
        assert "contactlab" not in Path(file).read_text(encoding="utf-8")
