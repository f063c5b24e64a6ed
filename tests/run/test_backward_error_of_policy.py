"""The backward error of a policy's run is that of the controls it gave, held at the run's rate."""

from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.cart_pole import cart_pole

import contactlab
from contactlab.contact.trace_arrays import Floats
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store

STEP, STEPS, FINER = 0.004, 10, 4  # one window of 40 ms
CART_POLE = cart_pole(STEP, more='<keyframe><key qpos="0 0.1" qvel="1 -2"/></keyframe>')
POLICY = """
class Balance:
    def __init__(self, model):
        pass

    def __call__(self, time, qpos, qvel, sensordata):
        return 50.0 * qpos[:, 1:] + 8.0 * qvel[:, 1:] + 2.0 * qpos[:, :1] + 4.0 * qvel[:, :1]
"""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    (tmp_path / "cart.xml").write_text(CART_POLE)
    (tmp_path / "balance.py").write_text(POLICY)
    sweep = {"version": 1, "scene": str(tmp_path / "cart.xml"), "checks": "all"}
    sweep |= {"axes": {"perturbation": [0]}}
    sweep |= {
        "duration": STEPS * STEP,
        "drive": {"policy": f"{tmp_path / 'balance.py'}:Balance", "rate": 250},
    }
    return contactlab.sweep(sweep, output=tmp_path / "store", workers=0, allow_code=True)


def speeds(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return (bodies, 6) velocities of centres of mass, and spins times radii of gyration [m/s]."""
    mujoco.mj_forward(model, data)
    along, about = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    found = list[Floats]()
    for body in range(1, model.nbody):
        mujoco.mj_jacBodyCom(model, data, along, about, body)
        radius = np.sqrt(model.body_inertia[body].max() / model.body_mass[body])
        found.append(np.concatenate([along @ data.qvel, radius * (about @ data.qvel)]))
    return np.array(found)


def motion(controls: Floats, rate: int) -> Floats:
    """Return (rate (N + 1) + 1, bodies, 6) velocities at `rate` steps to one of the run."""
    model = mujoco.MjModel.from_xml_string(CART_POLE)
    model.opt.timestep = STEP / rate
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    found = [speeds(model, data)]
    for control in [*controls, controls[-1]]:
        data.ctrl[:] = control
        for _ in range(rate):
            mujoco.mj_step(model, data)
            state = mujoco.MjData(model)
            state.qpos[:], state.qvel[:] = data.qpos, data.qvel
            found.append(speeds(model, state))
    return np.array(found)


def distance(point: Floats, path: Floats) -> float:
    """Return how far a point is from straight lines between the points of a path."""
    found = list[float]()
    for begin, end in pairwise(path):
        part = (point - begin) @ (end - begin) / ((end - begin) @ (end - begin))
        nearest = begin + min(max(part, 0), 1) * (end - begin)
        found.append(float(np.linalg.norm(point - nearest)))
    return min(found)


def shares(controls: Floats) -> list[float]:
    """Return the backward error of each body by the definition, in one window of the run."""
    own, fine, found = motion(controls, 1), motion(controls, FINER), list[float]()
    for body in range(own.shape[1]):
        run, reference = own[:, body], fine[:, body]
        apart = max(
            distance(run[STEPS], reference[FINER * (STEPS - 1) :]),
            distance(reference[FINER * STEPS], run[STEPS - 1 :]),
        )
        coarse = reference[: FINER * STEPS + 1 : FINER]
        path = np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum()
        fallen = 0.1 * 9.81 * STEPS * STEP
        found.append(apart / (np.linalg.norm(run[0]) + path + fallen))
    return found


def test_it_is_that_of_the_controls_which_the_policy_gave(store: Store) -> None:
    """By a slow loop. Sums of some hundred terms of 1e-16 leave a share of 1e-3 right to 1e-10.

    Without the controls another motion would be judged, whose error is another one.
    """
    record: EvidenceRecord = next(iter(store.records()))
    recorded = store.controls(record)
    assert recorded is not None
    held = np.searchsorted(recorded.times, STEP * (np.arange(STEPS) + 0.5)) - 1
    given = recorded.levels[held]
    assert len(np.unique(given)) == STEPS
    found, expected = record.metrics["backward_error"], shares(given)
    assert found == pytest.approx(max(expected), rel=1e-9)
    assert record.backward_error_body == ("cart", "pole")[int(np.argmax(expected))]
    assert record.metrics["backward_error_time"] == 0
    assert found != pytest.approx(max(shares(0 * given)), rel=0.05)
