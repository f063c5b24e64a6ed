"""Rest on flat ground, against the closed form, and what is recommended against it."""

from collections.abc import Callable, Mapping

import pytest

from contactlab.schema.check_report import CheckResult, Measure

One = Callable[..., CheckResult]
Values = Callable[[CheckResult, str], Mapping[str | None, float | None]]
Missed = Callable[[CheckResult], list[Measure]]

DEPTH = 1e-4
TWO = """<mujoco>
  <option cone="elliptic"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body pos="0 1 99"><freejoint/><geom name="falling" size=".1" solref=".05 1"/></body>
    <body pos="0 0 .1"><freejoint/><geom name="soft" size=".1" priority="1"/></body>
    <body pos="1 0 .1"><freejoint/><geom name="hard" size=".1" priority="1"
      solref=".005 1" friction=".5"/></body>
  </worldbody>
</mujoco>"""


def depths(values: Values, found: CheckResult, name: str) -> list[float]:
    return [each or 0.0 for each in values(found, name).values()]


@pytest.mark.long
def test_the_default_rests_too_deep(one: One, values: Values, missed: Missed) -> None:
    found = one("gripping_pad", "flat_contact")
    (depth,), (expected,) = (
        depths(values, found, name) for name in ("penetration_steady", "penetration_expected")
    )
    assert expected == pytest.approx(1.078e-4, rel=5e-4)
    # The deepest corner of a box that lies flat to rounding, in a mean over a fifth of the run.
    assert depth == pytest.approx(expected, rel=1e-6)
    assert [each.name for each in missed(found)] == ["penetration_steady"]
    assert one("gripping_pad", "flat_contact", "solref=0.005 1").verdict == "pass"


@pytest.mark.long
def test_each_set_of_parameters_is_tried(one: One, values: Values, missed: Missed) -> None:
    found = one(TWO, "flat_contact")
    measured, expected = (
        depths(values, found, name) for name in ("penetration_steady", "penetration_expected")
    )
    # Those of the two that stand, not of the one that falls for longer than the run takes.
    assert len(measured) == 2
    assert measured == pytest.approx(expected, rel=1e-6)
    (soft,) = [each.of for each in missed(found)]
    assert soft is not None
    assert soft.startswith("solref 0.02 1,")


@pytest.mark.long
def test_a_model_without_pairs_has_nothing_to_rest(one: One) -> None:
    assert one("free_arm", "flat_contact").verdict == "not applicable"
