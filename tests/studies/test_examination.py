"""The head of an examination: its verdict, its causes, and its fix."""

import re
from collections.abc import Sequence
from typing import Any

import pytest

from contactlab.rendering.text import render_text
from contactlab.reporting.examination_document import describe_examination
from contactlab.schema.error_budget import BudgetPhase, BudgetReason, BudgetReport, BudgetRow
from contactlab.schema.examination import Cause, Examination, Fact, Fix, RunLabel
from contactlab.schema.finding import Finding
from contactlab.schema.grip import GripReport, GripVerdict
from contactlab.schema.task import Phase, Task
from contactlab.schema.verdict import VerdictWord
from contactlab.studies.examine.conclusion import conclude
from contactlab.studies.grip.grip_fact import describe_grip

WORDS: tuple[VerdictWord, ...] = ("inaccurate", "undecided", "depends", "ok")
OVERLAP = Fact(kind="overlap", place="", value=0.02, unit="m", sentence="mug is in the table")
LABEL = RunLabel(
    label="tunneling", phase="held", runs=2, reason="mug passed the table", seed=0, time=0.5
)


def row(name: str, error: float | None, kind: Any = "numerics") -> BudgetRow:
    known = error is not None
    return BudgetRow(
        name=name, summary="", kind=kind, exercised=known, infinite=False, error=error, seeds=None,
        median=None, by_mass=None, body="mug" if known else None, place="floor - mug", speed=None,
        seed=0, time=0.3, time_ratio=None,
    )  # fmt: skip


def phase(name: str, error: float) -> BudgetPhase:
    rows = (row("step", error), row("cone", 0.4, "model"), row("contact softness", 0.2, "model"))
    return BudgetPhase(
        name=name, timestep=0.01, steps=100, seeds=3, window=0.04, windows=25, bodies=("mug",),
        numerical_error=row("numerical error", error), rows=rows, energy_drift=0.0,
        excess_path=0.0, worst_window=0.0, upper_bound=error, limit_factor=1.0,
        invalid_windows=0.0, warnings=(),
    )  # fmt: skip


def examined(
    word: VerdictWord,
    *,
    name: str = "held",
    time: float | None = 0.2,
    **keys: Any,
) -> Examination:
    """Return an examination whose excitation begins 1.5 s after its rest, not concluded."""
    phases = (
        Phase(name="held", begin=0.0, end=1.5),
        Phase(name="excitation", begin=1.5, end=4.0),
    )
    task = Task(start="home", drive="exercise", own_controls=True, duration=4.0, phases=phases)
    reasons = ()
    if word != "ok":
        named = {"depends": "cone", "undecided": "reference"}.get(word, "numerical error")
        sentence = "numerical error 40 % in mug"
        where: Any = {"body": "mug", "place": "floor - mug", "time": time, "sentence": sentence}
        reasons = (BudgetReason(verdict=word, phase=name, row=named, error=0.4, **where),)
    budget = BudgetReport(
        tolerance=0.1,
        verdict=word,
        reasons=reasons,
        phases=(phase("held", 0.04), phase("excitation", 0.02)),
    )
    sections: Any = ("labels", "budget", "facts", "checks", "fixes")
    report = Examination(model="mug.xml", mujoco="4.0.0", task=task, sections=sections)
    return report.model_copy(update={"budget": budget, **keys})


def fix(name: str = "half the step", **keys: Any) -> Fix:
    return Fix(
        name=name, changes_model=False, apply="", settings={}, error=0.02,
        distance_to_reference=None, distance_before=None, time_ratio=None,
        lines=("mug.xml:3: <option timestep=\"0.001\"/>",),
    ).model_copy(update=keys)  # fmt: skip


def failure(name: str) -> Finding:
    return Finding(
        name=name, kind="task", level="gate", outcome="failed", verdict="unmet", judged=1,
        failing=1, message=f"{name} 2 (limit 0)",
    )  # fmt: skip


@pytest.mark.parametrize("time", [0.0, 0.25, 1.2])
@pytest.mark.parametrize(("name", "begin"), [("held", 0.0), ("excitation", 1.5)])
def test_a_time_counts_from_the_beginning_of_the_run(name: str, begin: float, time: float) -> None:
    """A reason's counts from the beginning of its phase."""
    (cause,) = conclude(examined("inaccurate", name=name, time=time)).why
    found = re.search(r", (\d+\.\d+) s", cause)
    assert found is not None
    assert float(found[1]) == pytest.approx(begin + time, abs=0.005)


def test_where_no_time_is_known_the_phase_is_named() -> None:
    (cause,) = conclude(examined("inaccurate", name="excitation", time=None)).why
    assert "in the phase excitation" in cause
    assert re.search(r"\d s", cause) is None


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("labels", [(), (LABEL,)])
def test_a_label_fails_a_run_whose_numerics_are_fine(
    word: VerdictWord, labels: Sequence[RunLabel]
) -> None:
    report = conclude(examined(word, labels=labels))
    fails = labels and word in {"depends", "ok"}
    assert report.verdict == ("fails" if fails else word)
    assert any(LABEL.reason in cause for cause in report.why) == bool(labels)


def test_a_failure_has_one_numerical_error_in_its_reasons() -> None:
    """That of the run with the label; without it, the one of the budget."""
    caused = f"{LABEL.reason}; cause: the model (numerical error 3.2 % in mug)"
    own = LABEL.model_copy(update={"reason": caused})
    for label, error in ((own, "3.2 %"), (LABEL, "4 %")):
        why = " ".join(conclude(examined("depends", labels=(label,))).why)
        assert re.findall("numerical error ([0-9.]+ %)", why) == [error]
        assert "also depends on the friction cone" in why


@pytest.mark.parametrize("word", ["holds", "creeps"])
def test_a_grip_that_holds_is_no_reason_of_a_failure(word: GripVerdict) -> None:
    """It is one of a model that passes, and remains a fact."""
    said: Any = {"keyframe": None, "base": "hand", "sentence": f"{word} the mug", "drifts": ()}
    grip = describe_grip(GripReport.model_construct(verdict=word, **said))
    for labels in ((LABEL,), ()):
        why = conclude(examined("ok", labels=labels, facts=(grip,))).why
        assert (grip.sentence in why) == (word != "holds" or not labels)


def test_a_failed_check_fails_and_a_waived_label_does_not() -> None:
    checked = conclude(examined("ok", findings=(failure("impossible_bodies"),)))
    assert (checked.verdict, checked.headline) == ("fails", "fails: check impossible_bodies")
    waived = failure("failure_labels").model_copy(update={"outcome": "noted"})
    assert conclude(examined("ok", labels=(LABEL,), findings=(waived,))).verdict == "ok"


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("labels", [(), (LABEL,)])
def test_a_headline_begins_with_the_verdict_and_has_at_most_15_words(
    word: VerdictWord, labels: Sequence[RunLabel]
) -> None:
    report = conclude(examined(word, labels=labels))
    assert report.verdict is not None
    assert report.headline.startswith(report.verdict)
    assert len(report.headline.split()) <= 15


@pytest.mark.parametrize("word", [word for word in WORDS if word != "ok"])
def test_an_overlap_of_the_start_is_the_first_cause(word: VerdictWord) -> None:
    report = conclude(examined(word, labels=(LABEL,), facts=(OVERLAP,)))
    assert report.why[0] == OVERLAP.sentence


@pytest.mark.parametrize(("place", "is_cause"), [("floor - mug", True), ("lid - pan", False)])
def test_an_overlap_causes_no_dependence_at_another_contact(place: str, is_cause: bool) -> None:
    overlap = OVERLAP.model_copy(update={"place": place})
    report = conclude(examined("depends", facts=(overlap,)))
    assert report.verdict == "depends"
    assert (overlap.sentence in report.why) == is_cause
    assert ("move the bodies apart" in report.fix) == is_cause
    assert overlap.sentence in " ".join(render_text(describe_examination(report)).split())


@pytest.mark.parametrize("word", ["ok", "depends", "inaccurate"])
def test_a_fall_is_said_first_if_the_numerics_pass(word: VerdictWord) -> None:
    fall = Fact(kind="fall", place="trunk", value=0.5, unit="m", sentence="trunk falls by 500 mm")
    report = conclude(examined(word, facts=(fall,)))
    assert (report.why[0] == fall.sentence) == (word != "inaccurate")
    assert render_text(describe_examination(report)).count(fall.sentence) == 1


START = Cause(
    stage="start",
    sentence="its start overlaps by 20 mm at contact world - mug",
    repair="a raised start",
    verdict="ok",
    remainder="ok: numerical error 1 % in mug",
)


@pytest.mark.parametrize("word", WORDS)
def test_a_cause_that_comes_first_is_the_headline_and_the_rest_follows(word: VerdictWord) -> None:
    report = conclude(examined(word, labels=(LABEL,), facts=(OVERLAP,), causes=(START,)))
    assert report.headline == f"{report.verdict}: {START.sentence}"
    assert report.why == (f"with a raised start: {START.remainder}",)


def test_a_fault_that_a_setting_of_collision_removes_is_one_of_collision() -> None:
    found = fix("speculative contacts", removes="labels")
    report = conclude(examined("ok", labels=(LABEL,), fixes=(found,)))
    assert report.headline == f"fails: {report.causes[0].sentence.partition(':')[0]}"
    assert report.causes[0].stage == "collision"
    assert any(LABEL.reason in line for line in report.why)
    finer = fix("speculative contacts at half the step", removes="labels")
    assert conclude(examined("ok", labels=(LABEL,), fixes=(finer,))).causes == ()


def test_a_fault_of_the_file_fails_whatever_the_runs_say() -> None:
    fault = Cause(stage="file", sentence="no actuators: 2 joints have motors")
    report = conclude(examined("ok", causes=(fault,)))
    assert (report.verdict, report.headline) == ("fails", "fails: no actuators")
    assert report.why[0] == fault.sentence
    assert conclude(examined("inaccurate", causes=(fault,))).verdict == "inaccurate"


def test_the_main_numerical_setting_is_the_cause() -> None:
    report = examined("inaccurate")
    assert "the time step is too long at floor - mug" in conclude(report).why[0]
    assert report.budget is not None
    rows = (row("step", 0.001), row("solver", 0.04))
    held = report.budget.phases[0].model_copy(update={"rows": rows})
    other = report.budget.model_copy(update={"phases": (held,)})
    late = conclude(report.model_copy(update={"budget": other}))
    assert "the solver stops too early" in late.why[0]


def test_the_fix_is_one_that_was_found_or_says_why_there_is_none() -> None:
    assert conclude(examined("ok")).fix == "not needed"
    found = conclude(examined("inaccurate", fixes=(fix(),)))
    assert found.fix == "half the step: numerical error falls from 40 % to 2 %"
    assert conclude(examined("inaccurate"), fixes_tried=4).fix == "none of 4 tried removes it"
    late = conclude(examined("inaccurate"), fixes_not_tried=["RK4"])
    assert "no time" in late.fix
    some = conclude(examined("inaccurate"), fixes_tried=4, fixes_not_tried=["RK4"])
    assert some.fix.startswith("none of 4 tried removes it; 1 were not tried")
    checks = examined("inaccurate").model_copy(update={"sections": ("checks",)})
    assert "contactlab mug.xml" in conclude(checks).fix


def test_a_fix_of_the_start_comes_first() -> None:
    part = fix("no contacts of a - b", removes="overlap", excluded_pairs=(("a", "b"),))
    report = conclude(examined("inaccurate", fixes=(fix(), part), facts=(OVERLAP,)))
    assert report.fix.startswith("no contacts of a - b")


def test_a_finding_of_the_file_that_is_the_cause_is_no_fact() -> None:
    """A reason ends with its place, a finding begins with it."""
    said, other = "nothing is below the base; add a floor", "a mass is denser than any metal"
    facts = [
        OVERLAP.model_copy(update={"sentence": f"mug.xml:3: warning: {each} [rule]"})
        for each in (said, other)
    ]
    report = conclude(examined("ok", facts=tuple(facts)))
    report = report.model_copy(update={"why": (f"{said} (mug.xml:3)",)})
    text = " ".join(render_text(describe_examination(report)).split())
    assert text.count(said) == text.count(other) == 1


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("labels", [(), (LABEL,)])
def test_the_text_says_nothing_twice(word: VerdictWord, labels: Sequence[RunLabel]) -> None:
    """Its first line is the verdict; causes, fix and facts each stand in it once."""
    fixes = () if word == "ok" and not labels else (fix(), fix("RK4"))
    report = conclude(examined(word, labels=labels, facts=(OVERLAP,), fixes=fixes))
    lines = render_text(describe_examination(report)).split("\n")
    text = " ".join(" ".join(lines).split())
    assert lines[0] == report.headline
    for part in (report.headline, *report.why, report.fix, OVERLAP.sentence, report.task.line):
        assert text.count(part) == 1, part
    for each in fixes:
        assert text.count(f"{each.name}:") == 1


@pytest.mark.parametrize(
    ("count", "where"),
    [(0, ""), (1, " of b0"), (4, " of b0, b1, b2, b3"), (32, " of b0, b1, b2, b3 and 28 more")],
)
def test_a_label_of_many_bodies_names_the_first(count: int, where: str) -> None:
    bodies = tuple(f"b{body}" for body in range(count))
    assert LABEL.model_copy(update={"bodies": bodies}).where == where
    assert not LABEL.model_copy(update={"bodies": ("mug", *bodies)}).where, "its reason names it"


@pytest.mark.parametrize(
    ("sentence", "shown"),
    [
        ("the hook is upside down: it holds nothing", "the hook is upside down"),
        (
            "13 of 13 hinges turn by less than 15 degrees, as joint 'hip' from -0.2 to 0.5 degrees",
            "13 of 13 hinges turn by less than 15 degrees",
        ),
        (
            "the wheel of the left axle of the rear carriage of the second train spins in place",
            "the wheel of the left axle of the rear carriage of the second train ...",
        ),
    ],
)
def test_a_headline_ends_with_a_clause(sentence: str, shown: str) -> None:
    cause = Cause(stage="file", sentence=sentence, fails=True)
    assert conclude(examined("ok", causes=(cause,))).headline == f"fails: {shown}"
