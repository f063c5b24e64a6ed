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
    <body pos="0 0 .1"><freejoint/><geom name="soft" size=".1" priority="1"/></body>
    <body pos="1 0 .1"><freejoint/><geom name="hard" size=".1" priority="1"
      solref=".005 1" friction=".5"/></body>
  </worldbody>
</mujoco>"""


def depths(values: Values, found: CheckResult, name: str) -> list[float]:
    return [each or 0.0 for each in values(found, name).values()]


def test_the_default_rests_too_deep(one: One, values: Values, missed: Missed) -> None:
    found = one("gripping_pad", "flat_contact")
    (depth,), (expected,) = (
        depths(values, found, name) for name in ("penetration_steady", "penetration_expected")
    )
    assert expected == pytest.approx(1.078e-4, rel=5e-4)
    # The deepest corner of a box that lies flat to rounding, in a mean over a fifth of the run.
    assert depth == pytest.approx(expected, rel=1e-6)
    assert [each.name for each in missed(found)] == ["penetration_steady"]
    (change,) = found.changes
    assert change.cures
    assert change.settings == {"solref": "0.005 1"}
    assert change.lines == ("<default>", '  <geom solref="0.005 1"/>', "</default>")
    assert one("gripping_pad", "flat_contact", "solref=0.005 1").verdict == "pass"


@pytest.mark.parametrize(
    "assign",
    [
        ["timestep=0.01"],
        ["cone=pyramidal", "friction.slide=3"],
        ["solimp=0.3 0.3 0.001", "cone=elliptic"],
        ["solref=-500 -40", "mass=30"],
        ["solref=0.1 1", "condim=1"],
    ],
)
def test_what_is_recommended_is_shown_to_cure(one: One, values: Values, assign: list[str]) -> None:
    found = one("gripping_pad", "flat_contact", *assign)
    (before,) = depths(values, found, "penetration_steady")
    assert before > DEPTH
    (change,) = found.changes
    assert change.cures, change.shown
    kept = [each for each in assign if each.partition("=")[0] not in change.settings]
    again = [f"{name}={value}" for name, value in change.settings.items()]
    cured = one("gripping_pad", "flat_contact", *kept, *again)
    assert cured.verdict == "pass"
    assert f"rests {depths(values, cured, 'penetration_steady')[0] * 1e3:.2g} mm" in change.shown


def test_each_set_of_parameters_is_tried(one: One, values: Values, missed: Missed) -> None:
    found = one(TWO, "flat_contact")
    measured, expected = (
        depths(values, found, name) for name in ("penetration_steady", "penetration_expected")
    )
    # Of the pair of spheres too: default and hard are mixed by equal priority.
    assert len(measured) == 3
    assert measured == pytest.approx(expected, rel=1e-6)
    (soft,) = [each.of for each in missed(found)]
    assert soft is not None
    assert soft.startswith("solref 0.02 1,")


def test_a_model_without_pairs_has_nothing_to_rest(one: One) -> None:
    assert one("free_arm", "flat_contact").verdict == "not applicable"
