"""A model without its pictures moves bit for bit as with them."""

import mujoco
import numpy as np

from contactlab.scene.model_draft import drop_textures

SCENE = """<mujoco><asset>
<texture type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0 0 0" width="64" height="64"/>
<texture name="checked" type="2d" builtin="checker" width="64" height="64"/>
<material name="floor" texture="checked" texrepeat="5 5"/></asset>
<default><default class="dark"><geom material="floor"/></default></default>
<worldbody><geom type="plane" size="1 1 .1" material="floor"/>
<body pos="0 0 .2"><freejoint/><geom class="dark" type="box" size=".1 .05 .04" euler="20 30 0"/>
</body></worldbody></mujoco>"""


def test_pictures_are_left_out_and_nothing_else() -> None:
    spec = mujoco.MjSpec.from_string(SCENE)
    own = spec.compile()
    drop_textures(spec)
    plain = spec.compile()
    assert (own.ntex, plain.ntex, plain.nmat) == (2, 0, own.nmat)
    assert plain.nbuffer < own.nbuffer - own.ntexdata / 2
    ends = list[np.ndarray]()
    for model in (own, plain):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    assert ends[0].tobytes() == ends[1].tobytes()
