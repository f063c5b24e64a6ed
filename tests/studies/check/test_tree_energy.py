"""The energy of each kinematic tree is that which it has alone."""

import mujoco
import numpy as np
import pytest

from contactlab.studies.check.free_motion import falls, tree_energies, trees_of

BALL = """<body name="ball" pos="0 0 1"><freejoint/>
  <geom size=".1" mass="2"/><geom pos=".3 -.1 .2" type="box" size=".1 .05 .02" mass="1"/>
</body>"""
ARM = """<body name="arm" pos="1 0 1"><joint name="hinge" axis="0 1 0" stiffness="3"/>
  <geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="1"/></body>"""
WALKER = """<body name="walker" pos="2 0 1"><freejoint/><geom size=".1"/>
  <body pos=".1 0 0"><joint name="hip" axis="0 1 0" stiffness="5" springref="20"/>
    <geom size=".05" pos=".1 0 0"/></body></body>"""
MODEL = '<mujoco><option gravity="1 -2 -9"/><worldbody>{}</worldbody>{}</mujoco>'


def compiled(*bodies: str, rest: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL.format("".join(bodies), rest))


def state(generator: np.random.Generator, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    qpos = generator.normal(size=model.nq)
    mujoco.mj_normalizeQuat(model, qpos)
    return qpos, generator.normal(size=model.nv)


def test_each_tree_has_the_energy_that_it_has_alone() -> None:
    whole = compiled(BALL, ARM, WALKER)
    trees = trees_of(whole)
    assert [tree.name for tree in trees] == ["ball", "arm", "walker"]
    assert [falls(compiled(each)) for each in (BALL, ARM, WALKER)] == [True, False, True]
    qpos, qvel = state(np.random.default_rng(0), whole)
    energies = tree_energies(whole, trees, qpos[None], qvel[None])
    first_position, first_velocity = 0, 0
    for place, body in enumerate((BALL, ARM, WALKER)):
        alone = compiled(body)
        last_position, last_velocity = first_position + alone.nq, first_velocity + alone.nv
        expected = energy(
            alone, qpos[first_position:last_position], qvel[first_velocity:last_velocity]
        )
        # Sums of some tens of joules: rounding stays below 1e-12 of them.
        np.testing.assert_allclose([each[place, 0] for each in energies], expected, atol=1e-11)
        first_position, first_velocity = last_position, last_velocity


def test_trees_that_a_spring_couples_are_one() -> None:
    rest = """<tendon><fixed stiffness="2">
      <joint joint="hinge" coef="1"/><joint joint="hip" coef="1"/></fixed></tendon>"""
    model = compiled(ARM, WALKER, rest=rest)
    (tree,) = trees_of(model)
    assert tree.dofs.all()
    qpos, qvel = state(np.random.default_rng(1), model)
    found = tree_energies(model, [tree], qpos[None], qvel[None])
    np.testing.assert_allclose(np.ravel(found), energy(model, qpos, qvel), atol=1e-11)


@pytest.mark.parametrize(
    ("joint", "floats"),
    [
        ('type="slide" axis="1 0 0"', False),
        ('type="slide" axis="0 0 1"', True),
        ('type="slide" axis="0 0 1" stiffness="100"', False),
        ('type="hinge" axis="0 1 0"', False),
    ],
)
def test_a_root_floats_if_gravity_moves_it_freely(joint: str, floats: bool) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body><joint {joint}/><geom size='.1'/></body></worldbody></mujoco>"
    )
    assert falls(model) == floats


def energy(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Return MuJoCo's own kinetic and potential energy of a whole model."""
    data = mujoco.MjData(model)
    data.qpos, data.qvel = qpos, qvel
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return np.array([data.energy[1], data.energy[0]])
