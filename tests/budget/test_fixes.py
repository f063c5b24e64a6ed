"""Remedies: each is proved by a budget of its own, and has its price."""

import copy
import gc
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from weakref import WeakSet

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from tests.budget.test_rows import servo
from tests.budget_motions import motion_of, walker
from tests.budget_reasons import budget_reason

from contactlab.budget import (
    Motion,
    Settings,
    Trial,
    budget_report,
    error_budget,
    judge,
    try_fixes,
)
from contactlab.budget.field_changes import build_candidate
from contactlab.budget.fixes import (
    candidates_against,
    change_motion,
    describe_reason,
    list_further_candidates,
)
from contactlab.budget.measuring import PhaseMeasure
from contactlab.budget.time_ratios import measure_time_ratios
from contactlab.budget.verdict import Verdict
from contactlab.budget.windows import replay_motion
from contactlab.modifications.catalogue import list_candidates
from contactlab.modifications.contacts import MARGIN
from contactlab.modifications.modification import Candidate
from contactlab.rendering.amounts import format_percent
from contactlab.rendering.text import render_text
from contactlab.reporting.budget_document import describe_budget
from contactlab.scene.model_draft import ModelEdits
from contactlab.schema.error_budget import BudgetReport
from contactlab.schema.json_schemas import json_schemas

FAST = Settings(energy=False)


def test_an_unstable_servo_is_removed_by_what_damps_it_implicitly() -> None:
    """Euler diverges where h kv / I > 2: neither half the step does, nor implicitfast."""
    motion = servo()
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    names = "Newton with 100 iterations", "implicitfast", "half the step"
    few = [candidate for candidate in list_candidates() if candidate.name in names]
    tried = {remedy.name: remedy for remedy in try_fixes([motion], verdict, candidates=few)}
    assert names[0] not in tried
    assert tried[names[1]].removes
    assert tried[names[2]].removes
    price = tried[names[2]].time_ratio
    assert price is not None
    assert price.low <= price.ratio <= price.high
    assert verdict.reasons[0].place == "joint left_knee"
    assert "; fix: " in describe_reason(verdict.reasons[0], list(tried.values()))


@pytest.fixture(name="held")
def held_fixture(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """Return how many measures there are as each of them begins, if nothing looks for garbage."""
    made, held, begin = WeakSet[PhaseMeasure](), list[int](), PhaseMeasure.__init__

    def noted(measure: PhaseMeasure, *arguments: Any, **begun: Any) -> None:
        held.append(len(made))
        made.add(measure)
        begin(measure, *arguments, **begun)

    monkeypatch.setattr(PhaseMeasure, "__init__", noted)
    gc.disable()
    yield held
    gc.enable()


def test_a_finer_step_is_named_where_it_alone_helps(held: list[int]) -> None:
    """At 2.5 ms h kv / I is below 2 again; without constraints, no solver is tried.

    No trial holds the models of another, though nothing looks for garbage.
    """
    motion = servo()
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    names = "Newton with 100 iterations", "half the step"
    few = [candidate for candidate in list_candidates() if candidate.name in names]
    (only,) = try_fixes([motion], verdict, candidates=few, trial=Trial(FAST))
    assert (only.name, only.removes) == ("half the step", True)
    assert only.error < 0.1
    assert "; fix: half the step" in describe_reason(verdict.reasons[0], [only])
    assert len(held) > 1
    assert not any(held)


def test_what_sleeps_in_its_glide_is_woken() -> None:
    """What glides slower than the tolerance stops within ten steps, however fine they are."""
    xml = """<mujoco><option timestep=".002" gravity="0 0 0" sleep_tolerance=".1">
        <flag sleep="enable"/></option><worldbody><body name="puck"><joint type="slide"/>
        <geom type="cylinder" size=".04 .01"/></body></worldbody></mujoco>"""
    motion = motion_of(xml, 0.2, qvel=[0.05])
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    assert verdict.word == "inaccurate"
    few = [one for one in list_candidates() if one.name in ("no sleep", "half the step")]
    found = try_fixes([motion], verdict, candidates=few, trial=Trial(FAST))
    tried = {one.name: one for one in found}
    assert tried["no sleep"].removes
    assert tried["no sleep"].edits.settings == {"sleep": False}
    assert not tried["half the step"].removes


def test_what_sleeps_as_it_starts_is_woken_though_its_finest_motion_sleeps_too() -> None:
    """A door that moves by k x / c = .06 rad/s sleeps at once, at the finest step, too."""
    xml = """<mujoco><option timestep=".005" sleep_tolerance=".08"><flag sleep="enable"/></option>
        <worldbody><body name="door"><joint damping="40" stiffness="2" springref="69" axis="0 0 1"/>
        <geom type="box" pos=".4 0 0" size=".4 .02 1" mass="25"/></body></worldbody></mujoco>"""
    motion = motion_of(xml, 1.0)
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    awake = [one for one in list_candidates() if one.name == "no sleep"]
    [tried] = try_fixes([motion], verdict, candidates=awake, trial=Trial(FAST))
    assert verdict.word == "inaccurate"
    assert tried.removes


@pytest.mark.long
def test_a_light_part_holds_a_heavy_load_by_its_impedance() -> None:
    """A shackle of 5 g under a pound gives (1 - d) / d A f: of d = .95 more than solref mends."""
    xml = """<mujoco><worldbody><body name="hook"><joint type="slide" axis="0 0 1"/>
        <geom size=".01" mass=".005"/></body><body name="load"><joint type="slide" axis="0 0 1"/>
        <geom size=".1" mass=".5" contype="0" conaffinity="0"/></body></worldbody>
        <equality><weld body1="hook"/><weld body1="load" body2="hook"/></equality></mujoco>"""
    motion = motion_of(xml, 0.5)
    verdict = judge(error_budget([motion], rows=["equality softness"], settings=FAST))
    words = "solimp-all", "solref-all"
    few = [one for one in candidates_against([motion], verdict) if one.apply in words]
    tried = try_fixes([motion], verdict, candidates=few, trial=Trial(FAST))
    assert {one.apply: one.removes for one in tried} == dict(zip(words, (True, False), strict=True))


def test_a_ball_that_bears_before_it_touches_is_mended_by_no_margin() -> None:
    """It starts at touch, 2 cm deep in its margin: that throws it up by how soft the contact is."""
    xml = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body pos="0 0 .1"><freejoint/><geom size=".1" margin="{}"/></body></worldbody></mujoco>"""
    motion = motion_of(xml.format(0.02), 0.2)
    verdict = judge(error_budget([motion], rows=["contact softness"], settings=FAST))
    assert verdict.word == "depends"
    (own,) = (one for one in candidates_against([motion], verdict) if one.apply == MARGIN)
    (tried,) = try_fixes([motion], verdict, candidates=[own], trial=Trial(FAST))
    assert tried.removes
    touching = motion_of(xml.format(0), 0.2)
    assert all(one.apply != MARGIN for one in candidates_against([touching], verdict))


def test_a_fix_that_a_load_rejects_is_judged_no_further() -> None:
    """It is no fix, it takes a fraction of the steps, and others are tried in its place."""
    xml = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body pos="0 0 .1"><freejoint/><geom size=".1" margin=".02"/></body></worldbody></mujoco>"""
    motion = motion_of(xml, 0.2)
    verdict = judge(error_budget([motion], rows=["contact softness"], settings=FAST))
    (own,) = (one for one in candidates_against([motion], verdict) if one.apply == MARGIN)
    asked = list[str]()

    def find_harm(candidate: Candidate, edits: ModelEdits) -> bool:
        asked.append(candidate.name)
        assert edits.settings
        return True

    counted = Trial(FAST, finds_harm=find_harm)
    (harmful,) = try_fixes([motion], verdict, candidates=[own], trial=counted)
    (whole,) = try_fixes([motion], verdict, candidates=[own], trial=Trial(FAST))
    assert asked == [own.name]
    assert (harmful.harms, harmful.removes, harmful.safely) == (True, False, False)
    assert (whole.harms, whole.removes) == (False, True)
    assert harmful.error == whole.error  # the reading of a row needs no finer reference
    requested = replace(counted, requested=[own.apply])
    (applied,) = try_fixes([motion], verdict, candidates=[own], trial=requested)
    assert applied.removes, "a user who asks for a change gets its whole budget"


def test_a_rotor_on_gimbals_is_computed_by_fine_steps_of_runge_kutta() -> None:
    """Its step is 2.5 rad of spin; a sixteenth is .16, of which RK4 leaves the fourth power."""
    xml = """<mujoco><option timestep=".01" gravity="0 0 0"/><worldbody><body name="hub">
        <joint axis="0 0 1"/><geom type="cylinder" size=".05 .05" mass=".5"/><body><joint
        axis="0 1 0"/><geom type="box" size=".02 .04 .02" mass=".1"/><body name="rotor"><joint
        axis="1 0 0"/><geom type="cylinder" size=".08 .01" euler="0 90 0" mass=".6"/></body></body>
        </body></worldbody></mujoco>"""
    motion = motion_of(
        xml.replace("/></body>", ' contype="0"/></body>'), 0.04, qvel=[0.5, 0.5, 250]
    )
    assert judge(error_budget([motion], rows=[], settings=FAST)).word != "ok"
    few = [*list_further_candidates()]
    assert {one.name: one.rate for one in few} == {
        "implicitfast at a quarter of the step": 4,
        "implicitfast at an eighth of the step": 8,
        "implicit": 1,
        "RK4 at a quarter of the step": 4,
        "a sixteenth of the step": 16,
        "1/32 of the step": 32,
        "RK4 at a sixteenth of the step": 16,
        "1/64 of the step": 64,
    }
    (finest,) = (one for one in few if one.name == "RK4 at a sixteenth of the step")
    budget = error_budget([change_motion(motion, finest)], rows=[], settings=FAST)
    assert judge(budget).word == "ok"


def test_time_constants_that_the_step_raises_may_be_written_as_it_has_them() -> None:
    """A limit of .2 ms at a step of 2 ms acts as one of 4 ms: the change moves the run as it moves.

    Nothing is offered where constants are longer, or the limit is none.
    """

    def offered(constant: float, limited: str) -> dict[str, object]:
        motion = motion_of(
            f"""<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" range="-1 .1"
            limited="{limited}" solreflimit="{constant} 1"/><geom size=".1" pos=".3 0 0"/></body>
            </worldbody></mujoco>""",
            0.04,
        )
        verdict = Verdict("inaccurate", 0.1, ())
        found = candidates_against([motion], verdict)
        return {name: one for each in found for name, one in each.edits.settings.items()}

    assert offered(2e-4, "true") == {"jnt_solref[hinge]": (0.004, 1.0)}
    assert offered(4e-3, "true") == offered(2e-4, "false") == {}


@pytest.mark.long
def test_what_a_step_does_not_hold_is_tried_stiffer_after_finer_steps() -> None:
    """A servo that diverges stays so whatever is stiffer at its step."""
    motion, tried = servo(), list[str]()
    reason = budget_reason("depends", motion.name, "limit softness", 0.2, "", "")
    some = [
        build_candidate(name, "solref", (), word="depends", rate=rate)
        for name, rate in (("stiff", 1), ("stiffer", 1), ("finer", 2))
    ]

    def moved(candidate: Candidate) -> list[list[Motion]]:
        tried.append(candidate.name)
        return [[change_motion(motion, candidate)]]

    verdict = Verdict("depends", 0.1, (reason,))
    try_fixes([motion], verdict, candidates=some, trial=Trial(FAST, list_motions=moved))
    assert tried == ["stiff", "finer", "stiffer"]


def test_a_solver_is_tried_where_contacts_need_it() -> None:
    """One sweep of Gauss and Seidel leaves a tower's base without the load above it."""
    boxes = "".join(
        f"""<body pos="0 0 {0.1 * level + 0.05}"><freejoint/>
        <geom type="box" size=".05 .05 .05" mass="{1 + 9 * level}"/></body>"""
        for level in range(3)
    )
    xml = f"""<mujoco><option solver="PGS" iterations="1" timestep=".001"/><worldbody>
        <geom type="plane" size="1 1 .1"/>{boxes}</worldbody></mujoco>"""
    motion = motion_of(xml, 0.4)
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    few = [candidate for candidate in list_candidates() if candidate.exercised]
    (tried,) = try_fixes([motion], verdict, candidates=few, trial=Trial(FAST))
    assert verdict.word == "inaccurate"
    assert (tried.name, tried.removes) == ("Newton with 100 iterations", True)


@pytest.mark.parametrize(
    ("share", "said"), [(0.9951, "100 %"), (0.034, "3.4 %"), (1.5, "150 %"), (6.83, "683 %")]
)
def test_shares_have_no_exponents(share: float, said: str) -> None:
    assert format_percent(share) == said


@pytest.mark.long
@pytest.mark.timed
def test_half_the_step_costs_twice_the_time() -> None:
    """Up to what Newton saves where a warm start is better: a tenth of the steps' time."""
    motion = walker(seconds=0.4)
    model = copy.copy(motion.model)
    model.opt.timestep /= 2
    price = measure_time_ratios(
        motion, replay_motion(motion, 0.04, 1), {"half": (lambda: model, 2)}
    )["half"]
    assert price.ratio == pytest.approx(2, rel=0.15)
    assert price.low <= price.ratio <= price.high


def test_what_is_sound_needs_no_remedy() -> None:
    motion = servo(integrator="implicitfast")
    assert try_fixes([motion], judge(error_budget([motion], rows=[], settings=FAST))) == ()


def test_a_table_has_80_columns_and_says_what_was_not_exercised() -> None:
    budget = error_budget([servo(integrator="implicitfast")])
    lines = render_text(describe_budget(budget_report(budget, judge(budget)))).split("\n")
    assert lines[0] == "ok (tolerance 10 %)"
    assert max(map(len, lines)) <= 80
    for name in ("numerical error", "  step", "  damping", "  gravity", "  mass 5 %"):
        assert any(re.match(rf"{name} +[\d.]+ %", line) for line in lines)
    assert any(line.startswith("not exercised by the task: ") for line in lines)


def test_a_table_shows_infinite_shares() -> None:
    budget = error_budget([servo(damping=8.0)], rows=[], settings=FAST)
    lines = render_text(describe_budget(budget_report(budget, judge(budget)))).split("\n")
    assert lines[0] == "inaccurate (tolerance 10 %)"
    assert any("∞" in line for line in lines)
    assert any("left_knee" in line for line in lines)


@pytest.mark.parametrize("motion", [servo(integrator="implicitfast"), servo(damping=8.0)])
def test_a_report_comes_back_from_json(motion: Motion) -> None:
    """Infinite numbers are null, and said to be infinite; the schema allows all that is written."""
    budget = error_budget([motion], rows=["step", "damping"], settings=FAST)
    report = budget_report(budget, judge(budget))
    text = report.model_dump_json()
    assert BudgetReport.model_validate_json(text) == report
    Draft202012Validator(json_schemas()["budget.schema.json"]).validate(json.loads(text))
    run = report.phases[0].numerical_error
    assert run.infinite == np.isinf(budget.error)
    assert (run.error is None) == run.infinite


def test_what_there_is_no_time_for_is_named_and_not_advised() -> None:
    """No clock tells whether a change helps: it is proved, or said to be untried."""
    motion = servo()
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    few = [one for one in list_candidates() if one.name in ("implicitfast", "RK4", "half the step")]
    late = Trial(FAST, find_time_left=lambda: 0.0)
    none = try_fixes([motion], verdict, candidates=few, trial=late)
    every = try_fixes([motion], verdict, candidates=few, trial=Trial(FAST))
    assert {one.name for one in none} >= {one.name for one in every}
    assert not any(one.is_complete or one.removes for one in none)
    assert all(one.is_complete for one in every)


@pytest.mark.long
def test_time_runs_out_between_trials() -> None:
    """What was tried before is known as if there had been time; what comes after is not advised."""
    motion = servo()
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    names = "implicitfast", "half the step"
    few = [candidate for candidate in list_candidates() if candidate.name in names]
    answers = iter([math.inf] * 4)  # for nearness, and for three budgets of the first change
    timed = Trial(FAST, find_time_left=lambda: next(answers, 0.0))
    some = try_fixes([motion], verdict, candidates=few, trial=timed)
    every = try_fixes([motion], verdict, candidates=few, trial=Trial(FAST))
    whole = {one.name: one.removes for one in every}
    ended = {one.name: one.removes for one in some if one.is_complete}
    assert 0 < len(ended) < len(some)
    assert ended.items() <= whole.items()


def test_a_change_that_moves_the_model_as_another_is_tried_once() -> None:
    """Of motors and damped joints, implicitfast makes what Euler with its damping does."""
    motion = walker(0.02)
    verdict = judge(error_budget([motion], rows=[], settings=FAST), tolerance=1e-3)
    tried = {one.name for one in try_fixes([motion], verdict, trial=Trial(FAST))}
    assert "half the step" in tried
    assert not {"implicitfast", "implicitfast at half the step"} & tried


def test_a_fix_that_includes_another_has_to_come_nearer() -> None:
    """A part that removes the verdict at its edge is enough, unless more comes nearer."""
    xml = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body pos="0 0 .1"><freejoint/><geom size=".1" margin=".02"/></body></worldbody></mujoco>"""
    motion = motion_of(xml, 0.2)
    verdict = judge(error_budget([motion], rows=["contact softness"], settings=FAST))
    (own,) = (one for one in candidates_against([motion], verdict) if one.apply == MARGIN)
    more = replace(own, name="more", apply="more", includes=(own.name,))
    found = try_fixes([motion], verdict, candidates=[own, more], trial=Trial(FAST))
    assert [fix.name for fix in found] == [own.name]
