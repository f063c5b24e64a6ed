"""Shapes that have a collision function of their own do not ask for the general one."""

from itertools import combinations_with_replacement

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.scene.effects.proofs import _SPECIAL_PAIRS  # pyright: ignore[reportPrivateUsage]

_SHAPES = {
    "plane": ('type="plane" size="1 1 .1"', mujoco.mjtGeom.mjGEOM_PLANE),
    "sphere": ('size=".1"', mujoco.mjtGeom.mjGEOM_SPHERE),
    "capsule": ('type="capsule" size=".08 .1"', mujoco.mjtGeom.mjGEOM_CAPSULE),
    "cylinder": ('type="cylinder" size=".1 .1"', mujoco.mjtGeom.mjGEOM_CYLINDER),
    "box": ('type="box" size=".1 .12 .09"', mujoco.mjtGeom.mjGEOM_BOX),
    "ellipsoid": ('type="ellipsoid" size=".1 .12 .09"', mujoco.mjtGeom.mjGEOM_ELLIPSOID),
}
_PAIRS = [
    pair
    for pair in combinations_with_replacement(_SHAPES, 2)
    if tuple(sorted(int(_SHAPES[name][1]) for name in pair)) in _SPECIAL_PAIRS
]
_OFF = int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
_MULTI = getattr(mujoco.mjtDisableBit, "mjDSBL_MULTICCD", None)


def contacts(first: str, second: str, pose: tuple[float, ...], flags: int) -> np.ndarray:
    """Return the contacts of two shapes, the second in a pose relative to the first."""
    # The parser knows no denormal numbers.
    place, turn = (" ".join(f"{each:.9f}" for each in part) for part in (pose[:3], pose[3:]))
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><geom {_SHAPES[first][0]}/><body pos='{place}' quat='{turn}'>"
        f"<freejoint/><geom {_SHAPES[second][0]}/></body></worldbody></mujoco>"
    )
    model.opt.disableflags |= flags
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return np.array([[each.dist, *each.pos, *each.frame] for each in data.contact])


@pytest.mark.long
@pytest.mark.parametrize(("first", "second"), _PAIRS)
@given(
    pose=st.tuples(
        *[st.floats(-0.15, 0.15)] * 3, st.floats(0.1, 1), *[st.sampled_from([0.0, 0.3, 1.0])] * 3
    )
)
def test_their_contacts_do_not_depend_on_it(
    first: str, second: str, pose: tuple[float, ...]
) -> None:
    flags = _OFF | (int(_MULTI) if _MULTI is not None else 0)
    assert np.array_equal(contacts(first, second, pose, 0), contacts(first, second, pose, flags))


@pytest.mark.skipif(_MULTI is None, reason="this engine has multiccd as another switch")
def test_those_of_two_cylinders_do() -> None:
    """Lying face on face, they touch in several points or in one."""
    assert _MULTI is not None
    standing = (0.0, 0.0, 0.199, 1.0, 0.0, 0.0, 0.0)
    several = contacts("cylinder", "cylinder", standing, 0)
    assert len(several) > len(contacts("cylinder", "cylinder", standing, int(_MULTI)))
