"""A tested fix says of a grip what the fixed model says when it is judged alone."""

from pathlib import Path
from typing import Any

import mujoco
import pytest
from tests.grip.grippers import claw

import contactlab
from contactlab.schema.grip import GripPlacement, GripVerdict
from contactlab.studies.examine.design_causes import find_lost_grip
from contactlab.studies.grip.grip_verdict import GripEvidence, find_causes
from contactlab.studies.grip.gripping import GripRequest, judge_grip, mention_worse_places


@pytest.mark.long
def test_the_speed_with_a_fix_is_that_of_the_fixed_model(tmp_path: Path) -> None:
    path = tmp_path / "claw.xml"
    path.write_text(claw(), encoding="utf-8")
    report = judge_grip(GripRequest(str(path), placements=False))
    fix = next(each for each in report.fixes if {*each.options} == {"cone", "impratio"})
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = float(fix.options["impratio"])  # pyright: ignore[reportArgumentType]
    fixed = tmp_path / "fixed.xml"
    fixed.write_text(spec.to_xml(), encoding="utf-8")
    alone = judge_grip(GripRequest(str(fixed), fixes=False, placements=False))
    assert alone.verdict == fix.verdict
    assert max(drift.speed or 0.0 for drift in alone.drifts) == pytest.approx(fix.speed, rel=0.02)
    # What is held is carried, so pulling it takes at least its weight.
    assert alone.holds
    assert alone.pull.weights > 1
    model = mujoco.MjModel.from_xml_path(str(path))
    assert list(find_lost_grip(model, alone, "it holds")) == []
    (cause,) = find_lost_grip(model, report, report.sentence)
    assert cause.fails


@pytest.mark.parametrize(
    ("idle", "kind"),
    [(2e-4, "shape"), (5e-5, "regularized friction"), (0.0, "regularized friction")],
)
def test_creep_without_a_load_is_no_creep_of_friction(idle: float, kind: str) -> None:
    known = GripEvidence(
        word="creeps", speed=5e-4, idle=idle, pressed=True, pull=20.0, weight=1.0, deep=0.0,
        speeds_with_fixes={"regularized": 1e-5}, tolerance=1e-4,
    )  # fmt: skip
    assert [kind for kind, _ in find_causes(known)] == [kind]


def test_the_headline_names_variants_that_are_held_worse() -> None:
    verdicts: dict[str, GripVerdict] = {
        "as it is": "holds",
        "smaller": "creeps",
        "larger": "drops",
    }
    rows = [
        GripPlacement(name=name, force=1.0, speed=1e-5, verdict=verdict)
        for name, verdict in verdicts.items()
    ]
    assert mention_worse_places("holds", rows) == "; smaller: creeps; larger: drops"
    assert mention_worse_places("creeps", rows) == "; larger: drops"
    assert mention_worse_places("drops", rows) == ""


@pytest.mark.long
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_an_examination_has_the_verdict_of_the_grip(cone: str, tmp_path: Path) -> None:
    path = tmp_path / "claw.xml"
    path.write_text(claw(cone=cone, impratio="10"), encoding="utf-8")
    grip = judge_grip(GripRequest(str(path), fixes=False, placements=False))
    options: dict[str, Any] = {"duration": "0.5s", "workers": 0, "seeds": 1}
    report = contactlab.examine(path, output=tmp_path / "a.json", **options)
    assert grip.holds == (cone == "elliptic")
    assert bool(report.problem) >= (not grip.holds)
    assert any("its hand (claw)" in sentence for sentence in report.why)
    if not grip.holds:
        assert report.headline == f"fails: its hand (claw) {grip.verdict}"
