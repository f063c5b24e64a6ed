"""The task of a model is the author's: its runs are plain MuJoCo's, under what was stored."""

import os
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.verdicts.public_models import moves, public_models

from contactlab.errors import SceneError
from contactlab.plan.task_options import read_task_options
from contactlab.run.sweep_request import SceneLoader, read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store

# Two fingers that motors press on a box, whose weight only friction bears.
SQUEEZE = """<mujoco><option timestep="0.002" cone="elliptic"/><worldbody>
<body name="left" pos="-.06 0 .5"><joint name="left" type="slide" axis="1 0 0" damping="2"/>
<geom name="left" type="box" size=".01 .03 .03" mass=".1"/></body>
<body name="right" pos=".06 0 .5"><joint name="right" type="slide" axis="-1 0 0" damping="2"/>
<geom name="right" type="box" size=".01 .03 .03" mass=".1"/></body>
<body name="box" pos="0 0 .5"><freejoint/>
<geom name="box" type="box" size=".05 .03 .03" mass=".2"/></body></worldbody>
<actuator><motor name="left" joint="left" gear="10" ctrlrange="-1 1"/>
<motor name="right" joint="right" gear="10" ctrlrange="-1 1"/></actuator>
<keyframe><key name="open" qpos="-.02 -.02 0 0 .5 1 0 0 0"/>
<key name="grip" qpos="0 0 0 0 .5 1 0 0 0" ctrl=".8 .8"/></keyframe></mujoco>"""
ARM = """<mujoco><option timestep="0.004"/><worldbody><geom type="plane" size="2 2 1"/>
<body pos="0 0 .5"><joint name="arm" axis="0 1 0"/><geom type="capsule" size=".03" mass="1"
fromto="0 0 0 .3 0 0"/></body><body name="ball" pos="1 0 .1"><freejoint/><geom size=".1"/></body>
</worldbody><actuator><general joint="arm" dyntype="filterexact" dynprm=".1" gainprm="5"
ctrlrange="-1 1"/></actuator>{keys}</mujoco>"""
REST = '<keyframe><key name="away" qpos="1 1 0 .1 1 0 0 0"/></keyframe>'


def swept(path: Path, folder: Path, more: str = "") -> Store:
    """Return the store of the default runs of a model file."""
    text = f"version: 1\nscene: {path}\naxes: {{}}\nseeds: 2\ntrace: all\nchecks: none\n{more}"
    asked = read_request(text, "store", folder, folder=path.parent, workers=0)
    run_sweep(asked, lambda *_: None, lambda _finished: None)
    return Store.open(folder)


def plain(path: Path, store: Store, record: EvidenceRecord) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return (T, nq + nv) states and the normal forces of contacts of plain MuJoCo.

    From the run's start, under the controls and forces that the store has of it; the seed 0 starts
    at the keyframe itself.
    """
    model, trace = mujoco.MjModel.from_xml_path(str(path)), store.trace(record)
    data, start = mujoco.MjData(model), str(record.settings.get("keyframe", "qpos0"))
    if start.startswith("key["):
        mujoco.mj_resetDataKeyframe(model, data, int(start[4:-1]))
    elif start != "qpos0":
        mujoco.mj_resetDataKeyframe(model, data, model.key(start).id)
    if record.seed == 0:
        assert data.qpos.tobytes() == trace.qpos[0].tobytes()
    if record.drive == "none":
        written = data.ctrl.copy()
        applied = store.controls(record)
        assert applied is None or np.array_equal(applied.levels, [written, written])
    data.qpos[:], data.qvel[:] = trace.qpos[0], trace.qvel[0]
    applied, states, forces = store.controls(record), list[np.ndarray](), list[np.ndarray]()
    for step in range(len(trace.qpos) - 1):
        if applied is not None:
            row = np.searchsorted(applied.times, step * model.opt.timestep, side="right") - 1
            inputs = np.concatenate([data.ctrl, data.xfrc_applied.ravel()])
            places = list(applied.places or range(model.nu))
            inputs[places] = applied.levels[row]
            data.ctrl[:], data.xfrc_applied.flat[:] = np.split(inputs, [model.nu])
        mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel]))
        rows = [contact.efc_address for contact in data.contact if contact.efc_address >= 0]
        forces.append(np.array(data.efc_force[rows]))
    return np.array(states), forces


def assert_equal(path: Path, store: Store) -> int:
    """Assert that all runs of a store are plain MuJoCo's to the bit; return their number.

    A run that the engine stopped counts until then: MuJoCo by itself starts anew at that step.
    """
    for record in store.records():
        trace = store.trace(record)
        own = np.hstack([trace.qpos, trace.qvel])[1:]
        states, _ = plain(path, store, record)
        steps = len(own) - (record.status != "ok")
        assert states[:steps].tobytes() == own[:steps].tobytes()
    return len(store.table)


def compared(path: Path, store: Store) -> str:
    """Return how far the runs of a store are plain MuJoCo's, in words; see `assert_equal`."""
    try:
        assert_equal(path, store)
    except AssertionError:
        return "UNEQUAL"
    ends = [str(record.steps) for record in store.records() if record.status != "ok"]
    record = next(iter(store.records()))
    return f"{record.drive}, equal{f' until it diverges, step {min(ends)}' if ends else ''}"


@pytest.mark.parametrize(
    "keys",
    [
        pytest.param("", marks=pytest.mark.long),
        pytest.param(REST, marks=pytest.mark.long),
        REST.replace("/></key", ' ctrl=".5"/></key'),
    ],
)
def test_default_runs_are_plain_mujoco(keys: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(keys=keys))
    store = swept(path, tmp_path / "store")
    assert assert_equal(path, store) == 2
    drives = {str(record.drive) for record in store.records()}
    assert drives == {"none" if "ctrl=" in keys else "exercise"}


@pytest.mark.long
def test_a_grip_of_motors_is_judged_with_its_squeeze(tmp_path: Path) -> None:
    """Its motors press with 8 N each; forces in the trace are those of plain MuJoCo."""
    path = tmp_path / "grip.xml"
    path.write_text(SQUEEZE)
    store = swept(path, tmp_path / "store")
    assert assert_equal(path, store) == 2
    record = next(iter(store.records()))
    assert (record.settings["keyframe"], record.drive) == ("grip", "none")
    _, forces = plain(path, store, record)
    trace = store.trace(record)
    last = len(forces) - 1
    pairs = [trace.pair(name) for name in record.pairs]
    own = sum(pair.normal[pair.steps == last].sum() for pair in pairs)
    assert own == pytest.approx(forces[-1].sum(), rel=1e-12)
    assert own == pytest.approx(16, rel=0.05)
    assert trace.qpos[-1, 4] > 0.45, "friction of two fingers, 16 N, bears 2 N"


def test_a_task_is_the_first_that_the_model_has(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"

    def line(text: str, **values: object) -> str:
        path.write_text(text)
        return SceneLoader(Path()).open(str(path)).task(values).line

    end = "3 seeds; observed: all bodies; tolerance 10 %"
    assert line(SQUEEZE) == f"keyframe grip, 2 s held by its controls; {end}"
    moved = "1 s at rest, then 2 s of sines and pushes"
    assert line(ARM.format(keys="")) == f"qpos0, {moved}; {end}"
    assert line(ARM.format(keys=REST)) == f"keyframe away, {moved}; {end}"
    alone = ARM.format(keys="").replace("<freejoint/>", "")
    assert "2 s of sines; " in line(alone)
    assert "2 s of pushes; " in line(re.sub("<actuator>.*</actuator>", "", alone, flags=re.DOTALL))
    assert line(SQUEEZE, keyframe="open").startswith("keyframe open, 0.667 s at rest")


def test_a_body_that_is_not_there_is_named_with_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(SQUEEZE)
    scene = SceneLoader(Path()).open(str(path))
    with pytest.raises(SceneError, match=r"no body 'boxx' to observe; did you mean 'box'\?"):
        scene.task({}, watch=("boxx",))
    task = scene.task({}, 0.5, watch=("box",), within=(1e-3, "m"))
    assert task.line.endswith("0.5 s held by its controls; 3 seeds; observed: box; tolerance 1 mm")


def test_options_have_units() -> None:
    read = read_task_options("home", None, "500ms", ["box"], ["5deg", "slip=1mm", "share=3%"])
    assert read.settings == ["keyframe=home", "duration=0.5"]
    assert read.tolerance == (pytest.approx(np.deg2rad(5)), "rad")
    assert read.limits == {"slip": 1e-3, "share": 0.03}
    assert read_task_options(tolerance=["10%"]).tolerance == (0.1, "1")


@pytest.mark.night
@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif("ROBOT_WHEELS" not in os.environ, reason="no folder of public models is known")
def test_default_runs_of_public_models_are_plain_mujoco(tmp_path: Path) -> None:
    found: dict[str, str] = {}
    for public in public_models(tmp_path, ""):
        if moves(public.path) and mujoco.MjModel.from_xml_path(str(public.path)).nu:
            store = swept(public.path, tmp_path / f"store{len(found)}")
            found[public.name] = compared(public.path, store)
            print(f"{public.name}: {found[public.name]}")  # noqa: T201 - the list is asked for
    assert "UNEQUAL" not in found.values()
    assert len(found) >= 40
