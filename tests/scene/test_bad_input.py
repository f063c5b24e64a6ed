"""Whatever is wrong with a scene is a SceneError that names the file and the thing."""

import re
from pathlib import Path
from typing import Any

import mujoco
import pytest

from contactlab.errors import SceneError
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import find_scene

MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="box" pos="0 0 1"><freejoint name="box"/><geom name="box" size=".1"/></body>
    <body name="empty">
      <body name="ghost"><geom size=".1" contype="0" conaffinity="0"/></body>
    </body>
  </worldbody>
  <keyframe><key name="home"/></keyframe>
</mujoco>
"""
HEAD = "version: 1\ntitle: t\ndescription: d\nduration: 0.1\n"
INITIAL = "initial: {{{name}: {{default: {default}, unit: m, description: d, sets: {sets}}}}}\n"
STRUCTURE = (
    "structure: {{{name}: {{default: 1, unit: m, description: d, element: '{element}', "
    "attribute: {attribute}}}}}\n"
)


def initial(sets: str, name: str = "x", default: Any = 1) -> str:
    return INITIAL.format(name=name, default=default, sets=sets)


def structure(element: str, attribute: str = "size", name: str = "x") -> str:
    return STRUCTURE.format(name=name, element=element, attribute=attribute)


# The manifest's lines, and the words of the message.
MANIFESTS: dict[str, tuple[str, list[str]]] = {
    "geom": ("pairs: [{geoms: [flor, box]}]", ["flor", "did you mean 'floor'"]),
    "geom in a chain": ("pairs: [{chain: [floor, crate*]}]", ["crate*"]),
    "chain of one": ("pairs: [{chain: [floor]}]", ["floor", "two"]),
    "body": ("pairs: [{bodies: [world, bx]}]", ["bx", "did you mean 'box'"]),
    "body without geoms": ("pairs: [{bodies: [world, empty]}]", ["empty", "geom"]),
    "body that touches nothing": ("pairs: [{bodies: [world, ghost]}]", ["ghost", "geom"]),
    "pair of nothing": ("pairs: [{slots: 3}]", ["geoms, bodies and chain"]),
    "pair of two kinds": ("pairs: [{geoms: [floor, box], chain: [floor, box]}]", ["geoms, bodies"]),
    "pair twice": ("pairs: [{geoms: [floor, box]}, {chain: [floor, box]}]", ["floor-box", "twice"]),
    "slots": ("pairs: [{geoms: [floor, box], slots: 0}]", ["pairs.0.slots"]),
    "subject": ("subject: bx", ["bx", "did you mean 'box'"]),
    "subject without mass": ("subject: empty", ["empty", "mass"]),
    "keyframe": ("keyframe: hoem", ["hoem", "did you mean 'home'"]),
    "coordinate": (initial("{box.zz: x}"), ["box.zz"]),
    "perturbed coordinate": ("perturb: {coordinates: [ball.x], scale: 1}", ["ball.x"]),
    "perturbed without scale": ("perturb: {coordinates: [box.x], scale: 0}", ["perturb.scale"]),
    "expression": (initial("{box.z: 2 * (x}"), ["2 * (x", "'x'", "box.z"]),
    "forbidden expression": (initial("{box.z: x.real}"), ["x.real"]),
    "unknown name": (initial("{box.z: x + y}"), ["box.z", "unknown y", "write one of x"]),
    "expression of a word": (initial("{box.z: \"'high'\"}"), ["'high'", "not a number"]),
    "comparison": (initial("{box.z: x > 3}"), ["x > 3", "not a number"]),
    "division by zero": (initial("{box.z: 1 / (x - 1)}"), ["1 / (x - 1)", "zero"]),
    "overflow": (initial("{box.z: x ** 400}", default=1000), ["x ** 400"]),
    "root": (initial("{box.z: sqrt(x)}", default=-1), ["sqrt(x)"]),
    "name of a parameter": (initial("{box.z: '1'}", name="friction"), ["friction", "rename it"]),
    "name of a switch": (initial("{box.z: '1'}", name="warmstart"), ["warmstart", "rename it"]),
    "name of the mass": (initial("{box.z: '1'}", name="mass"), ["mass", "rename it"]),
    "one name for two": (
        initial("{box.z: x}") + structure(".//geom", "margin"),
        ["'x'", "rename it"],
    ),
    "element": (structure(".//sphere"), [".//sphere", "structure 'x'"]),
    "absolute path": (structure("/mujoco/worldbody"), ["structure 'x'", "/mujoco/worldbody"]),
    "broken path": (structure(".//geom["), ["structure 'x'", ".//geom["]),
    "attribute": (structure(".//geom", "sise"), ["sise"]),
    "unknown key": ("frictoin: 1", ["frictoin"]),
    "unknown key within": ("oracle: {nmae: stack_sag}", ["oracle.nmae"]),
    "wrong type": ("duration: long", ["duration"]),
    "infinite duration": ("duration: .inf", ["duration"]),
    "version": ("version: 2", ["version"]),
    "duplicate key": ("title: again", ["title"]),
    "not YAML": ("pairs: [", ["YAML"]),
    "a date out of range": ("subject: 2024-13-45", ["not YAML", "month"]),
    "model": ("model: gone.xml", ["gone.xml"]),
    "model that is a folder": ("model: .", ["director"]),
    "model that is a manifest": ("model: scene.yaml", ["not XML"]),
}


@pytest.mark.parametrize("case", MANIFESTS)
def test_manifest(case: str, tmp_path: Path) -> None:
    lines, words = MANIFESTS[case]
    head = HEAD
    for key in ("version", "duration"):
        if lines.startswith(key):
            head = "\n".join(line for line in HEAD.splitlines() if not line.startswith(key)) + "\n"
    (tmp_path / "scene.xml").write_text(MODEL)
    (tmp_path / "scene.yaml").write_text(f"{head}{lines}\n")
    with pytest.raises(SceneError) as caught:
        Scene.open(str(tmp_path))
    message = str(caught.value)
    assert str(tmp_path) in message
    assert [word for word in words if word not in message] == []


def test_values_of_a_run_that_cannot_be_computed(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(MODEL)
    (tmp_path / "scene.yaml").write_text(HEAD + initial("{box.z: sqrt(x)}"))
    scene = Scene.open(str(tmp_path))
    with pytest.raises(SceneError, match=r"scene\.yaml: cannot compute 'sqrt\(x\)'"):
        scene.initial_states([scene.resolve({"x": -4.0}, 0, None)])


MODELS: dict[str, tuple[bytes, list[str]]] = {
    "mismatched tag": (b"<mujoco>\n  <worldbody>\n</mujoco>", [":3:3:", "not XML"]),
    "cut off": (b"<mujoco>", [":1:9:", "not XML"]),
    "empty": (b"", [":1:1:", "not XML"]),
    "bytes": (b"<mujoco>\n<!-- \xff --></mujoco>", [":2:", "write the model in UTF-8"]),
    "encoding": ("<mujoco/>".encode("utf-16"), [":1:", "write the model in UTF-8"]),
    "document type": (b'<!DOCTYPE a [<!ENTITY b "c">]>\n<mujoco/>', [":1:", "<!DOCTYPE a>"]),
    "element": (
        b"<mujoco><worldbody><sphere/></worldbody></mujoco>",
        ["does not compile", "sphere"],
    ),
    "attribute": (b"<mujoco><worldbody><geom sise='1'/></worldbody></mujoco>", ["sise"]),
    "attribute of another place": (
        b"<mujoco><default><mesh file='a.stl'/></default></mujoco>",
        ["<mesh> takes 'file' only in <asset>"],
    ),
    "half a range": (
        b"<mujoco><worldbody><body><joint range='1'/><geom size='1'/></body></worldbody></mujoco>",
        ["range of <joint> has too few numbers", "two"],
    ),
    "value": (b"<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>", ["does not compile"]),
    "no mass": (
        b"<mujoco><worldbody><body name='light'><freejoint/></body></worldbody></mujoco>",
        ["does not compile", "mass"],
    ),
    "other XML": (b"<html/>", ["does not compile"]),
}


@pytest.mark.parametrize("case", MODELS)
def test_model(case: str, tmp_path: Path) -> None:
    text, words = MODELS[case]
    (tmp_path / "robot.xml").write_bytes(text)
    with pytest.raises(SceneError) as caught:
        Scene.open("robot.xml", tmp_path)
    message = str(caught.value)
    assert str(tmp_path / "robot.xml") in message
    assert [word for word in words if word not in message] == []


BODY = "<worldbody><body name='b'>{}<geom size='.1'/></body></worldbody>"


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "nactuator"), reason="3 read some")
@pytest.mark.parametrize(
    ("old", "version", "new"),
    [
        ("<option mpr_iterations='9'/>", "3.2.3", "<option ccd_iterations='9'/>"),
        ("<option mpr_tolerance='1e-6'/>", "3.2.3", "<option ccd_tolerance='1e-6'/>"),
        ("<option collision='all'/>", "3.0.0", ""),
        ("<option apirate='9'/>", "3.3.7", ""),
        ("<compiler convexhull='true'/>", "3.2.5", ""),
        (
            "<option><flag passive='disable'/></option>",
            "3.3.6",
            "<option><flag spring='disable' damper='disable'/></option>",
        ),
        (
            BODY.format("<joint actuatorforcerange='-1 1'/>"),
            "3.0.0",
            BODY.format("<joint actuatorfrcrange='-1 1'/>"),
        ),
        (
            BODY.format("<camera orthographic='true'/>"),
            "3.5.0",
            BODY.format("<camera projection='orthographic'/>"),
        ),
        (
            BODY.format("<composite type='cable' count='9 1 1' size='1'/>"),
            "4.0.0",
            BODY.format(
                "<flexcomp name='a' dim='1' type='grid' count='9 1 1' spacing='.1 .1 .1' mass='1'>"
                "<elasticity young='1e6' poisson='0'/></flexcomp>"
            ),
        ),
    ],
)
def test_what_mujoco_removed_has_a_correction_that_compiles(
    old: str, version: str, new: str, tmp_path: Path
) -> None:
    model = tmp_path / "robot.xml"
    model.write_text(f"<mujoco>{old}</mujoco>")
    with pytest.raises(SceneError, match=f"MuJoCo {version} removed") as caught:
        Scene.open("robot.xml", tmp_path)
    written = re.findall(r"\w+", str(caught.value).partition(f"{version} removed")[2])
    assert set(re.findall(r"\w+", new.replace(BODY.format(""), ""))) & {*written} or not new
    mujoco.MjModel.from_xml_string(f"<mujoco>{new}</mujoco>")


def test_a_manifest_that_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_bytes(b"title: \xff\xfe")
    with pytest.raises(SceneError, match=r"scene\.yaml: not YAML"):
        find_scene(str(tmp_path))


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("bal_drop", "did you mean 'ball_drop'"),
        ("./nowhere", "has no scene.yaml"),
        ("nowhere/robot.xml", "no model file"),
        ("robot.urdf", "no model file"),
    ],
)
def test_a_scene_that_is_not_there(reference: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=message):
        Scene.open(reference, tmp_path)


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "nactuator"), reason="they came with MuJoCo 4.0")
@pytest.mark.parametrize(
    ("actuator", "number"),
    [
        ('<pid name="aim" joint="hinge" kp="1" kv="1"/>', 2),
        ('<dcmotor name="aim" joint="hinge" nominal="12 1 100" input="none"/>', 0),
        ('<orientation name="aim" joint="ball" kp="1"/>', 3),
    ],
)
def test_an_actuator_with_other_than_one_control(
    actuator: str, number: int, tmp_path: Path
) -> None:
    bodies = "".join(
        f'<body><joint name="{kind}" type="{kind}"/><geom size=".1"/></body>'
        for kind in ("hinge", "ball")
    )
    text = f"<mujoco><worldbody>{bodies}</worldbody><actuator>{actuator}</actuator></mujoco>"
    (tmp_path / "robot.xml").write_text(text)
    with pytest.raises(SceneError, match=rf"robot\.xml: actuator 'aim' has {number} controls"):
        Scene.open("robot.xml", tmp_path)


def test_a_search_that_the_engine_breaks_off(tmp_path: Path) -> None:
    # Over 64 pairs are searched by a short run, which such a small stack cannot hold.
    balls = "".join(
        f'<body pos="{x * 0.15} 0 .1"><freejoint/><geom size=".1"/></body>' for x in range(14)
    )
    text = f'<mujoco><size memory="30K"/><worldbody>{balls}</worldbody></mujoco>'
    (tmp_path / "robot.xml").write_text(text)
    with pytest.raises(SceneError, match=r"robot\.xml"):
        Scene.open("robot.xml", tmp_path)


@pytest.mark.parametrize("copies", [1, 2])
def test_a_mistake_in_an_included_file_has_its_place_if_one_element_has_it(
    tmp_path: Path, copies: int
) -> None:
    """MuJoCo counts no lines of included files; two equal elements leave the place open."""
    wrong = "<option\n apirate='3'/>\n" * copies
    (tmp_path / "part.xml").write_text(f"<mujoco>\n{wrong}</mujoco>")
    model = tmp_path / "whole.xml"
    model.write_text("<mujoco><include file='part.xml'/></mujoco>")
    place = f"{tmp_path / 'part.xml'}:2" if copies == 1 else str(model)
    with pytest.raises(SceneError) as raised:
        Scene.open(str(model)).base({})
    assert str(raised.value).startswith(f"{place}: does not compile\n")
