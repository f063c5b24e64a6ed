"""Forces at a distance are found with the shell's size; soft contacts are found as well."""

from collections.abc import Callable, Mapping

import pytest

from contactlab.schema.check_report import CheckResult, Measure

One = Callable[..., CheckResult]
Values = Callable[[CheckResult, str], Mapping[str | None, float | None]]
Missed = Callable[[CheckResult], list[Measure]]

BOX = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1" {floor}/>
  <body pos="0 0 .06"><freejoint/><geom name="box" type="box" size=".05 .05 .05" {box}/></body>
</worldbody>{rest}</mujoco>"""


def box(floor: str = "", box: str = "", rest: str = "") -> str:
    return BOX.format(floor=floor, box=box, rest=rest)


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "size"),
    [
        (box(floor='margin="0.02"'), 0.02),
        (box(floor='margin="0.015"', box='margin="0.005"'), 0.02),
        (box(rest='<contact><pair geom1="floor" geom2="box" margin="0.02"/></contact>'), 0.02),
        (box(box='margin="0.02" gap="0.01"'), 0.02),
    ],
)
def test_a_shell_is_found_with_its_size(
    one: One, values: Values, missed: Missed, model: str, size: float
) -> None:
    found = one(model, "shells")
    assert found.verdict == "warning"
    assert [(each.name, each.value) for each in missed(found)] == [("shell", pytest.approx(size))]
    assert f"contact force start {size * 1e3:.3g} mm before touch" in found.reason
    # At rest it hovers by the shell less the 0.1078 mm that four corners sink by default.
    from_ = values(found, "pushes_from")["floor-box"]
    assert from_ is not None
    assert size - 1.1e-4 <= from_ < size


@pytest.mark.long
@pytest.mark.parametrize(
    "model", [box(), box(box='gap="0.02"'), box(floor='margin="0.0001"'), "gripping_pad"]
)
def test_what_is_no_shell_is_not_found(one: One, model: str) -> None:
    """A gap makes contacts that exert nothing."""
    found = one(model, "shells")
    assert found.verdict == "pass"


def test_a_shell_that_nothing_enters_is_found(one: One, values: Values) -> None:
    far = box(floor='margin="0.02"').replace("0 0 .06", "0 0 100")
    found = one(far, "shells")
    assert found.verdict == "warning"
    assert values(found, "pushes_from")["floor-box"] == 0
    assert not any("pushed" in note for note in found.notes)


@pytest.mark.long
@pytest.mark.parametrize(
    ("solref", "fails"),
    [
        ("0.02 1", False),
        ("0.03 1", True),
        ("0.03 0.5", False),
        ("-2500 -1", False),
        ("-1600 -80", True),
    ],
)
def test_softness_is_time_constant_times_damping_ratio(one: One, solref: str, fails: bool) -> None:
    found = one("gripping_pad", "shells", f"solref={solref}")
    assert (found.verdict == "warning") == fails
