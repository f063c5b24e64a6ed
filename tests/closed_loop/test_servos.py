"""Laws of servos: closed forms of sag and of the gains that a step holds, and plain MuJoCo."""

from itertools import product

import mujoco
import numpy as np
import pytest

from contactlab.closed_loop.linear_model import linearize_model
from contactlab.closed_loop.servos import measure_servos
from contactlab.schema.servo import Servo

SLIDER = """<mujoco><option timestep="{h}" integrator="{integrator}"/><worldbody><body>
<joint name="x" type="slide" axis="0 0 1" range="-1 1"/><geom size=".1" mass="{m}"/></body>
</worldbody><actuator><position name="lift" joint="x" kp="{k}" kv="{c}"/></actuator></mujoco>"""
ARM = """<mujoco><option timestep=".002" integrator="{integrator}"/>
<default><geom type="capsule"/></default><worldbody><body>
<joint name="a" axis="0 1 0" damping=".3" armature=".01"/>
<geom size=".03" fromto="0 0 0 .3 0 0" mass="1"/>
<body pos=".3 0 0"><joint name="b" axis="0 1 0" stiffness="5"/>
<geom size=".02" fromto="0 0 0 .2 0 0" mass=".4"/>
<body pos=".2 0 0"><joint name="c" axis="0 0 1"/>
<geom size=".02" fromto="0 0 0 .1 0 0" mass=".1"/></body>
</body></body></worldbody><actuator>
<position joint="a" kp="300" kv="9"/>
<position joint="b" kp="40" kv=".6"/>
<velocity joint="c" kv=".05"/></actuator></mujoco>"""


def servos_of(xml: str) -> tuple[Servo, ...]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return measure_servos(model, data)


@pytest.mark.parametrize(("h", "c"), [*product((1e-3, 5e-3), (10.0, 90.0))])
def test_the_caps_of_gains_are_those_of_the_discrete_poles(h: float, c: float) -> None:
    m = 2.0
    caps = {
        "Euler": ((4 - 2 * h * c / m) * m / h**2, 2 * m / h - h * 100 / 2),
        "implicitfast": (4 * m / h**2 + 2 * c / h, None),
        "implicit": (4 * m / h**2 + 2 * c / h, None),
    }
    for integrator, (stiffness, damping) in caps.items():
        (servo,) = servos_of(SLIDER.format(h=h, integrator=integrator, m=m, k=100, c=c))
        assert servo.holds
        within = servo.largest_stiffness or 1e4
        assert within == pytest.approx(min(stiffness, 1e4), rel=0.01)
        if damping and damping < 100 * c:
            assert servo.largest_damping == pytest.approx(damping, rel=0.01)
        else:
            assert servo.largest_damping is None


def test_a_servo_sags_by_its_load_over_its_stiffness() -> None:
    xml = SLIDER.format(h=0.002, integrator="Euler", m=3, k=500, c=80)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=5000)
    (servo,) = servos_of(xml)
    assert servo.gravity_sag == pytest.approx(3 * 9.81 / 500, rel=1e-12)
    assert servo.gravity_sag == pytest.approx(-data.qpos[0], rel=1e-6)
    mujoco.mj_forward(model, data)
    (rested,) = measure_servos(model, data, [data])
    assert rested.task_sag == pytest.approx(-data.qpos[0], rel=1e-6)
    assert servo.travel == 2


@pytest.mark.parametrize("c", [5.0, 80.0])
def test_a_servo_rings_as_its_mass_on_a_spring(c: float) -> None:
    (servo,) = servos_of(SLIDER.format(h=0.002, integrator="Euler", m=3, k=500, c=c))
    assert servo.frequency == pytest.approx(np.sqrt(500 / 3) / (2 * np.pi), rel=1e-12)
    assert servo.damping_ratio == pytest.approx(c / (2 * np.sqrt(500 * 3)), rel=1e-12)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "RK4"])
def test_the_linear_step_is_the_derivative_of_a_step_of_mujoco(
    integrator: str, *, held: bool
) -> None:
    equality = '<equality><joint joint1="a" joint2="c"/></equality></mujoco>'
    text = ARM.replace("</mujoco>", equality) if held else ARM
    model = mujoco.MjModel.from_xml_string(text.format(integrator=integrator))
    model.opt.tolerance = 0
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    growth, nudge, columns = linearize_model(model, data).find_growth(), 1e-6, []
    for place, sign in product(range(6), (1, -1)):
        mujoco.mj_resetData(model, data)
        (data.qpos if place < 3 else data.qvel)[place % 3] = sign * nudge
        mujoco.mj_step(model, data)
        columns.append(sign * np.concatenate([data.qpos, data.qvel]))
    step = (np.array(columns[::2]) + np.array(columns[1::2])).T / (2 * nudge)
    assert growth == pytest.approx(np.abs(np.linalg.eigvals(step)).max(), rel=1e-6)


@pytest.mark.parametrize("kv", [".6", ".01"])
def test_the_least_armature_is_where_plain_mujoco_begins_to_grow(kv: str) -> None:
    xml = ARM.format(integrator="Euler").replace('kv=".05"', f'kv="{kv}"')
    servo = servos_of(xml)[2]
    assert servo.holds == (kv == ".01")
    assert servo.least_armature is not None
    for share in (0.98, 1.02):
        model = mujoco.MjModel.from_xml_string(xml)
        model.dof_armature[2] = share * servo.least_armature
        model.opt.gravity[:] = 0
        data = mujoco.MjData(model)
        data.qvel[:] = 1e-6
        mujoco.mj_step(model, data, nstep=1000)
        if servo.least_armature:
            assert (np.abs(data.qvel).max() > 1e-6) == (share < 1)
