"""Plain MuJoCo shows a planted cause in its row, and no cause where there is none."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from bench.atlas.confirm import REST, Case, load, nearer, shown, started
from bench.atlas.confirming import write_inputs

from contactlab.budget.motion import INTEGRATION
from contactlab.run.sweep_request import SceneLoader
from contactlab.tasks.task_motions import task_motions

# It swings with 20 rad/s: a step of 40 ms is an eighth of a period.
SPRING = """<mujoco><option timestep="{step}" integrator="{integrator}"/>
<worldbody><body name="bob"><joint type="slide" axis="1 0 0" stiffness="400" springref=".1"/>
<geom size=".05" mass="1"/></body></worldbody></mujoco>"""
SERVO = """<mujoco><worldbody><body name="arm"><joint name="j" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body></worldbody>
<actuator><position joint="j" kp="5" ctrlrange="-1 1"/></actuator></mujoco>"""
# A quarter of the angle that friction can hold.
SLOPE = """<mujoco><option timestep=".01" gravity="2.45 0 -9.49" cone="elliptic"/><worldbody>
<geom type="plane" size="5 5 1" friction="1"/><body name="box" pos="0 0 .05"><freejoint/>
<geom type="box" size=".05 .05 .05" friction="1"/></body></worldbody></mujoco>"""


def found(folder: Path, text: str, row: str, body: str, *, held: bool = False) -> tuple[bool, str]:
    file = folder / "model.xml"
    file.write_text(text)
    return shown(file, Case(row, body, "qpos0", held=held, seed=0))


@pytest.mark.long
def test_a_coarse_step_shows_and_a_fine_one_does_not(tmp_path: Path) -> None:
    coarse = SPRING.format(step=0.04, integrator="Euler")
    fine = SPRING.format(step=0.01, integrator="RK4")
    assert found(tmp_path, coarse, "run", "bob")[0]
    assert not found(tmp_path, fine, "run", "bob")[0]


def test_a_box_that_creeps_down_a_slope_is_shown_in_the_row_of_noslip(tmp_path: Path) -> None:
    def creep(text: str) -> float:
        return float(found(tmp_path, text, "noslip", "box", held=True)[1].split()[-4])

    assert creep(SLOPE) > 20 * creep(SLOPE.replace("2.45 0", "0 0"))


def test_a_warning_of_the_engine_is_shown(tmp_path: Path) -> None:
    servo = """<mujoco><option timestep=".02"/><worldbody><body><joint name="j"/>
    <geom size=".01"/></body></worldbody><actuator><position joint="j" kp="1e5"
    ctrlrange="-1 1" ctrllimited="true"/></actuator></mujoco>"""
    holds, text = found(tmp_path, servo, "warning", "body[1]")
    assert holds
    assert "QACC" in text


@pytest.mark.long
def test_a_loss_is_no_gain(tmp_path: Path) -> None:
    """RK4 at an angle of 1 a step keeps 1 - 1/72 + 1/576 of the energy in each."""
    text = SPRING.format(step=0.05, integrator="RK4")
    assert found(tmp_path, text, "loss", "bob", held=True)[0]
    assert not found(tmp_path, text, "gain", "bob", held=True)[0]


def test_a_solver_that_may_not_go_on_leaves_forces_and_accelerations_apart(tmp_path: Path) -> None:
    def text(iterations: int) -> str:
        bodies = "".join(
            f"""<body pos="0 0 {0.1 * height + 0.05}"><freejoint/>
            <geom type="box" size=".05 .05 .05"/></body>"""
            for height in range(4)
        )
        return f"""<mujoco><option solver="PGS" iterations="{iterations}" timestep=".01"/>
        <worldbody><geom type="plane" size="5 5 1"/>{bodies}</worldbody></mujoco>"""

    assert found(tmp_path, text(1), "iterations", "")[0]
    assert not found(tmp_path, text(2000), "iterations", "")[0]


@pytest.mark.long
def test_a_body_without_a_name_is_asked_for_by_its_number(tmp_path: Path) -> None:
    text = SPRING.format(step=0.04, integrator="Euler")
    named = found(tmp_path, text, "run", "bob")[1].partition(": ")[2]
    assert found(tmp_path, text, "run", "body[1]")[1].partition(": ")[2] == named


def test_the_controls_of_a_task_move_plain_mujoco_as_they_move_the_task(tmp_path: Path) -> None:
    file, stored = tmp_path / "servo.xml", tmp_path / "inputs.npz"
    file.write_text(SERVO)
    write_inputs(file, stored)
    scene = SceneLoader(Path()).open(str(file)).with_effects("all")
    last = task_motions(scene, {}, scene.task({}, None))[-1]
    model = load(file)
    data, drive = started(model, Case("run", "arm", "qpos0", held=False, seed=0, inputs=stored))
    while data.time < REST - 1e-9:
        drive(data, data.time)
        mujoco.mj_step(model, data)
    state = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, state, INTEGRATION)
    positions = slice(1, 1 + model.nq + model.nv)
    assert np.allclose(state[positions], last.starts[0, positions], rtol=0, atol=1e-12)


def test_the_limit_that_gives_way_and_the_deepest_contact_are_named(tmp_path: Path) -> None:
    assert not found(tmp_path, SLOPE, "depth", "")[0]
    sunk = SLOPE.replace('pos="0 0 .05"', 'pos="0 0 -.02"')
    assert "contact world - box, 140 %" in found(tmp_path, sunk, "depth", "")[1]
    beyond = SPRING.format(step=0.01, integrator="RK4").replace(
        'springref=".1"', 'springref="1" range="-.01 .01" limited="true" solreflimit="1 1"'
    )
    holds, text = found(tmp_path, beyond, "limit", "")
    assert holds
    assert text.startswith("joint 0")


@pytest.mark.long
def test_a_finer_step_is_nearer_to_the_finest_and_a_coarser_one_is_not(tmp_path: Path) -> None:
    """Euler's error of a window is of first order: half the step has half, within a fifth."""
    files = {step: tmp_path / f"{step}.xml" for step in (0.02, 0.01)}
    for step, file in files.items():
        file.write_text(SPRING.format(step=step, integrator="Euler"))
    case = Case("run", "", "qpos0", held=False, seed=0)
    holds, text = nearer(files[0.02], files[0.01], case)
    before, after = (float(word) for word in re.findall(r"[\d.]+(?= %)", text))
    assert holds
    assert 0.4 < after / before < 0.6
    assert not nearer(files[0.02], files[0.02], case)[0]
