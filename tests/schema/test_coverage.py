"""What no run did, in words: the union over runs, and the drive that would do it."""

from typing import Any

import pytest

from contactlab.schema.coverage import (
    ActuatorUse,
    Coverage,
    ExercisedFeatures,
    PairUse,
    Travel,
    feature_of,
)

STILL = Coverage(joints={"j": Travel(moved=0.001, share=0.001)}, actuators={"a": ActuatorUse()})
MOVED = Coverage(joints={"j": Travel(moved=0.5, share=0.5)}, actuators={"a": ActuatorUse(force=1)})
STUCK = Coverage(pairs={"a-b": PairUse(touched=1, stuck=1, friction=1e-4)}, touched=1)
SLID = Coverage(pairs={"a-b": PairUse(touched=1, slid=0.1, friction=0.5)}, touched=1)


def exercised(*coverages: Coverage | None, drive: str = '"hold"') -> ExercisedFeatures:
    texts = [each and each.model_dump_json(exclude_defaults=True) for each in coverages]
    return ExercisedFeatures.of_rows({"coverage": text, "drive": drive} for text in texts)


def test_one_run_that_does_it_is_enough() -> None:
    assert exercised(STILL, MOVED).describe_lacking(["motion", "actuation"]) is None
    assert exercised(STILL).describe_lacking(["motion"]) == "no joint moved"
    assert exercised(STUCK).describe_lacking(["contact"]) is None
    assert exercised(STUCK, SLID).describe_lacking(["friction"]) is None


def test_what_all_runs_left_alone_is_named_by_kind() -> None:
    pairs = {"a-b": {}, "a-c": {}}

    def idle(*coverages: Coverage | None) -> tuple[str, ...]:
        texts = (each and each.model_dump_json(exclude_defaults=True) for each in coverages)
        return ExercisedFeatures.of_rows(
            {"coverage": each, "pairs": pairs} for each in texts
        ).idle_parts()

    still = "joints never moved: j", "limits never reached: j", "actuators never moved: a"
    assert idle(STILL) == (*still, "pairs never touched: a-b, a-c")
    assert idle(STILL, STUCK) == (*still, "pairs never touched: a-c", "friction never loaded: a-b")
    assert idle(STUCK, SLID) == ("pairs never touched: a-c",)
    reached = Coverage(joints={"j": Travel(moved=1, share=1, ends=("lower",))})
    assert idle(MOVED, reached) == (still[2], "pairs never touched: a-b, a-c")
    assert idle(STILL, None) == (), "of one nothing is known"


def test_no_row_is_read_once_one_did_what_is_asked_about() -> None:
    texts = (each.model_dump_json(exclude_defaults=True) for each in (STILL, MOVED, STUCK))
    rows = ({"coverage": text, "drive": None} for text in texts)
    assert (
        ExercisedFeatures.of_rows(rows, enough=["actuation"]).describe_lacking(["actuation"])
        is None
    )
    assert len([*rows]) <= 1, "the first did not, the second did"


def test_of_runs_without_coverage_nothing_is_said() -> None:
    assert exercised(STILL, None).describe_lacking(["motion", "limit", "friction"]) is None
    assert ExercisedFeatures.of_rows([{"run_id": "old"}]).describe_lacking(["motion"]) is None


def test_only_parts_that_the_model_has_are_asked_about() -> None:
    assert exercised(STILL).present == {"motion", "limit", "actuation"}
    assert exercised(STUCK).present == set()


def test_a_joint_that_only_starts_at_its_limit_does_not_exercise_it() -> None:
    start = Travel(moved=1e-4, share=1e-3, ends=("upper",))
    assert exercised(Coverage(joints={"j": start})).describe_lacking(["limit"]) is not None
    reached = Travel(moved=0.1, share=0.1, ends=("upper",))
    assert exercised(Coverage(joints={"j": reached})).describe_lacking(["limit"]) is None


def test_one_part_that_is_left_out_is_enough_to_say_so() -> None:
    """An effect turns the limits of all joints off, or none."""
    reached, away = Travel(moved=0.1, share=0.1, ends=("upper",)), Travel(moved=0.1, share=0.1)
    assert (
        exercised(Coverage(joints={"j": reached, "k": away})).describe_lacking(["limit"])
        is not None
    )
    some = Coverage(equalities={"tie": 2.0, "idle": 0.0})
    assert exercised(some).describe_lacking(["equality"]) is not None


@pytest.mark.parametrize(
    ("setting", "feature"),
    [
        ("friction", "friction"),
        ("friction.slide", "friction"),
        ("friction.roll", "rolling"),
        ("solref.timeconst", "contact"),
        ("timestep", None),
    ],
)
def test_settings_concern_a_feature_or_everything(setting: str, feature: Any) -> None:
    assert feature_of(setting) == feature


def test_runs_share_the_parts_of_a_feature() -> None:
    """One run moves a joint into its limit, another the other joint: together they did it."""
    reached, away = Travel(moved=0.1, share=0.1, ends=("upper",)), Travel(moved=0.1, share=0.1)
    first, second = (
        Coverage(joints=dict(zip("jk", pair, strict=True)))
        for pair in ((reached, away), (away, reached))
    )
    assert exercised(first, first).describe_lacking(["limit"]) is not None
    assert exercised(first, second).describe_lacking(["limit"]) is None
    tied, loose = ({"tie": 2.0, "weld": 0.0}, {"tie": 0.0, "weld": 1.0})
    assert (
        exercised(Coverage(equalities=tied), Coverage(equalities=loose)).describe_lacking(
            ["equality"]
        )
        is None
    )
