"""The second pass: silent on sound runs, and each check finds the fault planted for it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.trace_arrays import Trace
from contactlab.contact.trace_setup import Setup
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs
from contactlab.scene.equation_error import measure_equation_error
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene

Run = tuple[PreparedRuns, Trace, Setup]
MUJOCO = MujocoEngine()


def simulated(name: str, seconds: float = 0.6, **values: Any) -> Run:
    scene = Scene.open(name)
    run = scene.resolve(values, 0, seconds)
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
    # PGS may not solve an impact in either form, which then decides nothing.
    assert np.nanmax(checks.jacobian) == 0
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


def branching_tree(seed: int, jacobian: str) -> str:
    """Return a random tree of 70 capsules on a floor; 4.0.0 may factor its sparse Hessian wrong."""
    random, children = np.random.default_rng(seed), [list[int]() for _ in range(70)]
    for body in range(1, 70):
        children[int(random.integers(max(0, body - 8), body))].append(body)

    def write_body(body: int) -> str:
        axis = "1 0 0" if body % 3 else "0 1 0"
        joint = f'<joint axis="{axis}" damping=".05"/>' if body else "<freejoint/>"
        place = f"{0.11 if body else 0} {random.uniform(-0.04, 0.04):.3f} {0 if body else 0.1}"
        shape = '<geom type="capsule" fromto="0 0 0 .1 0 0" size=".015"/>'
        inner = "".join(map(write_body, children[body]))
        return f'<body pos="{place}">{joint}{shape}{inner}</body>'

    option = f'<option timestep=".002" integrator="implicitfast" jacobian="{jacobian}"/>'
    floor = '<geom type="plane" size="5 5 .1"/>'
    return f"<mujoco>{option}<worldbody>{floor}{write_body(0)}</worldbody></mujoco>"


@pytest.mark.parametrize("seed", [pytest.param(10, marks=pytest.mark.long), 20])
@pytest.mark.parametrize("jacobian", ["auto", "dense"])
def test_a_wrong_factor_counts_for_the_form_in_use_alone(
    tmp_path: Path, seed: int, jacobian: str
) -> None:
    path = tmp_path / "tree.xml"
    path.write_text(branching_tree(seed, jacobian))
    runs, trace, _ = simulated(str(path), seconds=0.2)
    error = MUJOCO.check_runs(runs, trace).jacobian.max()
    # A right factor takes few iterations from step to step.
    stuck = trace.iterations_most.max() >= runs.models[0].opt.iterations
    assert (error > 0.1) == stuck
    assert jacobian == "auto" or not stuck


def test_the_equation_of_motion_is_solved_by_its_own_solution_alone(stack: Run) -> None:
    model, data = stack[0].models[0], mujoco.MjData(stack[0].models[0])
    data.qpos[:] = stack[1].qpos[0, -1]
    mujoco.mj_forward(model, data)
    assert measure_equation_error(model, data) < 1e-6
    # A change of one acceleration leaves its inertia times that change, beyond contact forces.
    change = 1e-3 * np.abs(data.qfrc_smooth).max() / model.dof_M0[0]
    data.qacc[0] += change
    assert measure_equation_error(model, data) > 1e-5


def test_a_wrong_hessian_would_show(stack: Run) -> None:
    """A defect of the sparse factorization gives accelerations that the other form contradicts."""
    runs, trace, setup = stack
    checks = MUJOCO.check_runs(runs, trace)
    checks.jacobian[0, 2] = 0.2
    found = assess_runs(trace, setup, checks).labels[0][0]
    assert found.label == "solver_inconsistent"
    assert found.step == checks.jacobian_steps[0, 2]
