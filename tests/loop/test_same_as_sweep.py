"""A loop that makes the steps of a sweep's run leaves the record of that run, to the last bit."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import contactlab
from contactlab.measure import METRICS
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store

STEPS = 400
FALL = """
<mujoco><option timestep="0.002" {option}/>
<worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body pos="0 0 .15"><freejoint/><geom type="box" size=".1 .1 .1" euler="10 20 0" mass="1"/></body>
  <body name="ball" pos=".02 0 .6"><freejoint/><geom name="ball" size=".1" mass="2"/></body>
</worldbody></mujoco>"""
ARM = """
<mujoco><option timestep="0.002" {option}/>
<worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body name="upper" pos="0 0 .5"><joint name="a" axis="0 1 0" damping=".1" stiffness=".2"/>
    <geom name="upper" type="capsule" fromto="0 0 0 .3 0 0" size=".04"/>
    <body name="lower" pos=".3 0 0"><joint axis="0 1 0" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body></body>
</worldbody>
<tendon><fixed name="both"><joint joint="a" coef="1"/></fixed></tendon>
<actuator><motor joint="a" ctrlrange="-9 9"/><position name="p" joint="a" kp="3"/></actuator>
</mujoco>"""
# The elbow is bound to the shoulder, so that what the joint motors do loads an equality.
BOUND = ARM.replace('<joint axis="0 1 0" damping=".1"/>', '<joint name="b" axis="0 1 0"/>').replace(
    "<tendon>", '<equality><joint joint1="b" joint2="a" polycoef="0 -.5"/></equality><tendon>'
)
FREE = """
<mujoco><option gravity="0 0 0" {option}/>
<worldbody>
  <body><freejoint/><geom name="one" size=".1"/></body>
  <body name="two" pos=".3 0 0"><freejoint/><geom name="two" type="box" size=".1 .1 .1"/></body>
</worldbody><keyframe><key qvel="1 .2 0 0 1 0 -1 0 .1 0 0 2"/></keyframe></mujoco>"""
CASES = {
    "euler": (FALL, ""),
    "elliptic": (FALL, 'cone="elliptic" integrator="implicitfast"'),
    "rk4": (FALL, 'integrator="RK4"'),
    "arm": (ARM, ""),
    "arm rk4": (ARM, 'integrator="RK4"'),
    "bound arm": (BOUND, ""),
    "arm implicit": (ARM, 'integrator="implicit"'),
    "free": (FREE, ""),
}


QUICK = "bound arm"
"""The case with contacts, controls, a tendon and an equality."""


def _controls(model: mujoco.MjModel) -> np.ndarray:
    """Return (STEPS, nu) controls, each held for ten steps."""
    drawn = np.random.default_rng(1).uniform(-2, 2, (STEPS // 10, model.nu))
    return np.repeat(drawn, 10, axis=0)


def _swept(folder: Path, text: str) -> tuple[Store, EvidenceRecord]:
    (folder / "model.xml").write_text(text, encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(text)
    drive: object = "none"
    if model.nu:
        times, controls = np.arange(STEPS + 1) * model.opt.timestep, _controls(model)
        names = ("actuator[0]", "p")
        table = np.column_stack([times, np.vstack([controls, controls[-1:]])])
        columns = dict(zip(["time", *names], table.T, strict=True))
        np.savez(folder / "drive.npz", **columns)
        drive = {"file": str(folder / "drive.npz"), "interpolation": "hold"}
    sweep = {
        "version": 1,
        "scene": str(folder / "model.xml"),
        "duration": STEPS * model.opt.timestep,
        "drive": drive,
        "axes": {"perturbation": [0.0]},
        "effects": {"base": "all"},
        "checks": "none",
    }
    store = contactlab.sweep(sweep, output=folder / "swept", workers=0)
    return store, next(iter(store.records()))


def _recorded(folder: Path, text: str) -> tuple[Store, EvidenceRecord]:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    with contactlab.record(model, data, folder / "recorded") as recording:
        for controls in _controls(model):
            data.ctrl[:] = controls
            recording.step()
    store = contactlab.open(folder / "recorded")
    return store, next(iter(store.records()))


@pytest.fixture(params=["kernel", pytest.param("python", marks=pytest.mark.long)])
def _reading(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read contacts by the kernel, and without it."""
    if request.param == "python":
        monkeypatch.setenv("CONTACTLAB_KERNEL", "off")


@pytest.mark.usefixtures("_reading")
@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=() if case == QUICK else pytest.mark.long) for case in CASES],
)
def test_a_loop_leaves_the_bits_of_a_sweep(tmp_path: Path, case: str) -> None:
    text, option = CASES[case]
    store, swept = _swept(tmp_path, text.format(option=option))
    mine, recorded = _recorded(tmp_path, text.format(option=option))

    assert recorded.trajectory_hash == swept.trajectory_hash
    checked = {name for name, each in METRICS.items() if each.kind == "check"}
    names = recorded.metrics.keys() - checked
    assert {name: recorded.metrics[name] for name in names} == {
        name: swept.metrics[name] for name in names
    }
    assert any(swept.metrics[name] for name in names)
    assert recorded.labels == swept.labels
    assert recorded.pairs == swept.pairs
    assert recorded.coverage == swept.coverage
    ours, theirs = mine.trace(recorded), store.trace(swept)
    assert ours.qpos.tobytes() == theirs.qpos.tobytes()
    assert [pair.name for pair in ours.pairs] == [pair.name for pair in theirs.pairs]
    assert sum(len(pair.steps) for pair in theirs.pairs)
    for one, other in zip(ours.pairs, theirs.pairs, strict=True):
        arrays = {name: each for name, each in vars(other).items() if isinstance(each, np.ndarray)}
        for name, each in arrays.items():
            assert getattr(one, name).tobytes() == each.tobytes(), name
