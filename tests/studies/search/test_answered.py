"""What was asked before is not searched again, and anything else is."""

from dataclasses import replace
from pathlib import Path

import pytest

from contactlab.plan.task_options import read_task_options
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.tune_report import REPORT, Aim, Kept, Point, TuneReport
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.search.answered import answered
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.wording import UNJUDGED, sentence_of, unsaved
from contactlab.studies.session import Session

BALL = """<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
TASK = read_task_options(drive="none", duration="0.1s")


@pytest.fixture
def asked(tmp_path: Path) -> TuneRequest:
    """A question, whose answer lies in `before`, with the model that was written."""
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    request = TuneRequest(str(path), TASK, error=0.02)
    opened = ExamineRequest(str(path), task=TASK, sections=("budget",))
    examined = open_model(opened, Session(tmp_path))
    now = Point(
        settings={},
        timestep=0.002,
        lighter=False,
        apart=False,
        hulls=False,
        error=0.01,
        low=0.01,
        high=0.01,
        body="body[1]",
        phase="free",
        time=0.0,
        price=None,
    )
    report = TuneReport(
        model=str(path),
        scene_hash=examined.scene.hash,
        mujoco=VERSION,
        task=examined.task,
        aim=Aim(
            kind="error",
            limit=0.02,
            unit="1",
            within=0.1,
            uncertain=None,
            uncertain_by="",
            real_time=None,
            watched=(),
            at=None,
            growth="",
        ),
        sentence="an answer",
        met=True,
        now=now,
        judged=None,
        recommended=now,
        to_aim=None,
        stayed_apart=None,
        fewer_vertices=None,
        nearest=None,
        binds="",
        bare=None,
        as_accurate=None,
        real_time=1.0,
        fine_step=0.001,
        points=(now,),
        changes=(),
        masked=(),
        excluded=(),
        sensors=(),
        flags=(),
        kept=(),
        verified=None,
        file="tuned/tuned.xml",
        lines=(),
        ended=False,
        seconds=1.0,
    )
    written = tmp_path / "before" / "tuned" / "tuned.xml"
    written.parent.mkdir(parents=True)
    written.write_text(BALL)
    (tmp_path / "before" / REPORT).write_text(report.model_dump_json())
    return request


def found(request: TuneRequest, folder: Path) -> TuneReport | None:
    return answered(request, Session(folder / "out"), (folder / "none", folder / "before"))


def test_the_answer_to_the_same_question_is_copied_with_its_model(
    asked: TuneRequest, tmp_path: Path
) -> None:
    report = found(asked, tmp_path)
    assert report
    assert report.sentence == "an answer"
    out = tmp_path / "out"
    assert (out / "tuned" / "tuned.xml").read_text() == BALL
    assert TuneReport.model_validate_json((out / REPORT).read_text()) == report
    # In its own folder it stays as it is.
    again = answered(asked, Session(out), (out,))
    assert again == report


@pytest.mark.parametrize(
    "change",
    [
        {"error": 0.03},
        {"error": None},
        {"real_time": 5.0, "error": None},
        {"drop_sensors": True},
        {"apart": 0.05},
        {"hulls": 0.001},
        {"task": read_task_options(drive="none", duration="0.2s")},
        {"task": read_task_options(drive="none", duration="0.1s", tolerance=["1%"])},
    ],
)
def test_another_question_is_searched(
    asked: TuneRequest, change: dict[str, object], tmp_path: Path
) -> None:
    assert found(replace(asked, **change), tmp_path) is None  # pyright: ignore[reportArgumentType]
    assert not (tmp_path / "out").exists()


def test_another_model_and_lost_files_and_short_times_are_no_answer(
    asked: TuneRequest, tmp_path: Path
) -> None:
    path, before = Path(asked.model), tmp_path / "before"
    path.write_text(BALL.replace('".1"', '".2"'))
    assert found(asked, tmp_path) is None
    path.write_text(BALL)
    stored = (before / REPORT).read_text()
    (before / REPORT).write_text(stored.replace('"ended":false', '"ended":true'))
    assert found(asked, tmp_path) is None
    (before / REPORT).write_text(stored)
    (before / "tuned" / "tuned.xml").unlink()
    assert found(asked, tmp_path) is None


def test_what_saves_no_fifth_is_told_with_what_there_is_to_save(
    asked: TuneRequest, tmp_path: Path
) -> None:
    """The cheapest as accurate at the own step, and the longer step that is not."""
    report = found(asked, tmp_path)
    assert report
    assert not unsaved(report)
    price = BudgetPrice(ratio=0.5, low=0.4, high=0.6)
    off = BudgetPrice(ratio=0.93, low=0.9, high=0.95)
    own = report.now.model_copy(update={"settings": {"island": False}, "price": off})
    rough = own.model_copy(update={"settings": {"cone": "elliptic"}, "error": 0.03, "price": price})
    longer = report.now.model_copy(update={"timestep": 0.003, "error": 0.04})
    points = (report.now, own, rough, longer)
    assert unsaved(report.model_copy(update={"bare": price, "points": points})) == (
        "at its own step x0.50 without contacts and all other constraints, x0.93 at best "
        "(island off), the next longer that was tried, 0.003 s, has 4 %"
    )


def test_what_no_time_was_left_to_judge_is_not_told_to_be_kept(
    asked: TuneRequest, tmp_path: Path
) -> None:
    """Of what was tried, the fastest within the limit that did not fail before."""
    report = found(asked, tmp_path)
    assert report
    twin = BudgetPrice(ratio=1.0, low=0.98, high=1.02)
    now = report.now.model_copy(update={"price": twin})
    fast, faster, failed, rough = (
        now.model_copy(
            update={
                "timestep": step,
                "error": error,
                "price": BudgetPrice(ratio=ratio, low=ratio, high=ratio),
            }
        )
        for step, error, ratio in (
            (0.004, 0.01, 0.5),
            (0.008, 0.02, 0.25),
            (0.01, 0.02, 0.2),
            (0.02, 0.5, 0.1),
        )
    )
    ended = {"now": now, "recommended": None, "points": (now, fast, faster, failed, rough)}
    kept = (Kept(name="timestep 0.01", reason="on fresh seeds: tunneling"),)
    told = sentence_of(report.model_copy(update={**ended, "kept": kept}))
    assert told.startswith("keep it as it is")
    kept = (*kept, Kept(name="tuned", reason=UNJUDGED))
    assert sentence_of(report.model_copy(update={**ended, "kept": kept})) == (
        "error 1 %; no time was left to judge what may be faster: timestep 0.008, x0.25 (0.25 to "
        "0.25) of the time, error 2 %; give more with --max-time"
    )


def test_what_may_keep_the_aim_is_told_apart_from_what_failed(
    asked: TuneRequest, tmp_path: Path
) -> None:
    report = found(asked, tmp_path)
    assert report
    now = report.now.model_copy(update={"error": 0.05})
    near = now.model_copy(update={"timestep": 0.001, "error": 0.015})
    missed = {"now": now, "recommended": None, "nearest": near, "binds": "the ball"}
    kept = (Kept(name="to_aim", reason=UNJUDGED),)
    told = sentence_of(report.model_copy(update={**missed, "kept": kept}))
    assert told.endswith(
        "no time was left to judge what may keep 2 %: timestep 0.001, 1.5 %, not timed; give more "
        "with --max-time"
    )
    told = sentence_of(report.model_copy(update=missed))
    assert told.endswith(
        "nothing keeps 2 % on fresh seeds, too: nearest is timestep 0.001, 1.5 %, not timed; it "
        "binds the ball"
    )
    # A model beyond the tolerance is told to be so, with what may keep that.
    near = near.model_copy(update={"price": BudgetPrice(ratio=2.0, low=2.0, high=2.0)})
    now = now.model_copy(update={"error": 0.5})
    missed = {**missed, "now": now, "points": (now, near), "nearest": None}
    told = sentence_of(report.model_copy(update={**missed, "kept": kept}))
    assert told == (
        "its error as written, 50 %, is beyond 10 %; no time was left to judge what may keep that: "
        "timestep 0.001, x2.00 (2.00 to 2.00) of the time, error 1.5 %; give more with --max-time"
    )
    told = sentence_of(report.model_copy(update=missed))
    assert told == "its error as written, 50 %, is beyond 10 %, and nothing sound keeps that"
