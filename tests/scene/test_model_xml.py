"""Two parsers, one reading: what the guards see of a model is what MuJoCo opens."""

import os
import random
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import pytest

from contactlab.errors import SceneError
from contactlab.scene.model_files import ASSET_FOLDERS, FileSearch, collect_files
from contactlab.scene.model_guards import ALLOWED
from contactlab.scene.model_xml import FILE_KEYS, FOLDER_KEYS, parse_model

MODEL = '<mujoco{}><asset><mesh name="m" file="{}"/></asset><worldbody/></mujoco>'
Reading = tuple[str, Sequence[str], Sequence[str]]  # name of the model, files, names of bodies


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A project, whose models may name nothing outside of it; next to it lies a mesh."""
    monkeypatch.setenv(ALLOWED, "")
    (tmp_path / "other.obj").write_text("v 0 0 0")
    inner = tmp_path / "project"
    inner.mkdir()
    (inner / "pyproject.toml").touch()
    return inner


def write(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def guarded(path: Path) -> Reading:
    """Return what the guards see of a model; a SceneError if they refuse to read it."""
    root = parse_model(path)
    named = [each.path for each in FileSearch().iterate_references(path)]
    beside = path.parent
    found = [str(one.relative_to(beside) if one.is_relative_to(beside) else one) for one in named]
    bodies = [body.get("name", "") for body in root.iter("body")]
    return root.get("model", "MuJoCo Model"), sorted(found), sorted(bodies)


def read(path: Path) -> Reading:
    """Return what MuJoCo sees of a model; a ValueError if it refuses to read it."""
    spec = mujoco.MjSpec.from_file(str(path))
    parts = (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures)
    # Line breaks in names, which lead to no file, are spaces in XML.
    plain = re.compile(r"\s")
    bodies = sorted(plain.sub(" ", body.name) for body in spec.bodies if body.name != "world")
    files = sorted({str(Path(part.file)) for part in parts if part.file})
    return plain.sub(" ", spec.modelname), files, bodies


NAMESPACE = ' xmlns="urn:x"'


@pytest.mark.parametrize("attributes", ["", NAMESPACE, ' xmlns:a="urn:x"'])
def test_a_namespace_hides_no_file(folder: Path, attributes: str) -> None:
    model = write(folder, "robot.xml", MODEL.format(attributes, "../other.obj"))
    with pytest.raises(SceneError, match="lies outside of"):
        collect_files(model)


def test_a_namespace_hides_no_file_of_an_included_model(folder: Path) -> None:
    asset = '<asset><mesh file="../other.obj"/></asset>'
    write(folder, "part.xml", f"<mujocoinclude{NAMESPACE}>{asset}</mujocoinclude>")
    model = write(folder, "robot.xml", '<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(SceneError, match="lies outside of"):
        collect_files(model)


def test_a_namespace_hides_no_file_of_a_urdf(folder: Path) -> None:
    geometry = '<geometry><mesh filename="../other.obj"/></geometry>'
    link = f'<link name="a"><collision>{geometry}</collision></link>'
    model = write(folder, "robot.urdf", f'<robot name="r"{NAMESPACE}>{link}</robot>')
    with pytest.raises(SceneError, match="lies outside of"):
        collect_files(model)


def test_a_document_type_hides_no_model(folder: Path) -> None:
    """As it was found: MuJoCo compiles what expat takes for the text of an entity."""
    hidden = MODEL.format(' model="real"', "../other.obj").replace('"', "'")
    text = f'<!DOCTYPE m [<!ENTITY a ">{hidden}"> ]><mujoco model="harmless"/>'
    model = write(folder, "robot.xml", text)
    assert read(model)[0] == "real"
    with pytest.raises(SceneError, match="its document type defines something"):
        collect_files(model)


@pytest.mark.parametrize("break_", ["\n", "\t", "\r\n"])
@pytest.mark.parametrize("key", ["file", "meshdir"])
def test_a_line_break_hides_no_file(folder: Path, break_: str, key: str) -> None:
    """In XML it is a space, so that another file would be checked than is opened."""
    name = f"a{break_}b"
    directory = f'<compiler meshdir="{name}"/>' if key == "meshdir" else ""
    mesh = f'<asset><mesh name=">" content_type=\'"\' file="{name}"/></asset>'
    model = write(folder, "robot.xml", f"<mujoco>{directory}{mesh}</mujoco>")
    with pytest.raises(SceneError, match=f"{key} has a line break or a tab"):
        collect_files(model)


@pytest.mark.parametrize("attributes", ["", NAMESPACE])
def test_a_pipe_is_not_waited_for(folder: Path, attributes: str) -> None:
    """As `verify --simulate` of a stranger's store did, which a namespace led to one."""
    os.mkfifo(folder / "pipe.obj")
    model = write(folder, "robot.xml", MODEL.format(attributes, "pipe.obj"))
    with pytest.raises(SceneError, match="is no regular file"):
        collect_files(model, copy=folder)


@pytest.mark.parametrize("element", ["include", "model"])
def test_a_pipe_in_place_of_a_model_is_not_waited_for(folder: Path, element: str) -> None:
    os.mkfifo(folder / "pipe.xml")
    inner = f'<{element} file="pipe.xml"/>'
    inner = inner if element == "include" else f"<asset>{inner}</asset>"
    model = write(folder, "robot.xml", f"<mujoco>{inner}</mujoco>")
    with pytest.raises(SceneError, match="is no regular file"):
        collect_files(model)


def test_prefixes_that_mean_nothing_are_read_as_mujoco_reads_them(folder: Path) -> None:
    """It ignores such elements of a URDF, whether or not their prefix is bound."""
    link = '<link name="a"></link>'
    text = f'<robot name="r">{link}<drake:joint><mesh filename="x"/></drake:joint></robot>'
    model = write(folder, "robot.urdf", text)
    assert [each.tag for each in parse_model(model).iter()][-2:] == ["drake:joint", "mesh"]
    assert read(model)[0] == "r"


@pytest.mark.parametrize(
    "text",
    [
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:a/></robot>',
        '<robot xmlns:x="http://ros.org/wiki/xacro"><x:include filename="a"/></robot>',
        "<robot><xacro:a/></robot>",
    ],
)
def test_macros_are_found_by_any_prefix(folder: Path, text: str) -> None:
    with pytest.raises(SceneError, match="has macros; expand it first"):
        parse_model(write(folder, "robot.urdf", text))


PIECES = r"""
<?xml version="1.0"?>
<?xml version="1.0" encoding="utf-16"?>
<?pi <mesh file='p'/> ?>
<!-- c -->
<!-- <mesh file='c'/> -->
<!-->
--->
<![CDATA[ <mesh file='d'/> ]]>
<!DOCTYPE mujoco>
<!DOCTYPE m SYSTEM 'a>b'>
<!DOCTYPE m [<!ENTITY e "><mesh file='e'/>">]>
<mujoco model="a">
<mujoco model="b" xmlns="urn:x">
<mujoco model="&e;" xmlns:x="urn:y">
</mujoco>
<asset>
<asset >
</asset>
</asset >
<x:asset>
</x:asset>
<worldbody>
</worldbody>
<worldbody/>
<body name="b1"/>
<body name='b&#50;'></body>
<mesh file="m1"/>
<mesh file='m&amp;2'/>
<mesh file="m&#x33;"/>
<mesh\nfile = "m4"\t/>
<mesh name=">" file="m5"/>
<mesh file="m\n6"/>
<mesh file="m&#10;7"/>
<mesh file="m<8"/>
<x:mesh file="m9"/>
<mesh x:file="m10" file="m11"/>
<mesh file="é"/>
<mesh file="&e;"/>
<mesh file="m12" file="m13"/>
<texture name="t" type="2d" file="t1"/>
<Mesh file="m14"/>
<mesh name="file='m15'" file="m16"/>
\n
text
&lt;
]]>
\ufeff
\0
\x0b
"""
ESCAPES = {r"\n": "\n", r"\t": "\t", r"\ufeff": "\ufeff", r"\0": "\0", r"\x0b": "\x0b"}
WHOLE = [
    '<mujoco model="a">', "<asset>", '<mesh file="m1"/>', '<mesh file="m2"/>', "</asset>",
    "<worldbody>", '<body name="b1"/>', "</worldbody>", "</mujoco>",
]  # fmt: skip
ESCAPE = re.compile("|".join(map(re.escape, ESCAPES)))
INSERTED = [ESCAPE.sub(lambda found: ESCAPES[found[0]], line) for line in PIECES.split("\n")[1:-1]]
BYTES = b"<>/='\"&;!?-[]: \n\tax\xff\x00"


def documents(count: int, seed: int) -> Iterator[bytes]:
    """Yield a model with other pieces among its own, and some bytes of it changed."""
    draw = random.Random(seed)  # noqa: S311 - repeatable
    for _ in range(count):
        pieces = [*WHOLE]
        for _ in range(draw.randrange(4)):
            place = draw.randrange(len(pieces) + 1)
            pieces[place : place + draw.randrange(2)] = [draw.choice(INSERTED)]
        data = bytearray("".join(pieces).encode())
        for _ in range(draw.choice((0, 0, 1, 2))):
            place = draw.randrange(len(data) + 1)
            data[place : place + draw.randrange(2)] = [draw.choice(BYTES)]
        yield bytes(data)


def _agree(path: Path) -> bool | None:
    """Check that two readings are one; return whether it was read here, None if not by MuJoCo."""
    try:
        theirs = read(path)
    except (ValueError, mujoco.FatalError):
        return None
    try:
        ours = guarded(path)
    except SceneError:
        return False
    assert ours[0] == theirs[0], path.read_bytes()
    # MuJoCo ignores parts in places that it does not know.
    for seen, opened in zip(ours[1:], theirs[1:], strict=True):
        assert set(opened) <= set(seen), path.read_bytes()
    return True


def _fuzz(folder: Path, count: int, seed: int) -> None:
    read_by_both = refused = 0
    for data in documents(count, seed):
        agreed = _agree(write(folder, "robot.xml", data))
        read_by_both += agreed is True
        refused += agreed is False
    # Enough of each, or else it tries nothing.
    assert read_by_both > count / 10
    assert refused > count / 100


def test_both_parsers_read_the_same_of_whatever_both_read(folder: Path) -> None:
    _fuzz(folder, 400, 1)


@pytest.mark.long
def test_both_parsers_read_the_same_of_much_more(folder: Path) -> None:
    _fuzz(folder, 20_000, 2)


def test_every_attribute_that_names_a_file_is_known() -> None:
    """Those of MuJoCo's own schema; one that is new would not be checked."""
    elements = dict[str, set[str]]()
    element = ""
    for line in mujoco.mj_printSchema(False, False).splitlines():
        found = re.match(r" *(\w+) \(.\) *(.*)", line)
        element = found[1] if found else element
        elements.setdefault(element, set()).update((found[2] if found else line).split())
    own = {"texture": {"dir"}, "light": {"dir"}}  # directions of a light, and of a builtin
    unknown = {
        (element, name)
        for element, keys in elements.items()
        for name in keys - {*FILE_KEYS, *FOLDER_KEYS} - own.get(element, set())
        if re.search("file|dir$", name)
    }
    assert len(elements) > 50
    assert (
        {"mesh", "texture", "hfield", "skin", "flexcomp", "model"}
        <= {element for element, keys in elements.items() if "file" in keys}
        <= {*ASSET_FOLDERS, "model"}
    )
    assert unknown == set()
