"""Bodies that fall out of the world, since contacts that would hold them are switched off."""

import pytest
from tests.budget_motions import motion_of

from contactlab.studies.examine.masked_passages import find_masked_fall

SCENE = """<mujoco><option timestep=".004">{flag}</option><worldbody>
  <geom name="floor" type="plane" size="1 1 .1" {floor}/>
  <body name="box" pos="0 0 .3"><freejoint/><geom name="box" size=".1" {box}/></body>
  </worldbody></mujoco>"""
NO_CONTACT = '<flag contact="disable"/>'


@pytest.mark.parametrize(
    ("flag", "floor", "box", "opened"),
    [
        ("", "", "", None),
        (NO_CONTACT, "", "", ()),
        ("", 'conaffinity="0"', 'contype="2" conaffinity="2"', (("floor", "conaffinity", 2),)),
        ("", 'contype="4"', 'contype="0" conaffinity="2"', (("floor", "contype", 6),)),
        # A geom without any mask is drawn only.
        ("", 'contype="0" conaffinity="0"', "", None),
    ],
)
def test_a_body_falls_through_a_floor_that_masks_open(
    flag: str, floor: str, box: str, opened: tuple[tuple[str, str, int], ...] | None
) -> None:
    fall = find_masked_fall(motion_of(SCENE.format(flag=flag, floor=floor, box=box), 1.0))
    assert (None if fall is None else fall.widened_masks) == opened
    assert fall is None or fall.sentence.startswith("box falls through floor: ")


def test_a_body_that_something_else_holds_does_not_fall() -> None:
    """It goes through the shelf, which masks open, and stands on the floor."""
    shelf = '<geom type="box" size=".5 .5 .01" pos="0 0 .15" contype="2" conaffinity="4"/>'
    scene = SCENE.format(flag="", floor="", box="").replace("<body", f"{shelf}<body")
    assert find_masked_fall(motion_of(scene, 1.0)) is None


def test_a_body_over_nothing_falls_as_it_was_written() -> None:
    scene = SCENE.format(flag="", floor='pos="5 0 0" euler="0 90 0"', box="")
    assert find_masked_fall(motion_of(scene, 1.0)) is None
