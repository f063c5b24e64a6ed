"""Rows of a budget: what was planted is found, what was never loaded says so."""

import mujoco
import numpy as np
import pytest
from tests.budget_motions import motion_of, walker

from contactlab.budget import ErrorBudget, Motion, Reading, Settings, error_budget, judge
from contactlab.engines.older_mujoco import StepLoop
from contactlab.modifications.catalogue import list_rows
from contactlab.modifications.model_changes import stiffen_solref
from contactlab.modifications.modification import Row
from contactlab.scene.part_bodies import is_mocap_driven

FAST = Settings(energy=False, places=False)


def reading(motion: Motion, name: str) -> Reading | None:
    budget = error_budget([motion], rows=[name], settings=FAST, workers=1)
    return next((row for row in budget.phases[0].rows if row.name == name), None)


def on_floor(*, tilt: float = 0.0, option: str = "", geom: str = "", height: float = 0.0499) -> str:
    """Put a box of 1 kg on a floor, under gravity that is tilted by degrees."""
    angle = np.radians(tilt)
    gravity = f"{9.81 * np.sin(angle)} 0 {-9.81 * np.cos(angle)}"
    return f"""<mujoco><option timestep=".002" gravity="{gravity}" {option}/><worldbody>
        <geom name="floor" type="plane" size="0 0 1"/>
        <body name="box" pos="0 0 {height}"><freejoint/>
        <geom type="box" size=".1 .1 .05" mass="1" {geom}/></body></worldbody></mujoco>"""


def test_friction_that_holds_a_box_is_worth_its_weight() -> None:
    """Without friction it would fall down the slope by g sin 20 T in each window of T.

    The real impulse of what stands is set to g T / 10, so the share is 10 sin 20 = 3.42: slack
    takes nothing from it, since the box is at rest at all times. It creeps by less than 1 %.
    """
    found = reading(motion_of(on_floor(tilt=20), 0.4), "condim 1")
    assert found is not None
    assert found.exercised
    assert found.error == pytest.approx(3.42, rel=0.01)


def test_friction_that_is_never_loaded_says_so() -> None:
    """A box that stands on level ground, at its rest, has tangential forces of rounding."""
    ball = """<mujoco><option cone="elliptic"/><worldbody><geom type="plane" size="0 0 1"/>
        <body pos="0 0 .2"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody>
        </mujoco>"""
    for name in ("condim 1", "impratio", "friction 10 %", "noslip"):
        found = reading(motion_of(ball, 0.4), name)
        assert found is not None
        assert not found.exercised
        assert np.isnan(found.error)


PENDULUM = """<mujoco><option timestep=".002" {option}/><worldbody>
    <body name="rod"><joint name="hinge" axis="0 1 0" {joint}/>
    <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" mass="1" contype="0"/></body></worldbody>
    {rest}</mujoco>"""


def pendulum(option: str = "", joint: str = "", rest: str = "") -> Motion:
    xml = PENDULUM.format(option=option, joint=joint, rest=rest)
    model = mujoco.MjModel.from_xml_string(xml)
    return motion_of(xml, 0.4, controls=np.full((1, 200, model.nu), 2.0))


MOTOR = '<actuator><motor joint="hinge" ctrlrange="-{0} {0}"/></actuator>'


@pytest.mark.parametrize(
    ("name", "motion", "exercised"),
    [
        ("limits", pendulum(joint='range="-10 40"'), True),
        ("limits", pendulum(joint='range="-175 175"'), False),
        ("damping", pendulum(joint='damping=".5"'), True),
        ("springs", pendulum(joint='stiffness="5"'), True),
        ("friction loss", pendulum(joint='frictionloss=".5"'), True),
        ("fluid", pendulum(option='density="1000"'), True),
        ("clamps", pendulum(rest=MOTOR.format(1)), True),
        ("clamps", pendulum(rest=MOTOR.format(3)), False),
        ("gravity", pendulum(), True),
        ("refsafe", pendulum(joint='range="-10 40" solreflimit=".002 1"'), True),
        ("refsafe", pendulum(joint='range="-175 175" solreflimit=".002 1"'), False),
    ],
)
def test_what_is_used_has_a_share(name: str, motion: Motion, exercised: bool) -> None:
    found = reading(motion, name)
    assert found is not None
    assert found.exercised == exercised
    assert found.error > 1e-3 if exercised else np.isnan(found.error)


@pytest.mark.parametrize(
    "name",
    ["limits", "damping", "springs", "friction loss", "fluid", "clamps", "equalities", "tendons",
     "gravity compensation", "refsafe", "solver", "cone", "margin"],
)  # fmt: skip
def test_what_a_model_lacks_has_no_row(name: str) -> None:
    assert reading(pendulum(), name) is None


@pytest.mark.interface
@pytest.mark.parametrize("row", list_rows(), ids=lambda row: row.name)
def test_a_row_changes_the_model_that_it_is_given_alone(row: Row) -> None:
    """Every row can be made of a model that has nothing, and leaves its own model as it was."""
    own = walker().model
    before = own.opt.timestep, own.opt.disableflags, own.geom_condim.copy(), own.body_mass.copy()
    for change in row.changes:
        copy = mujoco.MjModel.from_xml_string("<mujoco/>")
        change(copy, own)
    assert (own.opt.timestep, own.opt.disableflags) == before[:2]
    np.testing.assert_array_equal(own.geom_condim, before[2])
    np.testing.assert_array_equal(own.body_mass, before[3])


def test_stiffer_solrefs_have_twice_the_frequency_in_both_forms() -> None:
    """The forms (tc, dr) and (-K, -B), K = 1 / (tc dr)^2, B = 2 / tc, stay equivalent."""
    time, ratio = 0.02, 0.7
    direct = [-1 / (time * ratio) ** 2, -2 / time]
    standard, other = stiffen_solref(np.array([[time, ratio], direct]))
    np.testing.assert_allclose(
        other, [-1 / (standard[0] * standard[1]) ** 2, -2 / standard[0]], rtol=1e-14
    )
    assert other[0] == pytest.approx(4 * direct[0])


def test_a_solver_that_stops_early_is_told_from_the_step() -> None:
    poor = walker(0.002, solver="PGS", iterations=1)
    phase = error_budget([poor], rows=["step", "solver"], settings=FAST).phases[0]
    step, solver = phase.rows
    assert solver.error > 3 * step.error
    good = error_budget([walker(0.002)], rows=["solver"], settings=FAST).phases[0].rows[0]
    assert good.error < 1e-3 * solver.error


def test_regularised_friction_creeps_and_noslip_tells() -> None:
    """A box that hangs between two pads: it creeps, and nothing else is wrong.

    With impratio 1000 and noslip there is a tenth of that left to find, at most.
    """
    squeezed = """<mujoco><option timestep=".002" cone="elliptic" {option}/><worldbody>
        <body name="box"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>
        <body pos=".1 0 0"><joint name="right" type="slide" axis="1 0 0" damping="20"/>
        <geom type="box" size=".05 .05 .05" mass="1"/></body>
        <body pos="-.1 0 0"><joint name="left" type="slide" axis="1 0 0" damping="20"/>
        <geom type="box" size=".05 .05 .05" mass="1"/></body></worldbody>
        <actuator><motor joint="right"/><motor joint="left"/></actuator></mujoco>"""
    shares = []
    for option in ("", 'impratio="1000" noslip_iterations="20"'):
        controls = np.tile([-50.0, 50.0], (1, 200, 1))
        motion = motion_of(squeezed.format(option=option), 0.4, controls=controls)
        found = reading(motion, "noslip")
        assert found is not None
        shares.append(found.error)
    assert shares[0] > 0.02
    assert shares[1] < 0.1 * shares[0]


SERVO = """<mujoco><option timestep="{step}" integrator="{integrator}"/><worldbody>
    <body name="thigh"><joint name="hip" axis="0 1 0" damping="1"/>
    <geom type="capsule" size=".04" fromto="0 0 0 0 0 -.4" mass="2"/>
    <body name="shank" pos="0 0 -.4"><joint name="left_knee" axis="0 1 0" armature=".001"/>
    <geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".05"/></body></body></worldbody>
    <actuator><position joint="left_knee" kp="20" kv="{damping}"/></actuator></mujoco>"""


def servo(step: float = 0.005, integrator: str = "Euler", damping: float = 0.7) -> Motion:
    steps = round(0.8 / step)
    controls = np.full((1, steps, 1), 0.5)
    xml = SERVO.format(step=step, integrator=integrator, damping=damping)
    return motion_of(xml, 0.8, controls=controls)


def test_a_servo_that_is_unstable_at_its_step_is_named() -> None:
    """Euler's damping of a servo is explicit: unstable where h kv / I > 2.

    The knee's inertia is .001 + .05 .2^2 / 3 = .00167 kg m^2 and more: 5 ms .7 / .00167 = 2.1.
    """
    budget = error_budget([servo()], rows=["step", "solver"])
    verdict = judge(budget)
    assert verdict.word == "inaccurate"
    reason = verdict.reasons[0]
    assert "left_knee" in reason.place
    assert reason.body == "shank"
    for better in (servo(0.0025), servo(integrator="implicitfast")):
        assert judge(error_budget([better], rows=["step", "solver"])).word == "ok"


LED = """<mujoco><option gravity="0 0 0" timestep=".002"/><worldbody>
    <body name="hand" pos="{start} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".05" mass="1"
    contype="0"/>{site}</body><body name="lead" {mocap}>{site_of_lead}</body></worldbody>
    <equality><weld {ends} solref=".1 1"/></equality></mujoco>"""
BY_BODIES = {"ends": 'body1="lead" body2="hand" relpose="0 0 0 1 0 0 0"'}


def led(mocap: bool = True, *, sites: bool = False) -> Motion:
    parts = {"site": "", "site_of_lead": "", **BY_BODIES}
    if sites:
        parts = {"site": '<site name="a"/>', "site_of_lead": '<site name="b"/>'}
        parts["ends"] = 'site1="b" site2="a"'
    return motion_of(LED.format(start=0.3, mocap='mocap="true"' if mocap else "", **parts), 0.3)


@pytest.mark.parametrize("sites", [False, True])
def test_a_weld_by_which_a_mocap_body_leads_is_no_softness(sites: bool) -> None:
    """The same weld to a body of the world is: with half the time constant, it draws faster."""
    joined = reading(led(mocap=False, sites=sites), "equality softness")
    assert joined is not None
    assert joined.error > 0.1
    assert reading(led(sites=sites), "equality softness") is None
    assert list(is_mocap_driven(led(sites=sites).model)) == [True]


def test_beside_a_mocap_body_s_weld_other_equalities_are_judged() -> None:
    """Of two welds alike, one that leads and one that joins, the second alone is made stiffer."""
    text = LED.format(start=0.3, mocap='mocap="true"', site="", site_of_lead="", **BY_BODIES)
    fixed = (
        '<body name="post" pos=".3 0 0"/></worldbody><equality><weld body1="post" body2="hand"/>'
    )
    both = text.replace("</worldbody>", "", 1).replace("<equality>", fixed, 1)
    motion = motion_of(both, 0.3)
    assert list(is_mocap_driven(motion.model)) == [False, True]
    found = reading(motion, "equality softness")
    assert found is not None
    assert found.exercised


def test_a_divergence_is_infinite_and_names_the_joint() -> None:
    budget = error_budget([servo(0.005, damping=8.0)], rows=[])
    phase, verdict = budget.phases[0], judge(budget)
    assert np.isinf(phase.run.error)
    assert verdict.word == "inaccurate"
    assert verdict.reasons[0].row == "warning"
    assert verdict.reasons[0].place == "joint left_knee"


def test_energy_that_grows_is_told_where_no_window_shows_it() -> None:
    """A free top under Euler gains energy in each step, little in a window; RK4 does not."""
    top = """<mujoco><option timestep=".005" gravity="0 0 0" integrator="{}"/><worldbody>
        <body><freejoint/><geom type="box" size=".1 .02 .05" mass="1"/></body></worldbody>
        </mujoco>"""
    spin = [0.0, 0, 0, 2, 8, 3]
    grows = error_budget([motion_of(top.format("Euler"), 4.0, qvel=spin)])
    assert judge(grows).word == "inaccurate"
    assert grows.phases[0].energy_drift > 0.1
    assert any(reason.row == "energy" for reason in judge(grows).reasons)
    keeps = error_budget([motion_of(top.format("RK4"), 4.0, qvel=spin)])
    assert abs(keeps.phases[0].energy_drift) < 0.01
    assert judge(keeps).word == "ok"


def test_a_reference_that_gains_what_was_never_there_says_nothing_of_energy() -> None:
    """RK4 at h / 2 multiplies the speed by 1.8 a step where h d / 2 m is 3.2; the run brakes it."""
    braked = """<mujoco><option timestep=".005" gravity="0 0 0" integrator="implicitfast"/>
        <worldbody><body><joint name="j" type="slide" damping="1280"/><geom size=".1" mass="1"/>
        </body></worldbody><actuator><motor joint="j"/></actuator></mujoco>"""
    pushed = np.where(np.arange(80) < 60, 0.0, 1280.0)[None, :, None]
    budget = error_budget([motion_of(braked, 0.4, controls=pushed)], rows=[])
    assert budget.phases[0].energy_drift == pytest.approx(0, abs=0.01)
    assert np.isnan(budget.phases[0].energy_rk4).all()


def test_an_energy_is_told_of_the_body_that_gains_it() -> None:
    """A ball whose bounces gain, beside a heavier one that swings on a spring."""
    xml = """<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="0 0 1"/>
        <body name="ball" pos="0 0 .6"><joint name="drop" type="slide" axis="0 0 1"/>
        <geom size=".1" mass="1" solref="-30000 0" solimp=".99 .99 .001" priority="1"/></body>
        <body name="weight" pos="1 0 1"><joint type="slide" axis="1 0 0" stiffness="8"/>
        <geom size=".1" mass="4"/></body></worldbody></mujoco>"""
    budget = error_budget([motion_of(xml, 2.0, qpos=[0, 0.3])], rows=[])
    (reason,) = (reason for reason in judge(budget).reasons if reason.row == "energy")
    assert reason.body == "ball"
    assert "ball" in reason.place
    # It falls by .5 m first: nothing can be gained before it bounces.
    assert reason.time > np.sqrt(2 * 0.5 / 9.81) - budget.phases[0].window
    assert reason.sentence.endswith(", most in ball")


def test_a_reference_that_is_not_resolved_is_never_sound() -> None:
    """A contact so stiff and elastic that even an eighth of the step differs from a quarter."""
    xml = """<mujoco><option timestep=".004" integrator="implicitfast"/><worldbody>
        <geom type="plane" size="0 0 1"/><body pos="0 0 .101"><freejoint/>
        <geom size=".1" mass="1" solref="-4e6 -100" priority="1"/></body></worldbody></mujoco>"""
    verdict = judge(error_budget([motion_of(xml, 0.6)], rows=[]))
    assert verdict.word in ("inaccurate", "undecided")


def test_softness_that_is_meant_is_not_judged() -> None:
    soft = on_floor(geom='solref=".2 1"', height=0.049)
    budget = error_budget([motion_of(soft, 0.4)])
    rows = {reason.row for reason in judge(budget).reasons}
    assert judge(budget).word == "depends"
    assert judge(budget, intended=sorted(rows)).word == "ok"
    assert isinstance(budget, ErrorBudget)


DELAYED = """<mujoco><option timestep=".005"/><worldbody><body><joint name="hinge" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/></body></worldbody>
    <actuator><motor joint="hinge" {}/></actuator></mujoco>"""


def test_a_delay_is_as_long_in_a_reference_as_in_the_run() -> None:
    """A motor that sees its controls 8 steps late moves as one that is given them 8 steps late.

    In a reference of finer steps the buffer of 8 samples would hold 2 steps of the run.
    """
    controls = np.sign(np.sin(np.arange(80) * 0.2))[None, :, None]
    late = np.concatenate([np.zeros((1, 8, 1)), controls[:, :-8]], axis=1)
    delayed, shifted = (
        error_budget([motion_of(xml, 0.4, controls=inputs)], rows=["step"], settings=FAST)
        for xml, inputs in (
            (DELAYED.format('delay=".04" nsample="8"'), controls),
            (DELAYED.format(""), late),
        )
    )
    assert delayed.error == pytest.approx(shifted.error, rel=1e-9)
    assert shifted.error > 1e-4


def test_a_box_that_sleeps_in_mid_motion_is_told() -> None:
    """Sleep stops a box that creeps down a slope slower than sleep tolerates."""
    asleep = on_floor(tilt=20, option='sleep_tolerance=".1"').replace(
        "/><worldbody>", '><flag sleep="enable"/></option><worldbody>'
    )
    found = reading(motion_of(asleep, 1.0), "sleep")
    assert found is not None
    assert found.exercised
    assert found.error > 1e-3


def test_impratio_is_of_friction_alone() -> None:
    """A stack under pyramids sinks as impratio says, which is no matter of friction.

    The row is of elliptic cones on both sides, where level boxes have no tangential forces.
    """
    boxes = "".join(
        f"""<body pos="0 0 {0.05 + 0.0995 * level}"><freejoint/>
        <geom type="box" size=".05 .05 .05" mass="1"/></body>"""
        for level in range(4)
    )
    xml = f"""<mujoco><worldbody><geom type="plane" size="0 0 1"/>{boxes}</worldbody></mujoco>"""
    found = reading(motion_of(xml, 0.6), "impratio")
    assert found is not None
    assert np.isnan(found.error) or found.error < 1e-3


@pytest.mark.long
def test_versions_without_batches_give_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops over `mj_step` have the names of what batches do, and the bits."""
    by_batches = error_budget([walker(seconds=0.2)], settings=FAST)
    monkeypatch.setattr("contactlab.budget.windows.Batch", StepLoop)
    monkeypatch.setattr("contactlab.budget.windows.has_batch", lambda: False)
    by_loops = error_budget([walker(seconds=0.2)], settings=FAST)
    for row, same in zip(by_batches.phases[0].rows, by_loops.phases[0].rows, strict=True):
        np.testing.assert_array_equal(row.errors, same.errors)
