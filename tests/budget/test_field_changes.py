"""Changes of physics: closed forms of what a step can hold, and which parts they change."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from tests.budget.test_rows import servo
from tests.budget_motions import motion_of, walker
from tests.budget_reasons import budget_reason

from contactlab.budget import Motion, Settings, Trial, error_budget, judge, try_fixes
from contactlab.budget.field_changes import field_changes, joint_inertias
from contactlab.budget.reference_distance import FINEST, ChangedModel, distances_to_reference
from contactlab.budget.verdict import Verdict, VerdictWord
from contactlab.modifications.modification import Candidate

FAST = Settings(energy=False)


def against(
    motion: Motion, place: str, word: VerdictWord = "inaccurate", row: str = "numerical error"
) -> dict[str, Candidate]:
    reason = budget_reason(word, motion.name, row, 0.5, "", place)
    found = field_changes([motion], Verdict(word, 0.1, (reason,)))
    return {change.apply: change for change in found}


def made(motion: Motion, change: Candidate) -> mujoco.MjModel:
    model = copy.copy(motion.model)
    change.change(model)
    return model


def load(model: mujoco.MjModel, inertia: float) -> float:
    """Return h^2 k / I + 2 h c / I of the last actuator, less what damping adds to the bound."""
    step, bias = model.opt.timestep, model.actuator_biasprm[-1]
    return float((-(step**2) * bias[1] - 2 * step * bias[2]) / inertia)


# k and c of a servo that a step of 5 ms cannot hold: for its stiffness, its damping, or both.
@pytest.mark.parametrize(("kp", "kv"), [(400.0, 0.0), (0.0, 2.0), (300.0, 3.0)])
def test_gains_have_a_quarter_of_the_bound_and_the_same_damping_ratio(kp: float, kv: float) -> None:
    """Two digits, rounded down: k loses a tenth at most, and c too, so their load does."""
    motion = servo()
    motion.model.actuator_biasprm[-1, 1:3] = -kp, -kv
    motion.model.actuator_gainprm[-1, 0] = kp or kv
    change = against(motion, "joint left_knee")["gains"]
    (inertia,) = joint_inertias(motion, [motion.model.joint("left_knee").id])
    model = made(motion, change)
    assert load(motion.model, inertia) > 1
    assert 0.9 - 1e-9 <= load(model, inertia) <= 1 + 1e-9
    old, new = motion.model.actuator_biasprm[-1], model.actuator_biasprm[-1]
    assert new[1] * old[2] ** 2 == pytest.approx(old[1] * new[2] ** 2, rel=0.21)
    ratio = motion.model.actuator_gainprm[-1, 0] / (kp or kv)
    assert model.actuator_gainprm[-1, 0] == pytest.approx(-ratio * (new[1] or new[2]))


def test_a_servo_that_the_step_holds_is_left_alone() -> None:
    motion = servo()
    motion.model.actuator_biasprm[-1, 1:3] = -1e-3, -1e-3
    assert against(motion, "joint left_knee") == {}
    assert against(servo(), "contact world - thigh") == {}


TWO_WHEELS = """<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody>
  <body name="left"><joint name="l"/><geom size=".1" mass=".1" contype="0"/></body>
  <body name="right" pos="1 0 0"><joint name="r"/><geom size=".1" mass=".2" contype="0"/></body>
  <body name="free" pos="2 0 0"><joint name="f"/><geom size=".1" mass="1" contype="0"/></body>
</worldbody>
<equality><joint name="mesh" joint1="l" joint2="f"/></equality>
<actuator><velocity joint="l" kv="5"/><velocity jointinparent="r" kv="5"/></actuator></mujoco>"""


@pytest.mark.parametrize("place", ["joint l", "contact world - left", "equality mesh"])
def test_servos_that_the_step_does_not_hold_are_changed_alone_and_together(place: str) -> None:
    """A wheel's inertia is 2/5 m r^2; its armature makes it 2 h kv, of which b is a half."""
    found = against(motion_of(TWO_WHEELS, 0.1), place)
    words = "gains", "armature", "damping"
    assert [*found] == [*words, *(f"{word}-all" for word in words)]
    assert all(found[f"{word}-all"].includes == (found[word].name,) for word in words)
    assert [value.axis for value in found["armature"].values] == ["dof_armature[l]"]
    every = found["armature-all"].values
    assert [value.axis for value in every] == ["dof_armature[l]", "dof_armature[r]"]
    for value, mass in zip(every, (0.1, 0.2), strict=True):
        assert value.value == pytest.approx(2 * 0.002 * 5 - 0.4 * mass * 0.1**2, rel=0.06)


def test_the_bound_is_that_of_the_recurrence() -> None:
    """At the bound, x' = x + h v' with v' (1 + d) = v (1 - b) - a x / h has a root of size 1."""
    random = np.random.default_rng(0)
    for first, second, implicit in random.uniform(0, 2, (200, 3)):
        damped = 1 / (1 + implicit)
        down, along = -first * damped, (1 - second) * damped
        roots = np.abs(np.linalg.eigvals([[1 + down, along], [down, along]]))
        held = first + 2 * second < 4 + 2 * implicit
        assert held == bool(roots.max() < 1) or abs(roots.max() - 1) < 1e-9


def test_armature_adds_to_the_inertia_of_its_joint() -> None:
    """(M + a e e^T)^-1 has 1 / (I + a) in that place (Sherman and Morrison)."""
    motion = walker(seconds=0.1)
    joint = int(motion.model.joint("knee").id)
    dof = int(motion.model.jnt_dofadr[joint])
    data = mujoco.MjData(motion.model)
    mujoco.mj_forward(motion.model, data)
    full = np.zeros((motion.model.nv, motion.model.nv))
    mujoco.mj_fullM(motion.model, data, full)
    (inertia,) = joint_inertias(motion, [joint])
    assert inertia == pytest.approx(1 / np.linalg.inv(full)[dof, dof])
    motion.model.dof_armature[dof] += 0.3
    mujoco.mj_setConst(motion.model, mujoco.MjData(motion.model))
    assert joint_inertias(motion, [joint]) == pytest.approx([inertia + 0.3])


@pytest.mark.parametrize("word", ["armature", "damping", "gains"])
def test_each_holds_the_servo_and_comes_nearer(word: str) -> None:
    """The knee is unstable at 5 ms; each change alone removes that, judged by a budget."""
    motion = servo()
    verdict = judge(error_budget([motion], rows=[], settings=FAST))
    tried = try_fixes([motion], verdict, trial=Trial(FAST, most=0, requested=[word]))
    (found,) = (remedy for remedy in tried if remedy.apply == word)
    assert found.removes
    assert found.changes_model
    assert found.distance < found.distance_before
    assert found.edits.settings


def test_a_quarter_of_the_solref_is_of_the_named_joint_alone() -> None:
    """What gives goes with its square: of five times the tolerance a sixteenth is left."""
    motion = walker(seconds=0.1)
    found = against(motion, "joint knee", "depends", "limit softness")
    model = made(motion, found["solref"])
    changed = np.flatnonzero((model.jnt_solref != motion.model.jnt_solref).any(axis=1))
    assert changed.tolist() == [int(motion.model.joint("knee").id)]
    assert model.joint("knee").solref[0] == motion.model.joint("knee").solref[0] / 4
    every = made(motion, found["solref-all"])
    limited = motion.model.jnt_limited > 0
    np.testing.assert_array_equal(
        every.jnt_solref[limited, 0], motion.model.jnt_solref[limited, 0] / 4
    )
    np.testing.assert_array_equal(every.jnt_solref[~limited], motion.model.jnt_solref[~limited])


def test_the_step_holds_a_shorter_time_constant() -> None:
    """A constant of three steps, a quarter of it, is two steps long at a quarter of the step.

    A change that is enough alone has none of its harder ones beside it.
    """
    motion = walker(seconds=0.1)
    model = copy.copy(motion.model)
    model.jnt_solref[:, 0] = 3 * model.opt.timestep
    found = against(replace(motion, model=model), "joint knee", "depends", "limit softness")
    assert found["solref"].rate == 4
    assert found["solref"].values[0].value == (0.75 * model.opt.timestep, 1)
    assert found["solref"].includes == ()
    model.jnt_solref[:, 0] = 100 * model.opt.timestep
    longer = against(replace(motion, model=model), "joint knee", "depends", "limit softness")
    assert longer["solref-16"].includes == (longer["solref"].name,)


def test_what_goes_further_is_as_stiff_as_a_quarter_of_the_step_holds() -> None:
    """A quarter of four steps takes half the step; a sixteenth would take an eighth."""
    motion = walker(seconds=0.1)
    model = copy.copy(motion.model)
    model.jnt_solref[:, 0] = 4 * model.opt.timestep
    found = against(replace(motion, model=model), "joint knee", "depends", "limit softness")
    rates = {word: change.rate for word, change in found.items() if "all" not in word}
    assert rates == {"solref": 2, "solref-8": 4}


def test_the_solref_of_a_contact_is_of_its_geoms() -> None:
    motion = walker(seconds=0.1)
    found = against(motion, "contact world - leg", "depends", "contact softness")
    names = {value.axis for value in found["solref"].values}
    assert "geom_solref[floor]" in names
    bodies = {int(motion.model.geom_bodyid[value.place[0]]) for value in found["solref"].values}
    assert bodies == {0, int(motion.model.body("leg").id)}


def test_a_finer_step_is_nearer_to_the_finest() -> None:
    """And the finest is no distance from itself: its states and inputs are the same bits."""
    xml = """<mujoco><option timestep=".004" iterations="100" ls_iterations="50" tolerance="1e-12"/>
        <worldbody><body><joint axis="0 1 0"/><geom type="capsule" size=".02"
        fromto="0 0 0 .5 0 0" mass="1" contype="0"/></body></worldbody></mujoco>"""
    motion = motion_of(xml, 0.4)

    def finer(rate: int) -> ChangedModel:
        model = copy.copy(motion.model)
        model.opt.timestep /= rate
        return ChangedModel(model, rate)

    rates = 1, 2, 4, FINEST
    apart = distances_to_reference(motion, [finer(rate) for rate in rates], settings=FAST)
    assert apart == sorted(apart, reverse=True)
    assert apart[0] > 0
    assert apart[-1] == 0
