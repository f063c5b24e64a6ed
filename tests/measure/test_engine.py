"""Measures of short real simulations, against what MuJoCo is known to do."""

from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.trace_arrays import PairTrace, Trace
from contactlab.contact.trace_setup import Barrier, FreeBody, Setup
from contactlab.measure import assess_runs

FIELDS = "found force torque dist pos normal tangent linvel angvel"
MODEL = """
<mujoco>
  <option {option}/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1" friction="{friction}"/>
    {bodies}
  </worldbody>
  <sensor>
    {contacts}
    <e_kinetic/>
    <e_potential/>
  </sensor>
</mujoco>
"""


def simulate(trace_of: Any, seconds: float, speed: float = 0, **model: Any) -> Trace:
    """Step a model in a plain loop and return its trace; `pairs` are names of two geoms each."""
    pairs, slots = model.pop("pairs"), model.pop("slots")
    sensors = "".join(
        f'<contact geom1="{one}" geom2="{two}" data="{FIELDS}" num="{slots}"/>'
        for one, two in pairs
    )
    compiled = mujoco.MjModel.from_xml_string(MODEL.format(contacts=sensors, **model))
    data = mujoco.MjData(compiled)
    if speed:
        data.qvel[0] = speed
    steps = round(seconds / compiled.opt.timestep)
    state = np.empty((1, steps + 1, 1 + compiled.nq + compiled.nv))
    sensed = np.empty((1, steps, compiled.nsensordata))
    state[0, 0] = np.concatenate(([data.time], data.qpos, data.qvel))
    for step in range(steps):
        mujoco.mj_step(compiled, data)
        state[0, step + 1] = np.concatenate(([data.time], data.qpos, data.qvel))
        sensed[0, step] = data.sensordata
    blocks = sensed[:, :, :-2].reshape(1, steps, len(pairs), slots, 23)
    mu = float(model["friction"].split()[0])
    return trace_of(
        1,
        steps,
        compiled.opt.timestep,
        time=state[:, :, 0],
        qpos=state[:, :, 1 : 1 + compiled.nq],
        qvel=state[:, :, 1 + compiled.nq :],
        kinetic=sensed[:, :, -2],
        potential=sensed[:, :, -1],
        pairs=tuple(
            PairTrace("-".join(pair), blocks[:, :, index], np.array([[mu, mu, 0.005, 1e-4, 1e-4]]))
            for index, pair in enumerate(pairs)
        ),
    )


def floor_under(trace: Trace, setup_of: Any, **changes: Any) -> Setup:
    body = FreeBody("body", 0, 0, np.ones(1))
    floor = Barrier(0, body, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.inf)
    return setup_of(trace, free_bodies=(body,), barriers=(floor,), **changes)


@pytest.mark.parametrize(
    ("option", "solref", "label"),
    [
        ('timestep="0.0005"', "-160000 -144.7", "stable"),
        ('timestep="0.0005" integrator="discrete"', "-160000 -144.7", "oracle_miss"),
        # h w = 1.6: the stiff spring is stepped over, and throws the ball up.
        ('timestep="0.004"', "0.01382 0.1809", "energy_injection"),
        # One step at impact is longer than the ball's radius.
        ('timestep="0.02"', "0.02 1", "tunneling"),
    ],
)
def test_ball(trace_of: Any, setup_of: Any, option: str, solref: str, label: str) -> None:
    ball = f"""<body pos="0 0 2.05"><freejoint/><geom name="ball" size=".05" mass="1"
        solref="{solref}" solimp=".99 .99 .001 .5 2" priority="1"/></body>"""
    trace = simulate(
        trace_of, 3, option=option, friction="1", bodies=ball, pairs=[("floor", "ball")], slots=1
    )
    pair = tuple(float(part) for part in solref.split())
    setup = floor_under(
        trace, setup_of, oracle="restitution", oracle_tolerance=0.02, settings={"solref": [pair]}
    )
    found = assess_runs(trace, setup)
    assert found.labels[0][0].label == label
    if label == "stable":
        # Impulse of the whole motion: weight times time, and what turned the fall into rest.
        # Contact ends in micro-bounces, so that the last velocity is not quite zero.
        impulse = 9.81 * 3 + trace.qvel[0, -1, 2]
        assert found.metrics["normal_impulse"][0] == pytest.approx(impulse, rel=1e-9)


@pytest.mark.parametrize("timestep", [5e-4, 2e-3])
def test_a_sliding_box_stops_once(trace_of: Any, setup_of: Any, timestep: float) -> None:
    box = """<body pos="0 0 .05"><freejoint/>
        <geom name="box" type="box" size=".1 .1 .05" mass="1" friction=".5"/></body>"""
    trace = simulate(
        trace_of,
        0.6,
        speed=1,
        option=f'timestep="{timestep}" cone="elliptic"',
        friction="0.5",
        bodies=box,
        pairs=[("floor", "box")],
        slots=4,
    )
    settings = {
        "speed": [1.0],
        "friction": [(0.5,)],
        "timestep": [timestep],
        "integrator": ["Euler"],
    }
    setup = floor_under(
        trace,
        setup_of,
        first_mode="slides",
        last_mode="sticks",
        oracle="sliding_distance",
        oracle_tolerance=0.01,
        settings=settings,
    )
    found = assess_runs(trace, setup)
    assert found.metrics["mode_switches"][0] * 0.6 == pytest.approx(1)
    assert [outcome.label for outcome in found.labels[0]] == ["stable"]
    # Micro-hops: the box touches in fewer than four of five steps of its slide.
    assert (found.series[0].contacts[0, : int(0.2 / timestep)] > 0).mean() < 0.8
    assert found.metrics["cone_violation"][0] < 1e-6


def test_a_stack_sags_as_its_impedance_says(trace_of: Any, setup_of: Any) -> None:
    count = 3
    bodies = "".join(
        f"""<body pos="{k * 1e-4} 0 {0.05 + 0.1 * k}"><freejoint/>
        <geom name="box{k}" type="box" size=".05 .05 .05" mass="1"/></body>"""
        for k in range(count)
    )
    pairs = [("floor", "box0"), *((f"box{k}", f"box{k + 1}") for k in range(count - 1))]
    trace = simulate(
        trace_of,
        1,
        option='cone="elliptic"',
        friction="1",
        bodies=bodies,
        pairs=pairs,
        slots=4,
    )
    settings = {"solref": [(0.02, 1.0)], "solimp": [(0.9, 0.95, 0.001, 0.5, 2.0)]}
    boxes = tuple(FreeBody(f"box{k}", 7 * k, 6 * k, np.ones(1)) for k in range(count))
    setup = setup_of(
        trace,
        free_bodies=boxes,
        oracle="stack_sag",
        oracle_tolerance=1e-3,
        last_mode="sticks",
        settings=settings,
    )
    found = assess_runs(trace, setup)
    assert [outcome.label for outcome in found.labels[0]] == ["stable"]
    top = trace.qpos[0, :, 7 * (count - 1) + 2]
    assert found.metrics["oracle_measured"][0] == pytest.approx(top[0] - top[-1], rel=1e-3)
