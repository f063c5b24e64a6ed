"""How long verdicts take, by what is judged."""

import copy
from types import SimpleNamespace
from typing import Any

import mujoco
import pytest

from contactlab.scene.task import infer_task
from contactlab.studies.search.configuration import Configuration
from contactlab.studies.search.reference_error import ErrorEstimate
from contactlab.studies.search.settings_search import Evaluation
from contactlab.studies.search.verification import (
    CandidateVerifier,
    FailureBound,
    evaluations_per_step,
    step_fraction,
)

EULER = mujoco.MjModel.from_xml_string("<mujoco/>")


def test_a_verdict_of_rk4_evaluates_forces_four_times_a_step() -> None:
    """A run and references at h/4 and h/8, 13 in all; others are held to RK4 at h/2, too."""
    rk4 = copy.copy(EULER)
    rk4.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    assert evaluations_per_step(rk4) == pytest.approx(4 * (1 + 4 + 8))
    assert evaluations_per_step(EULER) == pytest.approx(1 + 4 + 8 + 4 * 2)


@pytest.mark.parametrize("ladder", [0.25, 0.02, 5.0])
def test_what_failed_is_followed_by_steps_that_hold_in_first_order(ladder: float) -> None:
    """An error of `ladder` a step keeps a limit of 0.1 after one more verdict, not after many."""
    step, limit, verdicts = 10.0, 0.1, 0
    while ladder * step > limit:
        step *= step_fraction(ladder * step, limit)
        verdicts += 1
    assert verdicts <= 1 + (0.6 < limit / (ladder * 10.0) < 1)
    # Nothing that the judge told no share of, or that failed within its limit, is tried unchanged.
    assert step_fraction(None, limit) == step_fraction(0.05, limit) < 1


def _tried(multiple: int, share: float, integrator: str = "RK4") -> Evaluation:
    error = ErrorEstimate(share, "body", "phase", 0.0, share, share)
    return Evaluation(Configuration({"integrator": integrator}, multiple), error)


def test_no_step_is_tried_again_that_was_too_long_for_its_integrator() -> None:
    """Where errors fall fast with steps, a smaller one is no reason for a step that failed."""
    below = FailureBound().tightened_by(_tried(25, 0.03), 0.6)
    assert not below.admits(_tried(25, 0.01))
    assert not below.admits(_tried(28, 0.01))
    assert below.admits(_tried(24, 0.018))
    assert below.admits(_tried(15, 0.03))
    assert not below.admits(_tried(24, 0.02))
    # Of another integrator, only the last one that failed tells.
    after = below.tightened_by(_tried(6, 0.1, "Euler"), 0.6)
    assert not after.admits(_tried(28, 0.046))
    assert after.admits(_tried(24, 0.046))
    assert after.admits(_tried(28, 0.046, "implicit"))


@pytest.mark.parametrize(
    ("left", "written", "labels", "unseen"),
    [
        (1e6, {}, ["tunneling"], False),
        (1e6, {1: {"tunneling"}}, [], False),
        (-1.0, {}, [], True),
    ],
    ids=["of one seed of the task", "as the model as written", "no time"],
)
def test_labels_are_looked_for_on_the_seeds_that_the_written_file_is_judged_by(
    monkeypatch: pytest.MonkeyPatch,
    left: float,
    written: dict[int, set[str]],
    labels: list[str],
    unseen: bool,
) -> None:
    """No label on the fresh seed 3, and one on seed 1, which `contactlab FILE` has in its task."""
    task = infer_task(EULER)
    of: dict[str, dict[int, set[str]]] = {"now": written, "new": {1: {"tunneling"}}}

    def seen(_: CandidateVerifier, examined: Any, task: Any) -> set[str]:
        return {label for seed in task.seeds for label in of[examined.name].get(seed, ())}

    monkeypatch.setattr(CandidateVerifier, "_run_labels", seen)
    now = SimpleNamespace(name="now", task=task)
    verifier = CandidateVerifier.__new__(CandidateVerifier)
    vars(verifier).update(
        _problem=SimpleNamespace(examined=now),
        _time_limit=SimpleNamespace(remaining=left),
        _current_labels={},
    )
    fresh = task.model_copy(update={"seeds": (3,)})
    new: Any = SimpleNamespace(name="new")
    found, told = verifier._new_labels(new, fresh)  # pyright: ignore[reportPrivateUsage]
    assert found == labels
    assert bool(told) == unseen
