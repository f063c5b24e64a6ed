"""Models that no memory holds are refused before they are compiled."""

import struct
from pathlib import Path

import mujoco
import pytest

from contactlab.errors import SceneError
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import find_scene

ASSET = "<mujoco><asset>{}</asset><worldbody/></mujoco>"
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
