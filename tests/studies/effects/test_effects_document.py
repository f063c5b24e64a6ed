"""The table of effects, and the verdicts that it prints."""

from collections.abc import Sequence
from typing import Any

import pytest
from tests.rendering.sample_reports import effects

from contactlab.rendering.text import render_text
from contactlab.scene.model_draft import ModelEdits
from contactlab.schema.effects_report import PartEffect
from contactlab.schema.time_ratio import TimeRatio
from contactlab.studies.effects.effects_document import describe_effects
from contactlab.studies.effects.model_parts import ModelPart, find_used_parts
from contactlab.studies.effects.part_errors import LOAD_MARGIN, MeasuredPart
from contactlab.tasks.reference_error import ErrorEstimate

LONG = "left_hand_of_the_robot_with_a_long_name_of_a_pad"


@pytest.mark.parametrize("error", [0.123, 0.00047, 0.0])
def test_each_row_is_one_line_of_eighty_columns(error: float) -> None:
    part: dict[str, Any] = {"kind": "geom", "error": error, "body": LONG, "reason": "a safeguard"}
    rows = tuple(
        PartEffect(
            name=LONG + end, verdict="below the tolerance",
            time_ratio=TimeRatio.of(0.123, 0.1, 0.2), can_go=False, **part,
        )
        for end in ("_1", "_2")
    )  # fmt: skip
    report = effects().model_copy(update={"effects": rows})
    lines = render_text(describe_effects(report), 80).splitlines()
    lines = [line for line in lines if line.startswith("geom lef")]
    assert len({*lines}) == 2, "names that differ in their end look alike"
    assert all(len(line) <= 80 and "x0.12" in line for line in lines)


def test_a_time_within_its_noise_is_no_saving() -> None:
    part: dict[str, Any] = {"kind": "geom", "error": 0.0, "body": "", "reason": "a safeguard"}
    rows = [
        PartEffect(name=name, verdict="below the tolerance", time_ratio=ratio, can_go=True, **part)
        for name, ratio in (
            ("noisy", TimeRatio.of(0.9, 0.79, 1.01)),
            ("saving", TimeRatio.of(0.9, 0.88, 0.92)),
        )
    ]
    report = effects().model_copy(update={"effects": tuple(rows)})
    lines = render_text(describe_effects(report), 80).splitlines()
    ends = {line.split()[1]: line.split()[-1] for line in lines if line.startswith("geom ")}
    assert ends == {"noisy": "same", "saving": "x0.90"}


def measure_part(error: float | None, **parts: Any) -> MeasuredPart:
    part = ModelPart("feature", "noslip", ModelEdits(), lambda _: None, exercised=True)
    estimate = None if error is None else ErrorEstimate(error, "", "", 0.0, error, error)
    return MeasuredPart(ModelPart(**{**vars(part), **parts}), estimate)


@pytest.mark.parametrize(
    ("parts", "share", "verdict", "can_go"),
    [
        ({}, 0.9, "below the tolerance", True),
        ({}, 1.1, "near the tolerance", False),
        ({}, 2.1, "needed", False),
        ({"proof": "no friction"}, None, "unused", True),
        ({"proof": "no friction", "reason_to_stay": "--keep"}, None, "unused", False),
        ({"exercised": False}, None, "not exercised", False),
        ({}, None, "not measured", False),
        # Contacts, limits and clamps that are hardly loaded may carry other loads.
        ({"kind": "limit", "reason_to_stay": "a safeguard"}, 0.9, "not exercised", False),
        ({"kind": "limit", "reason_to_stay": "a safeguard"}, 2.1, "needed", False),
        ({"name": "warmstart", "reason_to_stay": "a safeguard"}, 0.9, "below the tolerance", False),
        # An actuator that moves anything is needed, whatever its force.
        ({"kind": "actuator", "name": "push"}, None, "needed", False),
    ],
)
def test_the_verdict_follows_from_proof_load_and_error(
    parts: dict[str, Any], share: float | None, verdict: str, *, can_go: bool
) -> None:
    one = measure_part(None if share is None else share * LOAD_MARGIN * 0.1, **parts)
    assert one.find_verdict(0.1) == verdict
    assert one.can_go(0.1) == can_go


@pytest.mark.parametrize("used", [(), (0,), (3, 4), (0, 6), tuple(range(7))])
def test_halves_find_the_parts_that_single_trials_find(used: tuple[int, ...]) -> None:
    parts = [ModelPart("geom", str(number), None, lambda _: None) for number in range(7)]
    trials = list[int]()

    def is_idle(group: Sequence[ModelPart]) -> bool:
        trials.append(len(group))
        return not any(int(part.name) in used for part in group)

    found = find_used_parts(parts, is_idle)
    assert found == [part for part in parts if not is_idle([part])]
    if len(used) == 1:
        assert len(trials) - len(parts) < len(parts)
