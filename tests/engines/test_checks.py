"""The second pass: silent on sound runs, and each check finds the fault planted for it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Trace
from contactlab.contact.trace_setup import Setup
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene

Run = tuple[PreparedRuns, Trace, Setup]
MUJOCO = MujocoEngine()


def simulated(name: str, **values: Any) -> Run:
    scene = Scene.open(name)
    run = scene.resolve(values, 0, 0.6)
    runs = PreparedRuns.of(scene, run)
    trace = make_trace(runs.base, runs.prepared, MUJOCO.roll_out(runs, Buffers()))
    return runs, trace, make_setup(runs.base, scene.source.manifest, [run], runs.models, {})


def labels(run: Run) -> list[str]:
    runs, trace, setup = run
    found = assess_runs(trace, setup, MUJOCO.check_runs(runs, trace))
    return [outcome.label for outcome in found.labels[0]]


@pytest.fixture(scope="module")
def stack() -> Run:
    return simulated("box_stack", boxes=3)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("solver", ["Newton", "CG", "PGS"])
def test_a_sound_run_contradicts_itself_nowhere(cone: str, solver: str) -> None:
    runs, trace, _ = simulated("box_stack", boxes=3, cone=cone, solver=solver)
    checks = MUJOCO.check_runs(runs, trace)
    assert checks.repeats.all()
    # Both Jacobians solve the same problem to 1e-12 of its cost, which is quadratic in forces.
    assert checks.jacobian.max() < 1e-6
    assert checks.overlap.max() == 0
    assert checks.apart.max() == 0


def test_a_hit_of_the_limit_alone_is_no_failure() -> None:
    run = simulated("box_stack", boxes=3, iterations=1)
    assert (run[1].iterations_most[0] >= 1).mean() > 0.5
    assert "solver_nonconvergence" not in labels(run)


def test_a_solver_that_is_not_done_is_named() -> None:
    assert labels(simulated("box_stack", boxes=3, solver="PGS", iterations=3))[0] in {
        "solver_nonconvergence",
        "solver_inconsistent",
    }


def test_another_trajectory_is_found(stack: Run) -> None:
    trace = replace(stack[1], qpos=stack[1].qpos.copy())
    trace.qpos[0, 200, 0] = np.nextafter(trace.qpos[0, 200, 0], 1)
    assert labels((stack[0], trace, stack[2])) == ["solver_inconsistent"]


def test_an_overlap_without_contact_is_found(stack: Run) -> None:
    pairs = [replace(pair, slots=pair.slots.copy()) for pair in stack[1].pairs]
    pairs[1].slots[:] = 0
    trace = replace(stack[1], pairs=tuple(pairs))
    assert "missed_contact" in labels((stack[0], trace, stack[2]))


def test_a_contact_of_bodies_that_are_apart_is_found(stack: Run) -> None:
    trace = replace(stack[1], qpos=stack[1].qpos.copy())
    trace.qpos[0, :, 2] += 0.01
    assert "phantom_contact" in labels((stack[0], trace, stack[2]))


def test_a_wrong_hessian_would_show(stack: Run) -> None:
    """What a defect of the sparse factorisation looks like: dense and sparse disagree."""
    runs, trace, setup = stack
    checks = MUJOCO.check_runs(runs, trace)
    checks.jacobian[0, 5] = 0.2
    found = assess_runs(trace, setup, checks).labels[0][0]
    assert found.label == "solver_inconsistent"
    assert found.step == checks.jacobian_steps[5]
