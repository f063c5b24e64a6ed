"""The panel of engines: its tasks are read, and what it expects of them is what MuJoCo compiles."""

import mujoco
import numpy as np
import pytest
from bench.engine_panel import ITEMS, best, period, rod
from bench.engine_panel import Point as Run

from contactlab.run.sweep_request import read_request

PENDULUM = next(path for path in ITEMS if path.stem == "pendulum").parent / "pendulum.xml"


@pytest.mark.long
def test_each_task_has_three_steps_of_one_engine() -> None:
    assert len(ITEMS) == 12
    for path in ITEMS:
        request = read_request(path, path.stem, path.parent, folder=path.parent, workers=0)
        assert request.plan.count == 3


def test_the_rods_inertia_is_that_of_mujocos_capsule() -> None:
    model = mujoco.MjModel.from_xml_path(str(PENDULUM))
    inertia, centre = rod(1.0, 0.02)
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
    assert abs(period(np.array(angles), 0.01)) < 1e-6


def test_who_is_better_than_mujoco_is_named() -> None:
    def run(engine: str, error: float | None) -> Run:
        return Run("bounce", engine, "1", 0.001, error, None, None, None, "stable")

    assert best([run("mujoco", 0.1), run("sapien", 0.01), run("bullet", None)]) == [
        "- bounce: sapien 0.01, mujoco 0.1"
    ]
    assert best([run("mujoco", 0.1), run("sapien", 0.2)]) == []
