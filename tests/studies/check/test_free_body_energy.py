"""The energies of free bodies and of the mechanism add up to that of the whole model."""

import mujoco
import numpy as np

from contactlab.studies.check.free_motion_runs import free_body_energy, single_free_bodies

MODEL = """<mujoco>
  <option gravity="1 -2 -9"/>
  <worldbody>
    <body name="ball" pos="0 0 1"><freejoint/>
      <geom size=".1" mass="2"/><geom pos=".3 -.1 .2" type="box" size=".1 .05 .02" mass="1"/>
      <body pos="0 .2 0" euler="10 20 30"><geom type="capsule" size=".02 .2" mass=".5"/></body>
    </body>
    <body name="arm" pos="1 0 1"><joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="1"/></body>
    <body name="walker" pos="2 0 1"><freejoint/><geom size=".1"/>
      <body pos=".1 0 0"><joint axis="0 1 0"/><geom size=".05" pos=".1 0 0"/></body></body>
  </worldbody>
</mujoco>"""


def test_a_single_free_body_carries_no_moving_body() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert [model.body(each).name for each in single_free_bodies(model)] == ["ball"]


def test_without_the_body_the_rest_is_left() -> None:
    """E(whole) - E(free body) is MuJoCo's energy of the same model without the free body."""
    whole = mujoco.MjModel.from_xml_string(MODEL)
    spec = mujoco.MjSpec.from_string(MODEL)
    spec.delete(spec.body("ball"))
    rest = spec.compile()
    generator = np.random.default_rng(0)
    for _ in range(20):
        qpos = generator.normal(size=whole.nq)
        for start in (3, 11):
            qpos[start : start + 4] /= np.linalg.norm(qpos[start : start + 4])
        qvel = generator.normal(size=whole.nv)
        energies = [_energy(model, qpos[-model.nq :], qvel[-model.nv :]) for model in (whole, rest)]
        loose = free_body_energy(whole, single_free_bodies(whole), qpos[None], qvel[None])
        left = energies[0] - np.concatenate(loose)
        # Sums of some tens of joules: rounding stays below 1e-12 of them.
        np.testing.assert_allclose(left, energies[1], atol=1e-11)


def _energy(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos, data.qvel = qpos, qvel
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return np.array([data.energy[1], data.energy[0]])
