"""What is known of a few scenes comes out of their ablation."""

from collections.abc import Callable

import pytest

from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.schema.study_reports import EffectFinding, RecordedEffectsReport

Ablate = Callable[..., RecordedEffectsReport]
# What holds everywhere: these change how results are found, or what is recorded of them.
ANYWHERE = ("midphase", "island", "energy")


def needs(report: RecordedEffectsReport) -> dict[str, str]:
    """Return every verdict."""
    return {each.effect: each.verdict for each in report.effects}


def finding(report: RecordedEffectsReport, effect: str) -> EffectFinding:
    """Return what is found of one effect."""
    (found,) = [each for each in report.effects if each.effect == effect]
    return found


def is_free(report: RecordedEffectsReport, *names: str) -> bool:
    """Say whether some effects are free, by proof or by runs."""
    return {needs(report)[name] for name in names} <= {"below the tolerance", "unused"}


@pytest.mark.long
def test_a_vertical_ball_needs_no_friction(ablate: Ablate) -> None:
    report = ablate("version: 1\nscene: ball_drop\nduration: 1.0\n")
    assert is_free(report, "tangential_friction", *ANYWHERE)
    assert {"contact", "gravity"} <= {*report.smallest_set.on}
    assert report.verification.holds
    assert report.verification.runs == 10


@pytest.mark.long
def test_friction_holds_a_block(ablate: Ablate) -> None:
    """Without it the block falls freely: 4.9 m/s after half a second."""
    report = ablate("version: 1\nscene: gripping_pad\nduration: 0.5\ntolerances: {drop: 1.0e-3}\n")
    found = finding(report, "tangential_friction")
    assert found.verdict == "needed"
    (change,) = found.metric_changes
    assert change.metric == "drop"
    assert change.change == pytest.approx(9.81 / 2 * 0.5**2, rel=0.02)
    assert is_free(report, *ANYWHERE)


@pytest.mark.night
@pytest.mark.parametrize(("coefficient", "need"), [(0.001, "needed"), (0.0, "below the tolerance")])
def test_rolling_friction_is_needed_where_it_has_a_coefficient(
    ablate: Ablate, coefficient: float, need: str
) -> None:
    """mu_r g / (1.4 r) is 0.14 m/s^2 for 1 mm; the engine's least, 0.01 mm, changes 0.3 %."""
    text = (
        "version: 1\nscene: roll_friction\ntolerances: {final_speed: 0.01}\n"
        f"axes: {{friction.roll: [{coefficient}]}}\n"
    )
    report = ablate(text)
    assert needs(report)["rolling_friction"] == need
    assert is_free(report, *ANYWHERE)


SLIDE = """
version: 1
scene: box_slide
tolerances: {{drift: 0.01}}
axes: {{direction: {{values: [{}], role: scenario}}}}
"""


@pytest.mark.night
def test_an_effect_that_matters_in_one_scenario_is_kept(ablate: Ablate) -> None:
    """A pyramid is exact along its axes and 41 % too weak between them."""
    assert needs(ablate(SLIDE.format("0")))["elliptic"] == "below the tolerance"
    report = ablate(SLIDE.format("0, 45, 90"))
    found = finding(report, "elliptic")
    assert found.verdict == "needed"
    assert found.metric_changes[0].scenario == {"direction": 45.0}
    # v^2 / (2 mu g) - v h / 2 = 0.4037 m, and sqrt(2) times that without the bias's share.
    assert found.metric_changes[0].change == pytest.approx(0.41 * 0.4037, rel=0.05)
    assert "elliptic" in report.smallest_set.on


@pytest.mark.night
@pytest.mark.parametrize(("shape", "need"), [(2, "needed"), (1, "unused")])
@pytest.mark.skipif("multiccd" not in FLAG_NAMES, reason="this engine has no such switch")
def test_plates_need_several_contacts_as_meshes_not_as_boxes(
    ablate: Ablate, shape: int, need: str
) -> None:
    report = ablate(
        "version: 1\nscene: plates_sliding\ntolerances: {drift: 0.01}\n"
        f"axes: {{shape: [{shape}]}}\n"
    )
    assert needs(report)["multiccd"] == need
    assert is_free(report, *ANYWHERE)


@pytest.mark.long
@pytest.mark.skipif("speculative" not in FLAG_NAMES, reason="speculative came with MuJoCo 4.0")
def test_a_thin_plate_at_speed_needs_contacts_ahead_of_touch(ablate: Ablate) -> None:
    report = ablate(
        "version: 1\nscene: thin_plate\neffects: {speculative: true}\n"
        "axes: {radius: [0.01], speed: [10], solref: ['0.005 1'],"
        " phase: {values: [0, 0.29, 0.57], role: scenario}}\n"
    )
    found = finding(report, "speculative")
    assert (found.on, found.verdict) == (True, "needed")
    assert "stable -> tunneling" in found.labels
    assert is_free(report, *ANYWHERE)


@pytest.mark.night
@pytest.mark.timed
def test_a_stack_at_rest_may_sleep(ablate: Ablate) -> None:
    report = ablate(
        "version: 1\nscene: box_stack\naxes: {boxes: [5]}\n"
        "tolerances: {drift: 2.0e-3, drop: 1.0e-4, rest_speed: 1.0e-3}\n",
        rounds=3,
    )
    found = finding(report, "sleep")
    assert found.verdict == "saves time"
    assert found.time_ratio is not None
    assert found.time_ratio.ratio < 1 / 3
    assert report.smallest_set.added[-1] == "sleep"
    assert "island" not in report.smallest_set.off
    assert report.time_ratio is not None
    assert report.verification.time_ratio is not None
    assert report.verification.time_ratio.ratio == pytest.approx(report.time_ratio.ratio, rel=0.1)
    assert report.verification.holds
