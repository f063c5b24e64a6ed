"""Every model gets a row: a label, or a word for why it has none."""

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.verdicts.cases import CASES
from tests.verdicts.judge import NO_MODEL, SOUND, Job, judged

Write = Callable[[str, str, float], Job]
FOUND = "a piston that passes a resting ball"
STILL = "<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>"
# Two million sweeps of a solver over 80 contacts: no machine does them in the time below.
ENDLESS = (
    "<mujoco><option timestep='1e-4' solver='PGS' iterations='1000' tolerance='0'/>"
    "<worldbody><geom type='plane' size='1 1 1'/>"
    + "".join(
        f"<body pos='0 0 {0.1 + 0.2 * k}'><freejoint/><geom type='box' size='.1 .1 .1'/></body>"
        for k in range(20)
    )
    + "</worldbody></mujoco>"
)


@pytest.fixture
def written(tmp_path: Path) -> Write:
    def write(name: str, text: str, duration: float) -> Job:
        path = tmp_path / f"{name}.xml"
        path.write_text(text, encoding="utf-8")
        return Job(name, path, duration, ("none",))

    return write


def test_failing_model_and_its_twin_are_told_apart(written: Write) -> None:
    case = next(case for case in CASES if case.name == FOUND)
    jobs = [
        written(str(healthy), case.text(healthy=healthy), case.duration)
        for healthy in (False, True)
    ]
    labels = {job.name: verdicts[0].label for job, verdicts in judged(jobs, workers=2, seconds=60)}
    assert labels["True"] == SOUND != labels["False"]


def test_model_that_has_no_verdict_has_a_row(written: Write) -> None:
    jobs = [
        written("nonsense", "<mujoco>", 0.1),
        written("still", STILL, 0.1),
        Job(
            "two drives",
            written("box", CASES[0].text(healthy=True), 0.1).path,
            0.1,
            ("none", "what"),
        ),
    ]
    found = {job.name: verdicts for job, verdicts in judged(jobs, workers=2, seconds=60)}
    assert [each.label for each in found["nonsense"]] == [NO_MODEL]
    assert [each.label for each in found["still"]] == [NO_MODEL]
    assert [each.label for each in found["two drives"]] == [SOUND, "refused"]


def test_slow_model_costs_no_more_than_its_time(written: Write) -> None:
    jobs = [written("endless", ENDLESS, 0.2)]
    [(_, verdicts)] = judged(jobs, workers=1, seconds=1.0)
    assert [each.label for each in verdicts] == ["too slow"]
