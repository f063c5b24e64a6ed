"""The monitored pairs of a bare model: every pair of geoms that MuJoCo ever puts in contact."""

import pickle
from collections import OrderedDict
from collections.abc import Callable
from itertools import product

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from contactlab.scene import compiled_scene, contact_pairs
from contactlab.scene.compile_model import compile_model, name_sensors
from contactlab.scene.contact_pairs import (
    MonitoredPair,
    colliding_geoms,
    detected_pairs,
    geom_pairs,
    touch_mask,
    touch_pairs,
)
from contactlab.scene.scene import Scene

SHAPES = {
    "sphere": "size='.1'",
    "capsule": "size='.06 .1'",
    "box": "size='.1 .08 .06'",
    "cylinder": "size='.1 .05'",
    "ellipsoid": "size='.1 .08 .06'",
}
POSES = 12
# With more, not all of their pairs are monitored.
MOST_GEOMS = 11
Make = Callable[..., Scene]


@st.composite
def geom(draw: st.DrawFn, name: str) -> str:
    shape = draw(st.sampled_from(sorted(SHAPES)))
    # Off centre, since engines differ on shapes about one and the same point.
    place = " ".join(str(draw(st.integers(-30, 30)) / 1000 + 1e-4) for _ in range(3))
    bits = draw(st.sampled_from([(1, 1), (1, 0), (0, 1), (0, 0), (2, 1), (1, 2), (2, 2)]))
    return (
        f"<geom name='{name}' type='{shape}' {SHAPES[shape]} pos='{place}' "
        f"contype='{bits[0]}' conaffinity='{bits[1]}'/>"
    )


@st.composite
def bodies(draw: st.DrawFn, name: str, depth: int) -> str:
    """Return a body whose joint is free at the root, a hinge below, or a weld to its parent."""
    joint = "" if draw(st.integers(0, 3)) == 0 else "<joint axis='1 1 0'/>"
    if depth == 0:
        joint = draw(st.sampled_from(["", "<freejoint/>"]))
    inside = "".join(draw(geom(f"{name}g{k}")) for k in range(draw(st.integers(1, 2))))
    if depth < 2:
        children = range(draw(st.integers(0, 2 - depth)))
        inside += "".join(draw(bodies(f"{name}{k}", depth + 1)) for k in children)
    mass = "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"
    return f"<body name='{name}'>{joint}{mass}{inside}</body>"


@st.composite
def models(draw: st.DrawFn) -> str:
    plane = draw(st.sampled_from(["", "<geom name='floor' type='plane' size='1 1 1'/>"]))
    fixed = draw(st.sampled_from(["", "<geom name='wall' type='box' size='.2 .2 .2'/>"]))
    roots = "".join(draw(bodies(f"b{k}", 0)) for k in range(draw(st.integers(1, 2))))
    listed = ""
    if "name='b0'" in roots and "name='b1'" in roots and draw(st.booleans()):
        listed += "<exclude body1='b0' body2='b1'/>"
    if plane and draw(st.booleans()):
        listed += "<pair geom1='floor' geom2='b0g0'/>"
    parents = draw(st.sampled_from(["enable", "disable"]))
    return (
        f"<mujoco><option><flag filterparent='{parents}'/></option>"
        f"<worldbody>{plane}{fixed}{roots}</worldbody><contact>{listed}</contact></mujoco>"
    )


def compiled(text: str) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(text)
    assume(model.ngeom <= MOST_GEOMS)
    return model


def touching(model: mujoco.MjModel, seed: int) -> dict[frozenset[int], int]:
    """Return the pairs that touch in random poses, with the most contacts that each had."""
    rng = np.random.default_rng(seed)
    data, found = mujoco.MjData(model), dict[frozenset[int], int]()
    for _ in range(POSES):
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
        free = model.jnt_qposadr[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)]
        for address in free:
            data.qpos[address : address + 3] = rng.uniform(-0.15, 0.15, 3)
        mujoco.mj_forward(model, data)
        counts: dict[frozenset[int], int] = {}
        for both in data.contact.geom.tolist():
            counts[frozenset(both)] = counts.get(frozenset(both), 0) + 1
        for both, count in counts.items():
            found[both] = max(found.get(both, 0), count)
    return found


@pytest.mark.long
@given(text=models(), seed=st.integers(0, 1000))
@settings(max_examples=80)
def test_no_contact_is_ungraded(text: str, seed: int) -> None:
    assert_graded(text, seed)


@pytest.mark.night
@given(text=models(), seed=st.integers(0, 1000))
@settings(max_examples=1500)
def test_no_contact_is_ungraded_in_many_models(text: str, seed: int) -> None:
    assert_graded(text, seed)


def assert_graded(text: str, seed: int) -> None:
    model = compiled(text)
    monitored = {
        frozenset((each.geoms[0][0], each.geoms[1][0])): each for each in detected_pairs(model)
    }
    for both, count in touching(model, seed).items():
        assert both in monitored
        assert count <= monitored[both].slots


@pytest.mark.long
@pytest.mark.skipif(
    int(mujoco.__version__.partition(".")[0]) < 4,
    reason="before MuJoCo 4, a box and a cylinder about one centre have no contact",
)
@given(text=models())
@settings(max_examples=40)
def test_no_pair_is_graded_that_mujoco_never_makes(text: str) -> None:
    # At the start, all centres lie within 0.11 m of each other, and all half sizes add up to that.
    model = compiled(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    made = {frozenset(both) for both in data.contact.geom.tolist()}
    assert {
        frozenset((each.geoms[0][0], each.geoms[1][0])) for each in detected_pairs(model)
    } <= made


def test_many_geoms_are_searched_by_a_short_run(make_scene: Make) -> None:
    # Twelve balls could touch in 78 ways; these two stacks of two on a floor do in 4.
    balls = "".join(
        f"<body pos='{x} 0 {z}'><freejoint/><geom size='.1'/></body>"
        for x, z in [(0, 0.1), (0, 0.3), (1, 0.1), (1, 0.3)]
    )
    far = "".join(f"<body pos='{x} 5 9'><freejoint/><geom size='.1'/></body>" for x in range(8))
    text = f"<mujoco><option gravity='0 0 0'/><worldbody>{{}}{balls}{far}</worldbody></mujoco>"
    scene = make_scene(text.format("<geom type='plane' size='1 1 1' pos='0 0 .001'/>"))
    names = [pair.name for pair in scene.base({}).pairs]
    assert len(names) == contact_pairs.MAX_PAIRS < 78
    # A free ball may fall onto the floor from anywhere; then come the nearest of the others.
    stacked = {"geom[1]-geom[2]", "geom[3]-geom[4]"}
    assert {f"geom[0]-geom[{ball}]" for ball in range(1, 13)} | stacked == set(names[:14])


def test_names_given_to_geoms_do_not_clash(make_scene: Make) -> None:
    scene = make_scene(
        "<mujoco><worldbody><geom name='geom1' type='plane' size='1 1 1'/>"
        "<replicate count='2' offset='1 0 0'>"
        "<body pos='0 0 .1'><freejoint/><geom size='.1'/></body>"
        "</replicate></worldbody></mujoco>"
    )
    model = scene.base({}).model
    names = [model.geom(each).name for each in range(model.ngeom)]
    assert names[0] == "geom1"
    assert len(set(names)) == 3
    assert all(names)


def test_chains_and_patterns() -> None:
    base = Scene.open("box_stack").base({"boxes": 4})
    names = [pair.name for pair in base.pairs]
    assert names == ["floor-box0", "box0-box1", "box1-box2", "box2-box3"]
    assert {pair.slots for pair in base.pairs} == {6}


@pytest.mark.parametrize("order", ["floor, box", "box, floor"])
def test_the_normal_points_from_the_first_side_to_the_second(order: str, make_scene: Make) -> None:
    scene = make_scene(
        "<mujoco><worldbody><geom name='floor' type='plane' size='1 1 1'/><body name='b' "
        "pos='0 0 .099'><freejoint/><geom name='box' type='box' size='.1 .1 .1'/></body>"
        "</worldbody></mujoco>",
        f"pairs: [{{geoms: [{order}]}}]\n",
    )
    base = scene.base({})
    assert base.pairs[0].sides == tuple(order.split(", "))
    data = mujoco.MjData(base.model)
    mujoco.mj_forward(base.model, data)
    slots = data.sensordata[base.layout.pairs[0] :][: 23 * base.pairs[0].slots].reshape(-1, 23)
    assert slots[:4, 0].tolist() == [4.0] * 4
    assert slots[:4, 11:14] == pytest.approx(
        np.tile([0, 0, 1.0 if order == "floor, box" else -1.0], (4, 1))
    )


def test_users_sensors_stay_where_they_are(make_scene: Make) -> None:
    text = (
        "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body name='b' pos='0 0 .099'>"
        "<freejoint/><geom size='.1'/></body></worldbody>"
        "<sensor><framepos objtype='body' objname='b'/><clock/></sensor></mujoco>"
    )
    base = make_scene(text).base({})
    data = mujoco.MjData(base.model)
    mujoco.mj_forward(base.model, data)
    assert data.sensordata[:3] == pytest.approx([0, 0, 0.099])
    assert data.sensordata[base.layout.contacts] == 1
    assert data.sensordata[base.layout.contacts + 1] == pytest.approx(-0.001)


def test_a_height_field_has_room_for_its_contacts(make_scene: Make) -> None:
    heights = " ".join(str((row + column) % 2) for row in range(9) for column in range(9))
    scene = make_scene(
        "<mujoco><asset><hfield name='h' nrow='9' ncol='9' size='.4 .4 .02 .1' "
        f"elevation='{heights}'/></asset>"
        "<worldbody><geom name='land' type='hfield' hfield='h'/>"
        "<body pos='.03 .02 .1'><freejoint/><geom name='ball' size='.1'/></body></worldbody>"
        "</mujoco>"
    )
    (pair,) = scene.base({}).pairs
    data = mujoco.MjData(scene.base({}).model)
    mujoco.mj_forward(scene.base({}).model, data)
    assert 1 < data.ncon <= pair.slots


def test_the_search_goes_from_a_keyframe_as_well(make_scene: Make) -> None:
    """Fourteen weightless balls far apart; two touch at the start, two others at the keyframe."""
    balls = "".join(
        f"<body pos='{0.19 if index == 1 else index} 0 0'><joint name='j{index}' type='slide'/>"
        f"<geom name='g{index}' size='.1'/></body>"
        for index in range(14)
    )
    qpos = " ".join("-.81" if index == 5 else "0" for index in range(14))
    text = (
        f"<mujoco><option gravity='0 0 0'/><default><joint axis='1 0 0'/></default><worldbody>"
        f"{balls}</worldbody><keyframe><key name='other' qpos='{qpos}'/></keyframe></mujoco>"
    )
    names = [pair.name for pair in make_scene(text).base({}).pairs]
    assert set(names[:2]) == {"g0-g1", "g4-g5"}


def touches_by_rules(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Return whether two geoms may touch, by the rules of MuJoCo's documentation, one by one."""
    pairs = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    if {first, second} in map(set, pairs):
        return True
    geoms = first, second
    bodies = [int(model.geom_bodyid[geom]) for geom in geoms]
    one, other = (int(model.body_weldid[body]) for body in bodies)
    kinds = [(int(model.geom_contype[each]), int(model.geom_conaffinity[each])) for each in geoms]
    if not (kinds[0][0] & kinds[1][1] or kinds[1][0] & kinds[0][1]) or one == other:
        return False
    surfaces = {int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)}
    flat = {int(model.geom_type[geom]) for geom in geoms} <= surfaces
    if flat or not (model.body_dofnum[one] or model.body_dofnum[other]):
        return False
    excluded = [divmod(int(each), 1 << 16) for each in model.exclude_signature]
    if tuple(bodies) in excluded or tuple(reversed(bodies)) in excluded:
        return False
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        return True
    above = {each: int(model.body_weldid[model.body_parentid[each]]) for each in (one, other)}
    return not ((one and above[other] == one) or (other and above[one] == other))


@pytest.mark.parametrize("seed", range(8))
def test_the_mask_is_that_of_the_rules_pair_by_pair(seed: int) -> None:
    random = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
    bodies = [spec.worldbody]
    for number in range(9):
        body = bodies[random.integers(len(bodies))].add_body(name=f"b{number}")
        if random.random() < 0.6:
            body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE)
        for _ in range(random.integers(1, 3)):
            bits = random.integers(0, 4, 2).tolist()
            body.add_geom(size=[0.1, 0, 0], contype=bits[0], conaffinity=bits[1])
        bodies.append(body)
    for _ in range(2):
        names = random.choice(9, 2, replace=False).tolist()
        spec.add_exclude(bodyname1=f"b{names[0]}", bodyname2=f"b{names[1]}")
    if seed % 2:
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    model = spec.compile()
    touch = touch_mask(model)
    for first in range(model.ngeom):
        for second in range(model.ngeom):
            expected = first != second and touches_by_rules(model, first, second)
            assert touch[first, second] == expected, (first, second)
    assert touch_pairs(model) == geom_pairs(touch)
    # Pairs of bodies find the same geoms without the mask.
    sides = {body: np.flatnonzero(model.geom_bodyid == body).tolist() for body in range(9)}
    pairs = [
        MonitoredPair("pair", ("", ""), bodies=True, geoms=(one, other), slots=1)
        for one, other in product(map(tuple, sides.values()), repeat=2)
    ]
    assert colliding_geoms(model, pairs) == [
        [geoms for geoms in product(*pair.geoms) if touch[geoms]] for pair in pairs
    ]


def test_listed_pairs_touch_whatever_their_masks_are() -> None:
    spec = mujoco.MjSpec()
    names = [spec.worldbody.add_geom(name=f"g{n}", size=[0.1, 0, 0]).name for n in range(3)]
    moving = spec.worldbody.add_body()
    moving.add_freejoint()
    moving.add_geom(name="m", size=[0.1, 0, 0])
    spec.add_pair(geomname1="m", geomname2=names[1])
    spec.add_pair(geomname1=names[2], geomname2=names[0])
    model = spec.compile()
    assert touch_pairs(model) == geom_pairs(touch_mask(model)) == [(0, 2), (0, 3), (1, 3), (2, 3)]
    pair = MonitoredPair("pair", ("", ""), bodies=True, geoms=((0, 1, 2, 3), (2, 3)), slots=1)
    touching = [(0, 2), (0, 3), (1, 3), (2, 3), (3, 2)]
    assert colliding_geoms(model, [pair]) == [touching]
    others = touch_pairs(model, listed=False)
    assert others == geom_pairs(touch_mask(model, listed=False)) == [(0, 3), (2, 3)]


@pytest.mark.parametrize("bodies", ["free", "hinged", "both"])
def test_the_likeliest_of_many_pairs_are_those_of_a_full_list(bodies: str) -> None:
    """The ranks are those of an obvious loop over all pairs, ties included."""
    parts = []
    for index in range(14):
        joint = (
            "<freejoint/>" if bodies == "free" or (bodies == "both" and index % 2) else "<joint/>"
        )
        geom = f'<geom size="0.0{1 + index % 3}" mass="1"/>'
        parts.append(f'<body pos="{index % 4} {index // 4} 9">{joint}{geom}</body>')
    fixed = "".join(f'<geom size="0.1" pos="{x} 0 5"/>' for x in range(3))
    plane = '<geom type="plane" size="9 9 1"/>'
    world = f"<worldbody>{plane}{fixed}{''.join(parts)}</worldbody>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><option gravity='0 0 0'/>{world}</mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    free = [model.body_dofnum[body] == 6 for body in model.geom_bodyid]
    fixed_geoms = [model.body_weldid[body] == 0 for body in model.geom_bodyid]

    def rank(pair: tuple[int, int]) -> tuple[int, float, tuple[int, int]]:
        first, second = pair
        group = 2
        if free[first] or free[second]:
            group = 0 if fixed_geoms[first] or fixed_geoms[second] else 1
        gap = np.linalg.norm(data.geom_xpos[first] - data.geom_xpos[second])
        gap -= model.geom_rbound[[first, second]].sum()
        return group, -np.inf if 0 in pair else float(gap), pair

    pairs = contact_pairs.touch_pairs(model)
    assert len(pairs) > 2 * contact_pairs.MAX_PAIRS
    expected = sorted(pairs, key=rank)[: contact_pairs.MAX_PAIRS]
    found = [(pair.geoms[0][0], pair.geoms[1][0]) for pair in contact_pairs.detected_pairs(model)]
    assert found == expected


def test_pairs_that_another_process_detected_are_monitored(
    make_scene: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    balls = "<body pos='0 0 {}'><freejoint/><geom size='.1'/></body>"
    model = "".join(balls.format(height) for height in range(3))
    scene = make_scene(f"<mujoco><worldbody>{model}</worldbody></mujoco>")
    pairs = scene.base({}).pairs
    sent = pickle.loads(pickle.dumps(scene.find_detected()))  # noqa: S301 - our own
    monkeypatch.setattr(compiled_scene, "_DETECTED", OrderedDict())
    monkeypatch.delattr(compiled_scene, "detected_pairs")
    compiled_scene.share_detected(sent)
    assert len(pairs) == 3
    assert compiled_scene.compile_scene(scene.source, {}).pairs == pairs


def test_a_copy_of_a_specification_is_the_model_that_is_written(make_scene: Make) -> None:
    """The file is parsed once, edits of one model do not reach the next, and a new file counts."""
    scene = make_scene("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")

    def add_geom(spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_geom(size=[0.2, 0, 0])

    def count_geoms(edit: Callable[[mujoco.MjSpec], None]) -> int:
        return int(compile_model(scene.source, {}, edit).ngeom)

    assert [count_geoms(edit) for edit in (name_sensors, add_geom, name_sensors)] == [1, 2, 1]
    text = scene.source.model.read_text()
    scene.source.model.write_text(text.replace("<geom", "<geom size='.3'/><geom"))
    assert count_geoms(name_sensors) == 2
