"""Laws of control loops: the discrete poles of a hinge, memory, and simulated borders."""

import math
import threading
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.closed_loop.control_loop import (
    INTEGRATION,
    ControlLoop,
    LoopRows,
    find_modes,
    simulate_growth,
)
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import Policy

HINGE = """<mujoco><option timestep="{h}" gravity="0 0 0" integrator="{integrator}"/>
<worldbody><body><joint name="hinge" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia=".02 .02 .02"/></body></worldbody>
<actuator><motor joint="hinge"/></actuator></mujoco>"""
INERTIA = 0.02


def hinge_loop(
    kp: float, kd: float, *, h: float = 1e-3, integrator: str = "Euler", **values: Any
) -> ControlLoop:
    class Hold:
        def __init__(self, model: mujoco.MjModel) -> None:
            self.size = model.nu

        def __call__(self, *seen: Floats) -> Floats:
            return -kp * seen[1] - kd * seen[2]

    model = mujoco.MjModel.from_xml_string(HINGE.format(h=h, integrator=integrator))
    return ControlLoop(
        model, Hold, start_of(model), **dict[str, Any](values, rate=values.get("rate", 200.0))
    )


def start_of(model: mujoco.MjModel) -> Floats:
    data, start = mujoco.MjData(model), np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    return start


def growth_of_poles(loop: ControlLoop, kp: float, kd: float) -> float:
    """Return the largest discrete pole of a hinge, from its recursion written by hand."""
    steps, (late, part) = loop.substeps, loop.delay
    inertia = INERTIA + float(loop.model.dof_armature[0])
    state = np.eye(3 + late)  # x, v, the acting torque, and the waiting ones
    ask = np.zeros(3 + late)
    ask[:2] = -kp * loop.gain, -kd * loop.gain
    queue = [state[3 + place] for place in range(late)] + [ask]
    x, v, torque = state[0], state[1], state[2]
    for step in range(steps):
        torque = queue.pop(0) if step == part else torque
        v = v + loop.timestep / inertia * torque
        x = x + loop.timestep * v
    return float(np.abs(np.linalg.eigvals(np.array([x, v, torque, *queue]))).max())


@pytest.mark.parametrize("latency", [0.0, 0.004, 0.0125])
@pytest.mark.parametrize(("kp", "kd"), [(5.0, 0.3), (20.0, 1.5)])
def test_the_modes_of_a_hinge_are_its_discrete_poles(kp: float, kd: float, latency: float) -> None:
    for rate in (100.0, 200.0, 500.0, 2000.0):
        loop = hinge_loop(kp, kd, rate=rate, latency=latency)
        growth, _ = find_modes(loop, np.array([0.0]))
        assert math.exp(growth / rate) == pytest.approx(growth_of_poles(loop, kp, kd), rel=1e-5)


@pytest.mark.parametrize(("kp", "kd"), [(5.0, 0.3), pytest.param(20, 1.5, marks=pytest.mark.long)])
def test_the_simulated_borders_of_a_hinge_are_those_of_its_poles(kp: float, kd: float) -> None:
    study = LoopStudy(hinge_loop(kp, kd), periods=300)
    for margin, axis in zip(study.measure_margins().margins, study.list_axes(), strict=True):
        if not margin.border:
            assert growth_of_poles(axis.make(axis.within[0]), kp, kd) < 1
            continue
        step = study.loop.timestep if margin.unit == "s" else 0.0  # a delay is whole steps
        inner, outer = (0.99 * margin.border - step, 1.01 * margin.border + step)
        inner, outer = (outer, inner) if margin.holds_above else (inner, outer)
        assert growth_of_poles(axis.make(inner), kp, kd) < 1, margin
        assert growth_of_poles(axis.make(outer), kp, kd) > 1, margin


def test_rk4_holds_a_controller_outside_of_the_model_no_better() -> None:
    loops = [hinge_loop(20, 1.5, integrator=one, rate=20.0) for one in ("Euler", "RK4")]
    assert all(find_modes(loop, np.array([0.0]))[0] > 0 for loop in loops)


def test_the_memory_of_a_controller_is_a_part_of_its_loop() -> None:
    """An integrator u' = u - k T x of a damped slider makes three poles."""
    model = mujoco.MjModel.from_xml_string(
        HINGE.format(h=1e-3, integrator="Euler").replace('"0 1 0"', '"0 1 0" damping="1"')
    )

    class Integrator:
        def __init__(self, _: mujoco.MjModel) -> None:
            self.sum: Floats | None = None

        def __call__(self, *seen: Floats) -> Floats:
            self.sum = -0.01 * seen[1] if self.sum is None else self.sum - 0.01 * seen[1]
            return self.sum - 2 * seen[1]

    loop = ControlLoop(model, Integrator, start_of(model), 100.0)
    rows = LoopRows(loop)
    rows.make_periods()
    period, kept = rows.linearize_period(), INERTIA + 1e-3
    step = np.array([[1, 0, 0], [0, INERTIA / kept, 0], [0, 0, 1]])
    force = np.array([-2 - 0.01, 0, 1])
    x, v = np.eye(3)[0], np.eye(3)[1]
    for _ in range(10):
        v = step[1, 1] * v + 1e-3 / kept * force
        x = x + 1e-3 * v
    expected = np.array([x, v, [-0.01, 0, 1]])
    assert period.shape == (3, 3)
    assert period == pytest.approx(expected, rel=1e-6, abs=1e-8)


def test_a_run_grows_as_fast_as_its_mode() -> None:
    for rate in (8.0, 9.0):
        loop = hinge_loop(5, 0.3, rate=rate)
        growth, _ = find_modes(loop, np.array([0.0]))
        assert simulate_growth(loop, 4.0) == pytest.approx(growth, rel=0.2)


def test_a_controller_with_a_part_that_cannot_be_copied_has_the_same_loop() -> None:
    """A session of a network is shared by all rows; the memory next to it is not."""

    class Filtered:
        def __init__(self, _: mujoco.MjModel) -> None:
            self.session, self.last = threading.Lock(), np.zeros((1, 1))

        def __call__(self, *seen: Floats) -> Floats:
            self.last = 0.5 * self.last + 0.5 * (-5 * seen[1] - 0.3 * seen[2])
            return self.last

    class Plain(Filtered):
        def __init__(self, model: mujoco.MjModel) -> None:
            super().__init__(model)
            del self.session

    loops = [replace(hinge_loop(5, 0.3, rate=100.0), policy=each) for each in (Filtered, Plain)]
    one, two = (find_modes(loop, np.array([0.0]))[0] for loop in loops)
    assert one == two


def test_a_controller_in_single_precision_has_the_modes_of_a_double_one() -> None:
    """Its answers are rounded to a millionth of their largest part, as those of networks are."""

    class Rounded:
        def __init__(self, _: mujoco.MjModel) -> None:
            pass

        def __call__(self, *seen: Floats) -> Floats:
            position, speed = (part.astype(np.float32) for part in seen[1:3])
            inner = np.float32(7) - np.float32(5) * position - np.float32(0.3) * speed
            return (inner - np.float32(7)).astype(np.float64)

    for rate in (100.0, 20.0):
        double = hinge_loop(5, 0.3, rate=rate)
        single = replace(double, policy=Rounded)
        assert (double.nudge, single.nudge) == (1e-6, 1e-3)
        (one, _), (other, _) = (find_modes(loop, np.array([0.0])) for loop in (double, single))
        assert other == pytest.approx(one, rel=0.01)
        assert LoopStudy(single, periods=300).holds_simulated(single)


def test_an_object_that_falls_alone_is_no_mode_of_a_loop() -> None:
    """A pole that no actuator moves tips over; the loop of the hinge is unchanged."""
    falling = '<body pos="1 0 0"><joint axis="0 1 0"/><geom size=".05" pos="0 0 .1"/></body>'
    loop, still = hinge_loop(2.0, 0.5), 'gravity="0 0 0"'
    xml = HINGE.format(h=1e-3, integrator="Euler").replace(still, "")
    other = mujoco.MjModel.from_xml_string(xml.replace("</worldbody>", f"{falling}</worldbody>"))

    def hold_hinge(_: mujoco.MjModel) -> Policy:
        return lambda *seen: -2.0 * seen[1][:, :1] - 0.5 * seen[2][:, :1]

    both = replace(loop, model=other, start=start_of(other), policy=hold_hinge)
    growth, dof = find_modes(both, np.array([0.0]))
    assert (growth, dof) == (pytest.approx(find_modes(loop, np.array([0.0]))[0], rel=1e-6), 0)
    assert simulate_growth(both, 1.0) == pytest.approx(simulate_growth(loop, 1.0), abs=0.3)
    assert simulate_growth(replace(both, latency=0.1), 1.0) > 1
