"""Predicates of models that decide where a modification applies."""

import mujoco
import pytest

from contactlab.modifications.model_predicates import may_collide

TWO = """<mujoco><option><flag {flag}/></option><worldbody>
<body><freejoint/><geom name="one" size=".1" {first}/></body>
<body pos="1 0 0"><freejoint/><geom name="two" size=".1" {second}/></body></worldbody>
<contact>{pair}</contact></mujoco>"""
PAIR, NONE = '<pair geom1="one" geom2="two"/>', 'contype="0" conaffinity="0"'


@pytest.mark.parametrize(
    ("first", "second", "pair", "flag", "collides"),
    [
        ("", "", "", "", True),
        (NONE, NONE, "", "", False),
        (NONE, NONE, PAIR, "", True),
        (NONE, NONE, PAIR, 'contact="disable"', False),
        ("", "", PAIR, 'constraint="disable"', False),
        ('contype="1" conaffinity="0"', 'contype="0" conaffinity="2"', "", "", False),
        ('contype="2" conaffinity="0"', 'contype="0" conaffinity="2"', "", "", True),
    ],
)
def test_contacts_arise_by_masks_or_by_pairs(
    first: str, second: str, pair: str, flag: str, *, collides: bool
) -> None:
    """MuJoCo finds a contact of the two, laid over each other, if and only if they may collide."""
    text = TWO.format(first=first, second=second, pair=pair, flag=flag)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[7:10] = data.qpos[:3]
    mujoco.mj_forward(model, data)
    assert may_collide(model) is collides
    assert bool(data.ncon) is collides
