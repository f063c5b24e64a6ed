"""A model whose elements refer to missing parts is refused, as MuJoCo refuses it."""

from pathlib import Path

import mujoco
import pytest

from contactlab.errors import SceneError
from contactlab.scene.compile_model import compile_model
from contactlab.scene.scene_source import find_scene

MODEL = """<mujoco><worldbody><body name="arm"><joint name="hip"/><geom name="arm" size=".1"/>
  <site name="tip"/></body></worldbody>{}</mujoco>"""


@pytest.mark.parametrize(
    "part",
    [
        '<actuator><motor joint="none"/></actuator>',
        '<sensor><jointpos joint="none"/></sensor>',
        '<equality><weld body1="arm" body2="none"/></equality>',
        '<contact><exclude body1="arm" body2="none"/></contact>',
        '<contact><pair geom1="arm" geom2="none"/></contact>',
        '<tendon><fixed><joint joint="none" coef="1"/></fixed></tendon>',
        '<custom><tuple name="t"><element objtype="body" objname="none"/></tuple></custom>',
    ],
)
def test_an_element_that_refers_to_nothing_is_refused(tmp_path: Path, part: str) -> None:
    """MuJoCo's copy of a specification lacks the element, so that the copy would compile."""
    path = tmp_path / "model.xml"
    path.write_text(MODEL.format(part))
    with pytest.raises(ValueError, match="none"):
        mujoco.MjModel.from_xml_path(str(path))
    for _ in range(2):
        with pytest.raises(SceneError):
            compile_model(find_scene(str(path)), {}, lambda _: None)
