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
    ],
)
def test_what_no_memory_holds_is_refused(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco.MjSpec, "from_file", None)
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(SceneError, match=r"is more than [\d,]+; make it smaller"):
        Scene.open(str(path))


def test_a_picture_may_be_small_and_hold_much(tmp_path: Path) -> None:
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 60_000, 60_000)
    (tmp_path / "h.png").write_bytes(head)
    path = tmp_path / "model.xml"
    path.write_text(ASSET.format('<hfield name="h" file="h.png" size="1 1 1 1"/>'))
    with pytest.raises(SceneError, match="60000 x 60000 pixels"):
        find_scene(str(path))


def test_nonsense_is_left_to_the_compiler(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(ASSET.format('<hfield name="h" nrow="many" ncol="2" size="1 1 1 1"/>'))
    with pytest.raises(SceneError, match="does not compile"):
        Scene.open(str(path))
