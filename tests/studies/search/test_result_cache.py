"""The same question is not searched again; any other question is."""

from dataclasses import replace
from pathlib import Path

import pytest

from contactlab.plan.task_options import read_task_options
from contactlab.rendering.text import render_text
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.tune_report import (
    REPORT,
    Candidate,
    CurrentVerdict,
    FrontPoint,
    SkippedSetting,
    Target,
    TuneReport,
    Verification,
)
from contactlab.studies.search.report_text import UNVERIFIED, no_speedup_text, sentence_of
from contactlab.studies.search.result_cache import find_cached_report
from contactlab.studies.search.tune_document import describe_tuning
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

BALL = """<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
TASK = read_task_options(drive="none", duration="0.1s")


@pytest.fixture
def asked(tmp_path: Path) -> TuneRequest:
    """A question, whose answer lies in `before`, with the model that was written."""
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    request = TuneRequest(str(path), TASK, error=0.02)
    examined = open_model(str(path), Session(tmp_path), TASK)
    now = Candidate(
        settings={},
        timestep=0.002,
        removes_unused=False,
        removes_far_pairs=False,
        simplifies_hulls=False,
        error=0.01,
        low=0.01,
        high=0.01,
        body="body[1]",
        phase="free",
        time=0.0,
        exact=False,
        cost=1.0,
        time_ratio=None,
    )
    report = TuneReport(
        model=str(path),
        scene_hash=examined.scene.hash,
        mujoco=VERSION,
        task=examined.task,
        fall="",
        target=Target(
            kind="error",
            limit=0.02,
            unit="1",
            tolerance=0.1,
            real_time=None,
            observed=(),
            error_at=None,
            divergence="",
            chance=0.0,
        ),
        sentence="an answer",
        target_met=True,
        current=now,
        current_verdict=None,
        recommended=now,
        front=(),
        picked=None,
        uncertainty=(),
        far_pairs=None,
        simplified_hulls=None,
        closest=None,
        limiting_factor="",
        unconstrained_cost=None,
        equal_error=None,
        real_time=1.0,
        integrator="Euler",
        reference_integrator="Euler",
        reference_step=0.001,
        candidates=(now,),
        changed_settings=(),
        masked=(),
        excluded=(),
        removed_sensors=(),
        disabled_flags=(),
        not_changed=(),
        verified=None,
        file="tuned/tuned.xml",
        lines=(),
        trials=1,
        planned_trials=2,
        ended="complete",
        max_cpu=120.0,
        seconds=1.0,
    )
    written = tmp_path / "before" / "tuned" / "tuned.xml"
    written.parent.mkdir(parents=True)
    written.write_text(BALL)
    (tmp_path / "before" / REPORT).write_text(report.model_dump_json())
    return request


def found(request: TuneRequest, folder: Path) -> TuneReport | None:
    return find_cached_report(request, Session(folder / "before"))


def test_the_answer_to_the_same_question_is_found(asked: TuneRequest, tmp_path: Path) -> None:
    report = found(asked, tmp_path)
    assert report
    assert report.sentence == "an answer"
    assert found(replace(asked, pick=2), tmp_path) == report
    assert find_cached_report(asked, Session(tmp_path / "none")) is None


@pytest.mark.parametrize(
    "change",
    [
        {"error": 0.03},
        {"error": None},
        {"real_time": 5.0, "error": None},
        {"apply": {"sensors": None}},
        {"apply": {"far-pairs": 0.05}},
        {"apply": {"hulls": 0.001}},
        {"task": read_task_options(drive="none", duration="0.2s")},
        {"task": read_task_options(drive="none", duration="0.1s", tolerance=["1%"])},
    ],
)
def test_another_question_is_searched(
    asked: TuneRequest, change: dict[str, object], tmp_path: Path
) -> None:
    assert found(replace(asked, **change), tmp_path) is None  # pyright: ignore[reportArgumentType]


def test_another_model_and_lost_files_and_short_times_are_no_answer(
    asked: TuneRequest, tmp_path: Path
) -> None:
    path, before = Path(asked.model), tmp_path / "before"
    path.write_text(BALL.replace('".1"', '".2"'))
    assert found(asked, tmp_path) is None
    path.write_text(BALL)
    stored = (before / REPORT).read_text()
    (before / REPORT).write_text(stored.replace('"ended":"complete"', '"ended":"time"'))
    assert found(asked, tmp_path) is None
    # A search that its work ended may find more with more of it.
    (before / REPORT).write_text(stored.replace('"ended":"complete"', '"ended":"work"'))
    assert found(asked, tmp_path)
    assert found(replace(asked, max_cpu=240.0), tmp_path) is None
    (before / REPORT).write_text(stored)
    (before / "tuned" / "tuned.xml").unlink()
    assert found(asked, tmp_path) is None


def test_what_saves_no_fifth_is_told_with_what_there_is_to_save(
    asked: TuneRequest, tmp_path: Path
) -> None:
    """The cheapest as accurate at the own step, and the longer step that is not."""
    report = found(asked, tmp_path)
    assert report
    assert not no_speedup_text(report)
    own = report.current.model_copy(update={"settings": {"island": False}, "cost": 0.93})
    rough = own.model_copy(update={"settings": {"cone": "elliptic"}, "error": 0.03, "cost": 0.5})
    longer = report.current.model_copy(update={"timestep": 0.003, "error": 0.04})
    points = (report.current, own, rough, longer)
    assert no_speedup_text(
        report.model_copy(update={"unconstrained_cost": 0.5, "candidates": points})
    ) == (
        "work at the same timestep: x0.50 without contacts and other constraints, x0.93 at best "
        "(island off), the next longer timestep, 0.003 s, is less accurate"
    )


def test_what_no_time_was_left_to_judge_is_not_told_to_be_kept(
    asked: TuneRequest, tmp_path: Path
) -> None:
    """Of what was tried, the fastest within the limit that did not fail before."""
    report = found(asked, tmp_path)
    assert report
    now = report.current
    fast, faster, failed, rough = (
        now.model_copy(update={"timestep": step, "error": error, "cost": cost})
        for step, error, cost in (
            (0.004, 0.01, 0.5),
            (0.008, 0.02, 0.25),
            (0.01, 0.02, 0.2),
            (0.02, 0.5, 0.1),
        )
    )
    ended = {"current": now, "recommended": None, "candidates": (now, fast, faster, failed, rough)}
    kept = (SkippedSetting(name="timestep 0.01", reason="on fresh seeds: tunneling"),)
    told = sentence_of(report.model_copy(update={**ended, "not_changed": kept}))
    assert told.startswith("No change recommended.")
    kept = (*kept, SkippedSetting(name="tuned", reason=UNVERIFIED))
    assert sentence_of(report.model_copy(update={**ended, "not_changed": kept})) == (
        "Numerical error is 1 %. No time was left to verify a candidate that may be "
        "faster: timestep 0.008, x0.25 work. Allow more with --max-cpu."
    )


def test_what_may_keep_the_aim_is_told_apart_from_what_failed(
    asked: TuneRequest, tmp_path: Path
) -> None:
    report = found(asked, tmp_path)
    assert report
    now = report.current.model_copy(update={"error": 0.05})
    near = now.model_copy(update={"timestep": 0.001, "error": 0.015, "cost": 2.0})
    missed = {"current": now, "recommended": None, "closest": near, "limiting_factor": "the ball"}
    kept = (SkippedSetting(name="tuned", reason=UNVERIFIED),)
    told = sentence_of(report.model_copy(update={**missed, "not_changed": kept}))
    assert told.endswith(
        "No time was left to verify a candidate for the target of 2 %: timestep 0.001, "
        "error 1.5 % at x2 work. Allow more with --max-cpu."
    )
    told = sentence_of(report.model_copy(update=missed))
    assert told.endswith(
        "No tested setting meets the target of 2 % on fresh seeds as well. Closest: timestep "
        "0.001, error 1.5 % at x2 work; limiting factor: the ball."
    )
    # A model beyond the tolerance is told to be so, with what may keep that.
    now = now.model_copy(update={"error": 0.5})
    missed = {**missed, "current": now, "candidates": (now, near)}
    told = sentence_of(report.model_copy(update={**missed, "not_changed": kept}))
    assert told.count("No time was left") == 1
    missed = {**missed, "closest": None}
    told = sentence_of(report.model_copy(update={**missed, "not_changed": kept}))
    assert told == (
        "Numerical error is 50 %, above the tolerance of 10 %. No time was left to "
        "verify a candidate that may be within the tolerance: timestep 0.001, x2 work. "
        "Allow more with --max-cpu."
    )
    told = sentence_of(report.model_copy(update=missed))
    assert told == (
        "Numerical error is 50 %, above the tolerance of 10 %, and no tested setting that is "
        "numerically accurate is within it."
    )


def test_headline_target_and_table_have_one_error_of_the_model_as_written(
    asked: TuneRequest, tmp_path: Path
) -> None:
    """An estimate of the search is printed nowhere, even if a report has one."""
    report = found(asked, tmp_path)
    assert report
    now = report.current.model_copy(update={"error": 0.0731})
    point = FrontPoint(
        number=1, name="Euler 2 ms", marks=("as written",), candidate=now, error=0.0602,
        error_low=0.05, error_high=0.07, error_seeds=12, real_time=1.0, state="as written",
        verification="", changed_settings=(), verified=None, file=None,
    )  # fmt: skip
    judged = CurrentVerdict(seeds=(0, 1, 2), verdict="ok", numerical_error=0.0621)
    target = report.target.model_copy(update={"kind": "as written", "limit": 0.0731})
    report = report.model_copy(
        update={
            "current": now, "recommended": None, "front": (point,), "candidates": (now,),
            "current_verdict": judged, "target": target,
        }
    )  # fmt: skip
    report = report.model_copy(update={"sentence": sentence_of(report)})
    text = render_text(describe_tuning(report))
    assert text.count("6 %") == 3
    assert "7.3 %" not in text
    assert "6.2 %" not in text


def test_a_time_within_noise_is_said_to_be_that(asked: TuneRequest, tmp_path: Path) -> None:
    report = found(asked, tmp_path)
    assert report
    verified = Verification(
        seeds=(3, 4, 5), holds=True, meets_target=True, error=None, current_error=None,
        verdict="ok", numerical_error=0.01, labels=(), sentence="nothing worse",
    )  # fmt: skip
    told = list[str]()
    for high in (1.02, 0.98):
        ratio = TimeRatio.of(0.95, 0.9, high)
        best = report.current.model_copy(update={"cost": 0.94, "time_ratio": ratio, "exact": True})
        told.append(
            sentence_of(report.model_copy(update={"recommended": best, "verified": verified}))
        )
    assert told == [
        (
            "Recommended: x0.94 work, x0.95 (0.90 to 1.02) time, which is within noise, the same "
            "motion."
        ),
        "Recommended: x0.95 (0.90 to 0.98) time, the same motion.",
    ]
