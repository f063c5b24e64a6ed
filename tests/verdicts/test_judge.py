"""Every model gets a row: a label, or a word for why it has none."""

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.verdicts.corpus import FOLDER, read_part
from tests.verdicts.judge import NO_MODEL, SOUND, Job, judged

pytestmark = pytest.mark.long

Write = Callable[..., Job]
CASES = read_part(FOLDER / "open").cases
FOUND = "a piston that passes a resting ball"
STILL = "<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>"
# Two million sweeps of a solver over 80 contacts: no machine does them in the time below.
ENDLESS = """<mujoco><option timestep="1e-4" solver="PGS" iterations="1000" tolerance="0"/>
<worldbody><geom type="plane" size="1 1 1"/><replicate count="20" offset="0 0 .2">
<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body></replicate>
</worldbody></mujoco>"""


@pytest.fixture
def written(tmp_path: Path) -> Write:
    def write(name: str, text: str, duration: float, drive: str = "none") -> Job:
        path = tmp_path / f"{name}.xml"
        path.write_text(text, encoding="utf-8")
        return Job(name, path, duration, drive)

    return write


def test_failing_model_and_its_twin_are_told_apart(written: Write) -> None:
    case = next(case for case in CASES if case.name == FOUND)
    jobs = [
        written(str(healthy), case.text(healthy=healthy), case.duration)
        for healthy in (False, True)
    ]
    labels = {job.name: verdict.label for job, verdict in judged(jobs, workers=2, seconds=60)}
    assert labels["True"] == SOUND != labels["False"]


def test_model_that_has_no_verdict_has_a_row(written: Write) -> None:
    jobs = [
        written("nonsense", "<mujoco>", 0.1),
        written("still", STILL, 0.1),
        written("driven by nobody", CASES[0].text(healthy=True), 0.1, "what"),
    ]
    labels = {job.name: verdict.label for job, verdict in judged(jobs, workers=2, seconds=60)}
    assert labels == {"nonsense": NO_MODEL, "still": NO_MODEL, "driven by nobody": "refused"}


def test_slow_model_costs_no_more_than_its_time(written: Write) -> None:
    [(_, verdict)] = judged([written("endless", ENDLESS, 0.2)], workers=1, seconds=5.0)
    assert verdict.label == "too slow"
