"""No line that a proof gives changes a trajectory, whatever drove the runs that it was printed for.

Each proof is tried on the user's own model by plain MuJoCo, under controls up to twice their range.
"""

import copy
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.verdicts.public_models import moves, public_models

from contactlab.modifications.catalogue import list_features
from contactlab.resources import MODELS
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.drive.signals import control_ranges
from contactlab.scene.effects.effect import EffectState
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.schema.drive import read_drive

DRIVES = ("auto", "hold", "exercise", "noise=0.3,rate=10", "none")
_STEPS, _HELD = 200, 5
_WARNING = mujoco.mjtWarning
_BAD = [int(_WARNING.mjWARN_BADQPOS), int(_WARNING.mjWARN_BADQVEL), int(_WARNING.mjWARN_BADQACC)]
_ARM = """<mujoco><option {option}/><worldbody>{floor}
<body pos="0 0 .3"><joint name="upper" axis="0 1 0" {joint}/>
<geom type="capsule" size=".03" fromto="0 0 0 .25 0 0" mass="1"/>
<body pos=".3 0 0"><joint name="lower" axis="0 1 0" {joint}/>
<geom type="capsule" size=".03" fromto="0 0 0 .25 0 0" mass="1"/></body></body></worldbody>
<tendon><fixed name="sum"><joint joint="upper" coef="1"/><joint joint="lower" coef="1"/></fixed>
</tendon><actuator>{actuators}</actuator>{more}</mujoco>"""
_MOTORS = """<motor joint="upper" gear="20" ctrlrange="-1 1" ctrllimited="true"/>
<motor joint="lower" gear="9" ctrlrange="-1 1" ctrllimited="true"/>"""
_KINDS = """<velocity joint="upper" kv="3" ctrlrange="-2 2"/>
<general joint="lower" dyntype="filterexact" dynprm=".05" gainprm="9" ctrlrange="0 1"/>
<intvelocity joint="upper" kp="50" ctrlrange="-3 3" actrange="-1 1"/>
<muscle joint="lower" lengthrange="-1 1" ctrlrange="0 1"/>
<position tendon="sum" kp="20" ctrlrange="-.5 1" forcerange="-5 5"/>"""
_FLOOR = '<geom type="plane" size="1 1 1"/>'
_SQUEEZE = '<keyframe><key qpos=".2 -.4" ctrl="-.3 .7"/></keyframe>'
OWN = {
    # In each a drive that holds would once have written springs and cleared limits.
    "limited motors": {"actuators": _MOTORS},
    "motors of a keyframe": {"actuators": _MOTORS, "more": _SQUEEZE},
    "every kind": {"actuators": _KINDS, "floor": _FLOOR},
    "damped": {"actuators": _MOTORS, "joint": 'damping=".1" stiffness="2"'},
    "weightless": {"actuators": _MOTORS, "option": 'gravity="0 0 0" integrator="RK4"'},
    "no limits": {"actuators": '<motor joint="upper"/><motor joint="lower"/>', "floor": _FLOOR},
    "nothing moves it": {"actuators": ""},
}


def trajectory(model: mujoco.MjModel, keyframe: str, seed: int = 0) -> np.ndarray:
    """Return (T, nq + nv) states of plain MuJoCo under held random controls.

    They are zero from the step on at which the engine gives up and starts anew.
    """
    data = mujoco.MjData(model)
    if keyframe != "qpos0":
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    random = np.random.default_rng(seed)
    low, high = control_ranges(model).reshape(-1, 2).T
    states = np.zeros((_STEPS, model.nq + model.nv))
    for step in range(_STEPS):
        if step % _HELD == 0:
            # Twice as far from the middle as the range goes.
            share = random.uniform(-2, 2, model.nu)
            data.ctrl[:] = (low + high) / 2 + share * (high - low) / 2
        mujoco.mj_step(model, data)
        if data.warning.number[_BAD].any():
            break
        states[step] = np.concatenate([data.qpos, data.qvel])
    return states


def list_proofs(path: Path, drive: str) -> Iterator[tuple[str, str, mujoco.MjModel, str]]:
    """Yield unused effects that studies leave out, with their proof, the model, and its start."""
    scene = SceneLoader(Path(), read_drive(drive)).open(str(path))
    states = list[Mapping[str, EffectState]]()
    for rest in ("all", "auto"):
        own = scene.with_effects(rest)
        run = own.resolve({}, 0, None)
        states.append(own.prepare(run, own.initial_states([run])).effects)
    model = SceneLoader(Path()).open(str(path)).base({}).model
    for feature in list_features():
        written, proved = (state.get(feature.name) for state in states)
        if written and written.on and proved and not proved.on:
            yield feature.name, proved.reason, model, run.keyframe


def changed_by(path: Path, drives: tuple[str, ...] = DRIVES) -> tuple[int, list[str]]:
    """Return how many proofs there are of a model, and those whose line changes a trajectory.

    States that are infinite count as equal where both are.
    """
    lines = {line[0]: line for drive in drives for line in list_proofs(path, drive)}
    wrong: list[str] = []
    for name, proof, model, keyframe in lines.values():
        other = copy.copy(model)
        EFFECTS[name].switch.write(other, False)
        own, without = trajectory(model, keyframe), trajectory(other, keyframe)
        # Rounding aside: the order of sums may change where nothing else does.
        if not np.allclose(own, without, rtol=1e-9, atol=1e-9, equal_nan=True):
            wrong.append(f"{path.name}: {name} ({proof})")
    return len(lines), wrong


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", OWN)
def test_no_proof_of_a_driven_model_changes_it(kind: str, tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(
        _ARM.format(**{"option": "", "floor": "", "joint": "", "more": "", **OWN[kind]})
    )
    count, wrong = changed_by(tmp_path / "own.xml")
    assert not wrong
    assert count > 3


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("drive", DRIVES)
def test_limits_of_controls_are_used_where_there_are_any(drive: str, tmp_path: Path) -> None:
    """Whatever drives it: a control of 2 is one of 1 here."""
    text = {"option": "", "floor": "", "joint": "", "more": "", "actuators": _MOTORS}
    (tmp_path / "own.xml").write_text(_ARM.format(**text))
    found = {line[0] for line in list_proofs(tmp_path / "own.xml", drive)}
    assert "clampctrl" not in found
    (tmp_path / "own.xml").write_text(
        _ARM.format(**{**text, "actuators": OWN["no limits"]["actuators"]})
    )
    assert "clampctrl" in {line[0] for line in list_proofs(tmp_path / "own.xml", drive)}


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["grasp_mug", "ragdoll", "double_pendulum"])
def test_no_proof_of_a_shipped_model_changes_it(name: str) -> None:
    _, wrong = changed_by(MODELS / name / "scene.xml", ("auto", "hold"))
    assert not wrong


@pytest.mark.night
@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif("ROBOT_WHEELS" not in os.environ, reason="no folder of public models is known")
def test_no_proof_of_a_public_model_changes_it(tmp_path: Path) -> None:
    lines, wrong = 0, list[str]()
    actuated = (x for x in public_models(tmp_path, "") if moves(x.path))
    models = 0
    for public in actuated:
        if not mujoco.MjModel.from_xml_path(str(public.path)).nu:
            continue
        count, found = changed_by(public.path, ("auto", "hold"))
        lines, wrong, models = lines + count, wrong + found, models + 1
    print(f"{lines} lines of {models} models")  # noqa: T201 - what was tried
    assert not wrong
    assert models >= 40
