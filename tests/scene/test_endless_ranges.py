"""A range without ends is no limit: the model is read, and its motion is MuJoCo's."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.errors import ModelWarning, SceneError
from contactlab.scene.compile_model import compile_model
from contactlab.scene.scene_source import find_scene

MODEL = """<mujoco><worldbody><body name="arm"><joint name="hip" axis="0 1 0" {joint}/>
<geom size=".1" pos=".3 0 0"/></body></worldbody>
<tendon><fixed name="cord" {tendon}><joint joint="hip" coef="1"/></fixed></tendon>
<actuator><motor name="turn" joint="hip" {actuator}/></actuator></mujoco>"""
ENDLESS = {
    "joint": 'range="-inf inf"',
    "tendon": 'range="-inf inf"',
    "actuator": 'ctrlrange="-inf inf" forcerange="-inf inf"',
}


@pytest.mark.parametrize("part", ENDLESS)
def test_its_motion_is_that_of_mujoco(tmp_path: Path, part: str) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(MODEL.format(**{**dict.fromkeys(ENDLESS, ""), part: ENDLESS[part]}))
    with pytest.warns(ModelWarning, match="-inf inf, so that nothing limits it"):
        model = compile_model(find_scene(str(path)), {}, lambda _: None)
    motions = list[np.ndarray]()
    for one in (model, mujoco.MjModel.from_xml_path(str(path))):
        data = mujoco.MjData(one)
        data.ctrl[0] = 3
        mujoco.mj_step(one, data, 200)
        motions.append(np.concatenate([data.qpos, data.qvel]))
    assert np.array_equal(motions[0], motions[1])
    assert np.isfinite(model.jnt_range).all()
    assert np.isfinite(model.actuator_ctrlrange).all()


def test_a_range_with_one_end_is_refused_with_the_number(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    one_end = {**dict.fromkeys(ENDLESS, ""), "joint": 'range="0 inf"'}
    path.write_text(MODEL.format(**one_end))
    with pytest.raises(SceneError, match="range of jnt 'hip' is 0 inf"):
        compile_model(find_scene(str(path)), {}, lambda _: None)
