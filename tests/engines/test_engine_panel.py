"""The panel of engines: its tasks are read, and what it expects of them is what MuJoCo compiles."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.errors import EngineError, OtherSweepError, SweepFileError
from contactlab.schema.engine_panel import EnginePanel, PanelRun
from contactlab.studies.engine_panel.closed_forms import find_rod_inertia, measure_period_error
from contactlab.studies.engine_panel.engine_panel import (
    REPORT,
    TASKS,
    PanelRequest,
    better_runs,
    middle_run,
    run_panel,
)
from contactlab.tasks.session import Session

PENDULUM = TASKS["pendulum"].parent / "pendulum.xml"


def test_the_rods_inertia_is_that_of_mujocos_capsule() -> None:
    model = mujoco.MjModel.from_xml_path(str(PENDULUM))
    inertia, centre = find_rod_inertia(1.0, 0.02)
    assert centre == 0.5
    assert inertia == pytest.approx(model.body_inertia[1].max() + 0.25, rel=1e-9)


def test_the_rods_period_is_that_of_fine_steps_of_fourth_order() -> None:
    model = mujoco.MjModel.from_xml_path(str(PENDULUM))
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 0.01
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    angles = [float(data.qpos[0])]
    for _ in range(1000):
        mujoco.mj_step(model, data)
        angles.append(float(data.qpos[0]))
    # The zero lies on a chord: of a step of w h = .038, (w h)^3 / 72 of an angle at most.
    assert abs(measure_period_error(np.array(angles), 0.01)) < 1e-6


SHORT = """
version: 1
scene: SCENE
duration: 0.6
drive: none
axes: {engine: [mujoco], timestep: [0.002, 0.004]}
"""


@pytest.mark.long
def test_a_task_is_run_once_and_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball falls by 1 m, .45 s, and bounces, by MuJoCo and by an engine of spheres alone."""
    for task, scene in (
        ("bounce", "ball_drop"),
        ("grasp", str(TASKS["grasp"].with_suffix(".xml"))),
    ):
        monkeypatch.setitem(TASKS, task, tmp_path / f"{task}.yaml")
        TASKS[task].write_text(SHORT.replace("SCENE", scene))
    begun: list[int] = []
    session = Session(tmp_path / "out", begin=lambda _total, done, *_: begun.append(done))
    tasks, engines = ["bounce", "grasp"], ["mujoco", "impulse"]
    request = PanelRequest(tasks, engines)
    first = run_panel(request, session)
    assert [(each.task, each.engine) for each in first.runs] == (
        [("bounce", "mujoco")] * 2 + [("bounce", "impulse")] * 2 + [("grasp", "mujoco")] * 2
    )
    assert all(each.error is not None and each.cost for each in first.runs)
    (why,) = first.skipped
    assert why.startswith("grasp: the impulse engine")
    # The law that `impulse` computes is the closed form.
    assert [(found.task, found.engine) for found, _ in better_runs(first)] == [
        ("bounce", "impulse")
    ]
    assert middle_run(first, "grasp", "impulse") is None
    assert EnginePanel.model_validate_json((tmp_path / "out" / REPORT).read_bytes()) == first
    assert begun == [0, 0, 0]
    assert run_panel(PanelRequest(tasks * 2, engines * 2), session) == first
    assert begun[3:] == [2, 2, 2]
    for name, value, held in (
        ("contactlab.run.sweep_runner.hash_definitions", lambda: "0" * 64, "of another contactlab"),
        ("contactlab.engines.impulse.ImpulseEngine.version", "9", "impulse .+, and 9 is"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(name, value)
            with pytest.raises(OtherSweepError, match=f"{held}.*; remove it, or .* -o$"):
                run_panel(request, session)


def test_what_there_is_not_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for request, error, said in (
        (PanelRequest(["bounc"]), SweepFileError, "did you mean 'bounce'"),
        (PanelRequest(engines=["nobody"]), EngineError, "no engine 'nobody'; there are mujoco, "),
        (PanelRequest(engines=["cenic"]), EngineError, "contactlab parity --install cenic"),
    ):
        with pytest.raises(error, match=said):
            run_panel(request, Session(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_who_is_better_than_mujoco_is_named() -> None:
    def point(engine: str, error: float | None) -> PanelRun:
        return PanelRun(
            task="bounce", engine=engine, step=0.001, accuracy=None, error=error, energy=None,
            depth=None, cost=None, label="stable",
        )  # fmt: skip

    def told(*points: PanelRun) -> list[tuple[str, str]]:
        task = {"name": "bounce", "description": "", "measure": "restitution"}
        panel = EnginePanel.model_validate(
            {"engines": {}, "tasks": [task], "runs": points, "skipped": ()}
        )
        return [(found.engine, ours.engine) for found, ours in better_runs(panel)]

    ours, theirs = point("mujoco", 0.1), point("sapien", 0.01)
    assert told(ours, theirs, point("bullet", None)) == [("sapien", "mujoco")]
    assert told(ours, point("sapien", 0.2)) == []
