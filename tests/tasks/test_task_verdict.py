"""Studies of one model judge one task: by phases, by watched bodies, and by its share."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import contactlab
from contactlab.budget import ErrorBudget
from contactlab.budget.readings import Origin, PhaseBudget, Reading
from contactlab.errors import EngineError, SweepFileError
from contactlab.schema.evidence import LabelEntry
from contactlab.schema.examination import Examination
from contactlab.schema.task import Phase, Task
from contactlab.tasks.task_verdict import run_labels, verdict_of

NUMERIC = "step_dependent"
# A pendulum beside one whose spring swings ten times in a second, both driven by sines.
MODEL = """<mujoco><option timestep="{timestep}"/><worldbody>
<body name="slow" pos="0 0 1"><joint name="slow" axis="0 1 0" damping=".05"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1" contype="0" conaffinity="0"/></body>
<body name="fast" pos="0 1 1"><joint name="fast" type="slide" stiffness="{stiffness}"/>
<geom size=".05" mass="1" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor joint="slow" ctrlrange="-1 1"/><motor joint="fast" ctrlrange="-1 1" gear="20"/>
</actuator></mujoco>"""


def written(folder: Path, timestep: float = 0.005, stiffness: float = 4e3) -> str:
    path = folder / "two.xml"
    path.write_text(MODEL.format(timestep=timestep, stiffness=stiffness))
    return str(path)


@pytest.mark.long
def test_watched_bodies_and_the_share_decide(tmp_path: Path) -> None:
    """Euler with h w = .32 in the spring, and .03 in the pendulum, whose share is the smaller."""
    model = written(tmp_path)

    def checked(**task: Any) -> Examination:
        folder = tmp_path / "check"
        return contactlab.examine(
            model, check=["task"], workers=0, output=folder, duration="1.5s", **task
        )

    whole, slow = checked(), checked(observe=["slow"])
    assert whole.task_verdict
    assert slow.task_verdict
    shares = [
        max(phase.numerical_error or 0 for phase in x.phases)
        for x in (whole.task_verdict, slow.task_verdict)
    ]
    assert {phase.body for phase in slow.task_verdict.phases} == {"slow"}
    assert shares[1] < shares[0]
    between = f"{50 * sum(shares):.6g}%"
    assert not checked(tolerance=[between], seeds=3).passed
    assert checked(tolerance=[between], observe=["slow"], seeds=3).passed
    with pytest.raises(EngineError, match="no observed body moves"):
        checked(observe=["world"])


@pytest.mark.parametrize(
    ("watched", "kept"),
    [
        ((), ["tunneling", "chatter", "diverged"]),
        (("mug",), ["tunneling", "diverged"]),
        (("lid", "hand"), ["tunneling", "chatter", "diverged"]),
        (("foot",), ["diverged"]),
    ],
)
def test_labels_are_of_watched_bodies_or_of_the_whole_run(
    watched: tuple[str, ...], kept: list[str]
) -> None:
    labels = (
        LabelEntry(label="tunneling", reason="it passed", step=3, bodies=("mug", "hand")),
        LabelEntry(label="chatter", reason="lid-mug chatters", step=4, bodies=("lid",)),
        LabelEntry(label="diverged", reason="a warning", step=5),
    )
    record: Any = SimpleNamespace(duration=1.0, steps_asked=10, seed=0, labels=labels)
    phases = (Phase(name="held", begin=0.0, end=1.0),)
    task = Task(
        start="home", drive="hold", own_controls=True, duration=1.0, phases=phases, observed=watched
    )
    found = run_labels(task, [record])
    assert [label.label for label in found] == kept
    # What the reason names is not said again.
    wheres = {label.label: label.where for label in found}
    assert wheres.get("tunneling", " of mug, hand") == " of mug, hand"
    assert wheres.get("chatter", "") == wheres["diverged"] == ""


@pytest.mark.parametrize(("mean", "kept"), [(0.09, ["chatter"]), (0.11, ["chatter", NUMERIC])])
def test_a_dependence_on_the_step_is_of_all_seeds_together(mean: float, kept: list[str]) -> None:
    """One of the seeds may be above the tolerance that their mean is within."""
    entries = (LabelEntry(label=name, reason="seen", step=0) for name in ("chatter", NUMERIC))
    record: Any = SimpleNamespace(duration=1.0, steps_asked=10, seed=1, labels=tuple(entries))
    phases = (Phase(name="held", begin=0.0, end=1.0),)
    task = Task(start="home", drive="hold", own_controls=True, duration=1.0, phases=phases)
    budget = ErrorBudget((phase_budget("held", mean, "mug"),))
    assert [label.label for label in run_labels(task, [record], budget)] == kept
    assert [label.label for label in run_labels(task, [record])] == ["chatter", NUMERIC]


def phase_budget(name: str, error: float, body: str) -> PhaseBudget:
    """Return the budget of a phase whose worst body of two is the one that is named."""
    errors = np.array([error, error / 2])
    run = Reading("numerical error", "the run", "numerics", True, errors, seeds=errors[:1])
    return PhaseBudget(
        name, 0.01, 100, 0.04, 25, (body, "other"), np.ones(2), run, (), np.zeros(1), np.zeros(1),
        Origin(body, "", 0.0), np.zeros(2), 0.0, error, 1.0, 0.0, (),
    )  # fmt: skip


@pytest.mark.parametrize("errors", [(0.02, 0.3), (0.3, 0.02), (0.03, 0.02), (0.02, 0.03)])
def test_the_worst_phase_gives_the_verdict(errors: tuple[float, float]) -> None:
    """Its number, body and name stand in the sentence, wherever it is among the phases."""
    phases = (Phase(name="rest", begin=0, end=1), Phase(name="excitation", begin=1, end=2))
    task = Task(start="home", drive="hold", own_controls=True, duration=2.0, phases=phases)
    parts = [
        phase_budget(phase.name, error, body)
        for phase, error, body in zip(phases, errors, ("foot", "torso"), strict=True)
    ]
    found = verdict_of(task, ErrorBudget(tuple(parts)), [])
    worst = errors.index(max(errors))
    assert found.verdict == ("inaccurate" if max(errors) > task.tolerance else "ok")
    assert f"{100 * max(errors):g} %" in found.sentence
    assert f"in {('foot', 'torso')[worst]}, {phases[worst].name}" in found.sentence
    assert [phase.numerical_error for phase in found.phases] == [*errors]
    assert [phase.body for phase in found.phases] == ["foot", "torso"]


@pytest.mark.parametrize("rest", [0.02, 0.3])
def test_numerics_cause_no_label_of_a_phase_in_which_they_are_accurate(rest: float) -> None:
    """A run's own numerical error is that of its worst phase, which may be another one."""
    caused = "energy rose by 33 %; cause: the numerics (numerical error 30 % in torso)"
    other = "it passed; cause: the model (numerical error 1 % in mug)"
    labels = (
        LabelEntry(label="energy_injection", reason=caused, step=3),
        LabelEntry(label="chatter", reason=caused, step=150),
        LabelEntry(label="tunneling", reason=other, step=4),
    )
    record: Any = SimpleNamespace(duration=2.0, steps_asked=200, seed=0, labels=labels)
    phases = (Phase(name="rest", begin=0, end=1), Phase(name="excitation", begin=1, end=2))
    task = Task(start="home", drive="hold", own_controls=True, duration=2.0, phases=phases)
    budget = ErrorBudget(
        (phase_budget("rest", rest, "foot"), phase_budget("excitation", 0.3, "torso"))
    )
    found = {label.label: label.reason for label in run_labels(task, [record], budget)}
    assert found["chatter"] == caused
    assert found["tunneling"] == other
    accurate = "energy rose by 33 %; cause: the model (numerical error 2 % in foot)"
    assert found["energy_injection"] == (accurate if rest <= task.tolerance else caused)


def test_a_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SweepFileError, match="share of the real forces"):
        contactlab.examine(written(tmp_path), section=["checks"], tolerance="1mm")
