"""Models that no memory holds are refused before they are compiled."""

import resource
import struct
from pathlib import Path

import mujoco
import pytest

from contactlab.errors import SceneError
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import find_scene

ASSET = "<mujoco><asset>{}</asset><worldbody/></mujoco>"
USER_SENSOR = '<sensor><user name="n" dim="2000000000" datatype="real"/></sensor>'
BODY = '<mujoco><worldbody><body name="b">{}</body></worldbody></mujoco>'


@pytest.mark.parametrize(
    "text",
    [
        ASSET.format('<hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/>'),
        ASSET.format('<texture name="t" type="2d" builtin="flat" width="99999" height="99999"/>'),
        BODY.format('<flexcomp name="f" type="grid" count="2000 2000 2000" dim="3"/>'),
        BODY.format('<replicate count="999999999"><geom size="1"/></replicate>'),
        BODY.format('<replicate count="1000"><replicate count="1000"/></replicate>'),
        ASSET.format('<texture name="t" builtin="flat" width="9999" height="9"/>'),
        ASSET.format('<texture builtin="flat" type="2d" width="8192" height="8192"/>' * 3),
        '<mujoco><size nkey="2000000000"/><worldbody/></mujoco>',
        BODY.format('<flexcomp name="f" type="grid" count="3 3 3" cellcount="900 900 900"/>'),
        ASSET.format('<mesh name="m" builtin="cone" params="90000000 1"/>'),
        ASSET.format('<mesh name="m" builtin="supersphere" params="30000 1 1"/>'),
        '<mujoco><size nuser_geom="2000000000"/><worldbody/></mujoco>',
    ],
)
def test_what_no_memory_holds_is_refused(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco.MjSpec, "from_file", None)
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(
        SceneError, match=r"more than [\d,]+( heights and pixels| elements)?; make it smaller"
    ):
        Scene.open(str(path))


def test_models_that_attach_each_other_are_counted(tmp_path: Path) -> None:
    for number in range(8):
        rest = "".join(f"<attach model='m' prefix='a{number}-{k}'/>" for k in range(10))
        (tmp_path / f"{number}.xml").write_text(
            f"<mujoco><asset><model name='m' file='{number + 1}.xml'/></asset>"
            f"<worldbody>{rest}</worldbody></mujoco>"
        )
    (tmp_path / "8.xml").write_text(BODY.format(""))
    with pytest.raises(SceneError, match=r"all that it attaches makes more than 262,144 elements"):
        find_scene(str(tmp_path / "0.xml"))
    assert find_scene(str(tmp_path / "4.xml")).name == "4"


def test_included_elements_are_copied_with_what_includes_them(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>{'<geom/>' * 600}</mujocoinclude>")
    copied = '<replicate count="{}"><include file="part.xml"/></replicate>'
    path = tmp_path / "model.xml"
    path.write_text(BODY.format(copied.format(400)))
    assert find_scene(str(path)).name == "model"
    path.write_text(BODY.format(copied.format(500)))
    with pytest.raises(SceneError, match="geom makes more than 262,144 elements"):
        find_scene(str(path))


@pytest.mark.parametrize("names", [["1.xml"], ["1.xml", "2.xml"]])
def test_elements_are_nested_as_deeply_as_mujoco_reads_them(
    tmp_path: Path, names: list[str]
) -> None:
    """Over all files that include each other."""
    depth = 600 // len(names)
    for name, inner in zip(["0.xml", *names], [*names, None], strict=True):
        part = f'<include file="{inner}"/>' if inner else ""
        text = "<body>" * depth + part + "</body>" * depth
        (tmp_path / name).write_text(
            f"<mujocoinclude>{text if name != '0.xml' else part}</mujocoinclude>"
        )
    with pytest.raises(SceneError, match="nested deeper than 500; nest them less"):
        find_scene(str(tmp_path / "0.xml"))


@pytest.mark.parametrize(
    "text",
    ['<size memory="900G"/>', '<size nuserdata="2000000000"/>', USER_SENSOR],
    ids=["memory", "user's data", "user's sensor"],
)
def test_compilation_does_not_take_all_memory(text: str, tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_AS)
    path = tmp_path / "model.xml"
    path.write_text(BODY.format("").replace("<worldbody>", f"{text}<worldbody>"))
    with pytest.raises(SceneError, match="more memory than there is; make its <size>"):
        Scene.open(str(path))
    assert resource.getrlimit(resource.RLIMIT_AS) == before


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('solref="nan nan"', "solref of geom 'ball' is nan nan"),
        ('size="1e300"', "of body 'b' is inf"),
        ('friction="1e200 0 0"', "friction of geom 'ball' is 1e"),
    ],
)
def test_numbers_of_a_model_are_finite(text: str, said: str, tmp_path: Path) -> None:
    size = "" if "size" in text else 'size="1"'
    geom = f'<freejoint/><geom name="ball" mass="1" {text} {size}/>'
    (tmp_path / "m.xml").write_text(BODY.format(geom))
    with pytest.raises(SceneError, match=said):
        Scene.open(str(tmp_path / "m.xml"))


def test_a_picture_may_be_small_and_hold_much(tmp_path: Path) -> None:
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 60_000, 60_000)
    (tmp_path / "h.png").write_bytes(head)
    path = tmp_path / "model.xml"
    path.write_text(ASSET.format('<hfield name="h" file="h.png" size="1 1 1 1"/>'))
    with pytest.raises(SceneError, match="60000 x 60000 makes more than"):
        find_scene(str(path))


def test_nonsense_is_left_to_the_compiler(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(ASSET.format('<hfield name="h" nrow="many" ncol="2" size="1 1 1 1"/>'))
    with pytest.raises(SceneError, match="does not compile"):
        Scene.open(str(path))
