"""What soft constraints store, against closed forms and against steps that are fine."""

import mujoco
import numpy as np
import pytest
from tests.budget_motions import motion_of

from contactlab.budget import Settings, error_budget
from contactlab.budget.constraint_energy import ConstraintEnergy
from contactlab.budget.motion import INTEGRATION

STIFFNESS, DAMPED = 2e4, 0.9
BALL = """<mujoco><option timestep="{h}" iterations="100" tolerance="1e-12" {option}/>
<default><geom solref="-{k} 0" solimp="{solimp}"/></default>
<worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .3"><freejoint/>
<geom size=".1" mass="2"/></body></worldbody></mujoco>"""
STOP = """<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody><body>
<joint type="slide" axis="1 0 0" range="-1 .1" solreflimit="-{k} 0" solimplimit="{solimp}"
 stiffness="{spring}" springref="{ref}"/><geom size=".1" mass="2"/></body></worldbody></mujoco>"""
TIED = """<mujoco><option timestep="{h}"/><worldbody><body name="arm" pos="0 0 .5">
<joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/></body>
<body name="bob" pos=".3 0 .5"><freejoint/><geom size=".02" mass="1"/></body></worldbody>
<equality><connect body1="arm" body2="bob" anchor=".3 0 0" solref="-{k} 0" solimp="{solimp}"/>
</equality><contact><exclude body1="arm" body2="bob"/></contact></mujoco>"""
CONSTANT, WIDE = f"{DAMPED} {DAMPED} .001", "0 .95 .05"


def _model(
    xml: str, solimp: str, h: float = 1e-4, option: str = "", **more: float
) -> mujoco.MjModel:
    text = xml.format(h=h, k=STIFFNESS, solimp=solimp, option=option, **more)
    return mujoco.MjModel.from_xml_string(text)


def _states(model: mujoco.MjModel, steps: int, every: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return (K, nstate) states of a run and (K,) their mechanical energies [J]."""
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data, rows, energies = mujoco.MjData(model), list[np.ndarray](), list[float]()
    for step in range(steps):
        if step % every == 0:
            rows.append(np.empty(mujoco.mj_stateSize(model, INTEGRATION)))
            mujoco.mj_getState(model, data, rows[-1], INTEGRATION)
            mujoco.mj_forward(model, data)
            energies.append(float(data.energy.sum()))
        mujoco.mj_step(model, data)
    return np.array(rows), np.array(energies)


def _stored(model: mujoco.MjModel, **state: float) -> float:
    data = mujoco.MjData(model)
    for name, value in state.items():
        getattr(data, name)[2 if model.nq == 7 else 0] = value
    row = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, row, INTEGRATION)
    return float(ConstraintEnergy(model)(row))


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_what_a_pressed_ball_stores(cone: str) -> None:
    """With a constant impedance d, m (K r^2 / 2 + d g r): its spring, and its load."""
    model, depth = _model(BALL, CONSTANT, option=f'cone="{cone}"'), 3e-3
    expected = 2 * (STIFFNESS * depth**2 / 2 + DAMPED * 9.81 * depth)
    assert _stored(model, qpos=0.1 - depth) == pytest.approx(expected, rel=1e-9)
    assert _stored(model, qpos=0.1) == 0


def test_what_a_pressed_limit_stores() -> None:
    model, depth = _model(STOP, CONSTANT, spring=50.0, ref=0.4), 5e-3
    force = 50 * (0.4 - 0.1 - depth)
    expected = 2 * STIFFNESS * depth**2 / 2 + DAMPED * force * depth
    assert _stored(model, qpos=0.1 + depth) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("xml", "solimp"),
    [(BALL, CONSTANT), (BALL, WIDE), (BALL, ".5 .9 .03 .3 3"), (TIED, WIDE)],
    ids=["bounces", "on a wide layer", "on a steep one", "tied"],
)
def test_energy_with_what_is_stored_is_kept(xml: str, solimp: str) -> None:
    """Nothing is damped, and steps are fine: what is missing of the energy is stored.

    Of the second order in w h = .014, but for the load, which turns with the arm by 1 % of the
    energy while it is carried.
    """
    model = _model(xml, solimp)
    states, energies = _states(model, 3000, 25)
    stored = ConstraintEnergy(model)(states)
    swing = np.ptp(energies) if xml == BALL else energies[0]
    assert np.ptp(energies + stored) < 0.02 * swing
    if xml == BALL:
        assert stored.max() > 0.6 * swing


@pytest.mark.parametrize("zeta", [0.02, 1.0])
def test_a_damped_contact_gives_back_its_restitution(zeta: float) -> None:
    """A ball pressed in and let go, without gravity: its speed once it is off is of what counts.

    Exact at zeta = 1, and off by zeta^2 where damping is weak; h w = .014 lets go a step late.
    """
    rate = STIFFNESS**0.5
    damped = f'solref="{1 / (rate * zeta)} {zeta}"'
    xml = BALL.replace('solref="-{k} 0"', damped).replace("0 0 .3", "0 0 .097")
    model = _model(xml, CONSTANT, option='gravity="0 0 0"')
    states, energies = _states(model, 300)
    given = ConstraintEnergy(model)(states)
    assert given[0] > 0
    assert given[-1] == 0
    assert energies[-1] == pytest.approx(given[0], rel=0.03)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_one_evaluation_serves_steps_of_every_length(integrator: str) -> None:
    """States that two references share, and that repeat, have the energies of either, bit for bit.

    States that are not finite have none.
    """
    text = TIED.replace("<option ", f'<option integrator="{integrator}" ')
    coarse, fine = (_model(text, WIDE, h) for h in (1e-4, 2.5e-5))
    states, _ = _states(coarse, 300, 100)
    later = states + np.eye(states.shape[1])[0]
    rows = np.stack([states, later, np.full_like(states, np.nan)])
    both = ConstraintEnergy(fine).after_steps(rows, [1e-4, 2.5e-5])
    expected = np.stack([ConstraintEnergy(model)(states) for model in (coarse, fine)])
    assert np.array_equal(both[:, 0], expected)
    assert np.array_equal(both[:, 1], expected)
    assert np.isnan(both[:, 2]).all()


def test_friction_stores_nothing() -> None:
    """Its rows have no violation, however fast their regularisation lets a body creep."""
    model = _model(BALL, CONSTANT, option='gravity="3 0 -9.81" cone="elliptic"')
    smooth = _model(BALL.replace("<geom sol", '<geom condim="1" sol'), CONSTANT)
    assert _stored(model, qpos=0.097) == pytest.approx(_stored(smooth, qpos=0.097), rel=1e-9)


@pytest.mark.parametrize("window", [0.04, 0.07])
def test_a_bounce_that_a_window_cuts_loses_what_the_run_does(window: float) -> None:
    """A contact of w h = .5 takes six steps, in which half of all energy is in no `energy`.

    Nothing is damped, so that the run's own loss is the truth; slack forgives a part of it.
    """
    xml = BALL.format(h=0.5 / STIFFNESS**0.5, k=STIFFNESS, solimp=CONSTANT, option="")
    model = mujoco.MjModel.from_xml_string(xml)
    states, energies = _states(model, round(1 / model.opt.timestep))
    whole = energies + ConstraintEnergy(model)(states)
    lost = (whole[-1] - whole[0]) / (whole[0] - 2 * 9.81 * 0.1)
    settings = Settings(window=window, check=False, places=False, excess=False)
    phase = error_budget([motion_of(xml, 1.0)], rows=[], settings=settings).phases[0]
    assert lost - 1e-3 < phase.energy_drift < 0.75 * lost, lost
