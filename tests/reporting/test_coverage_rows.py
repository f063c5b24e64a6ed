"""The use of a model's parts in a run, in words."""

from contactlab.reporting.coverage_rows import coverage_rows
from contactlab.schema.coverage import ActuatorUse, Coverage, PairUse


def test_each_share_is_said_of_what_it_is() -> None:
    coverage = Coverage(
        actuators={
            "lift": ActuatorUse(share=0.5, force=20.0, saturated=0.25),
            "grip": ActuatorUse(),
        },
        pairs={"a-b": PairUse(touched=0.5, stuck=0.25, slid=0.125)},
    )
    assert coverage_rows(coverage, ("a-b", "a-c")) == [
        ("actuators used", "grip", "lift 50 %, force 20, saturated 25 %"),
        ("pairs touched", "a-c", "a-b touched 50 %, stuck 25 %, slid 12 %"),
    ]
