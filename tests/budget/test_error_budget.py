"""Laws of the backward error: closed forms, order of convergence, units, and an obvious loop."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import pytest
from tests.budget_motions import WALKER, motion_of, walker

from contactlab.budget import ErrorBudget, Motion, PhaseBudget, Settings, error_budget, judge
from contactlab.budget.defects import to_the_limit
from contactlab.budget.measuring import PhaseMeasure
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import Windows
from contactlab.errors import EngineError
from contactlab.modifications.catalogue import list_rows

# The bare definition: a reference at h/4, and nothing of finer ones.
PLAIN = Settings(energy=False, places=False, check=False)


def measured(motion: Motion, settings: Settings = PLAIN, **options: Any) -> PhaseBudget:
    return error_budget([motion], settings=settings, workers=1, **options).phases[0]


@pytest.mark.parametrize("gravity", ["0 0 -9.81", "0 0 0"])
def test_what_falls_freely_has_no_error(gravity: str) -> None:
    """Constant forces change velocities by h g each step, in any stepping; only rounding is left.

    Each of 8 steps a window rounds velocities below 10 m/s by 1e-15, over impulses of 4 m/s.
    """
    xml = f"""<mujoco><option timestep=".005" gravity="{gravity}"/><worldbody>
        <body><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
    phase = measured(motion_of(xml, 0.4, qvel=[1, 2, 3, 0, 0, 0]))
    assert 0 <= phase.run.error < 1e-13
    assert judge(error_budget([motion_of(xml, 0.4)])).word == "ok"


OSCILLATOR = """<mujoco><option timestep="{step}" gravity="0 0 0"/><worldbody><body>
    <joint type="slide" stiffness="{stiffness}"/><geom size=".1" mass="1"/></body></worldbody>
    </mujoco>"""


def oscillator_share(step: float, stiffness: float, seconds: float, finer: int = 4) -> float:
    """Return x of an oscillator of 1 kg that starts at rest .1 m away, from powers of matrices.

    Semi-implicit Euler is v' = v - h k q, q' = q + h v', so a window of n steps is a power.
    """

    def powers(timestep: float, most: int) -> np.ndarray:
        one = np.array([[1 - timestep**2 * stiffness, timestep], [-timestep * stiffness, 1]])
        return np.array([np.linalg.matrix_power(one, power) for power in range(most + 1)])

    length = round(0.04 / step)
    count = round(seconds / step) // length
    run, fine = powers(step, count * length + 1), powers(step / finer, (length + 1) * finer)
    states = run @ np.array([0.1, 0.0])
    defects, path = 0.0, 0.0
    for window in range(count):
        begin, end = window * length, (window + 1) * length
        velocity = (fine @ states[begin])[:, 1]
        around, own = velocity[(length - 1) * finer :], states[end - 1 : end + 2, 1]
        # On a line, the nearest of a polyline is within its range or at one of its ends.
        defects += max(
            abs(own[1] - np.clip(own[1], around.min(), around.max())),
            abs(around[finer] - np.clip(around[finer], own.min(), own.max())),
        )
        path += np.abs(np.diff(velocity[: length * finer + 1 : finer])).sum()
    return defects / path


@pytest.mark.parametrize("stiffness", [400.0, 2000.0])
def test_an_oscillator_has_the_error_of_its_closed_form(stiffness: float) -> None:
    """Powers of a matrix round differently from steps: 100 of them by 1e-16 each, over 1e-3."""
    for step in (0.01, 0.005, 0.0025):
        phase = measured(
            motion_of(OSCILLATOR.format(step=step, stiffness=stiffness), 0.8, qpos=[0.1])
        )
        assert phase.run.error == pytest.approx(oscillator_share(step, stiffness, 0.8), rel=1e-9)


def test_a_check_reaches_the_limit_of_fine_references() -> None:
    """h/4 leaves out a quarter of a first-order error, and more where slack forgives a part.

    The exact motion is that of 64 steps in one of the run.
    """
    for step in (0.01, 0.005, 0.0025):
        motion = motion_of(OSCILLATOR.format(step=step, stiffness=400), 0.8, qpos=[0.1])
        exact = oscillator_share(step, 400, 0.8, 64)
        checked = measured(motion, replace(PLAIN, check=True))
        assert checked.run.error == pytest.approx(exact, rel=0.05)
        assert checked.upper_bound == checked.run.error  # What converges leaves nothing in doubt
        assert measured(motion).run.error < 0.75 * exact


@pytest.mark.parametrize(
    ("share", "most", "word"),
    [
        (0.08, 0.1, "ok"),
        (0.08, 0.17, "ok"),
        (0.08, 0.19, "undecided"),
        (0.001, np.inf, "undecided"),
        (0.08, np.nan, "ok"),
        (0.11, 0.3, "inaccurate"),
    ],
)
def test_only_what_may_be_off_by_more_is_not_resolved(share: float, most: float, word: str) -> None:
    phase = measured(motion_of(WATCHED, 0.04))
    run = replace(phase.run, errors=np.full(len(phase.bodies), share))
    verdict = judge(ErrorBudget((replace(phase, run=run, upper_bound=most),)), tolerance=0.1)
    assert verdict.word == word
    assert len(verdict.reasons) == (word != "ok")


def test_the_limit_of_fine_steps_is_that_of_first_order() -> None:
    """Of an error c h, a reference at h/4 shows 3/4 and one at h/8 7/8; infinite ones stay so."""
    quarter = np.array([0.75, 0.0, np.inf, 0.75, 1.0])
    eighth = np.array([0.875, 0.0, np.inf, np.inf, 0.1])
    np.testing.assert_allclose(to_the_limit(quarter, eighth), [4 / 3, 1, 1, 1, 0.5])


def test_euler_is_of_first_order() -> None:
    """Slack forgives a shift of one step, itself of first order."""
    shares = [
        measured(
            motion_of(OSCILLATOR.format(step=step, stiffness=400), 0.8, qpos=[0.1]),
            replace(PLAIN, check=True),
        ).run.error
        for step in (0.005, 0.0025, 0.00125)
    ]
    for coarse, fine in pairwise(shares):
        assert 1.8 < coarse / fine < 2.3


@pytest.mark.long
def test_robots_converge_too() -> None:
    """Over impacts and friction, averaged over seeds, as no trajectory of them does."""
    shares = [
        measured(walker(step, seeds=4, seconds=0.4)).run.error for step in (0.01, 0.005, 0.0025)
    ]
    for coarse, fine in pairwise(shares):
        assert 1.5 < coarse / fine < 3.2


SCALED = """<mujoco>
  <option timestep=".004" gravity="0 0 {g}" tolerance="1e-13"/>
  <size memory="1M"/>
  <worldbody>
    <geom type="plane" size="0 0 {m}" solimp=".9 .95 {width}"/>
    <body pos="0 0 {z}"><freejoint/>
      <geom type="box" size="{a} {a} {b}" mass="{kg}" solimp=".9 .95 {width}"/></body>
    <body pos="0 0 {z2}"><joint axis="0 1 0" damping="{damping}"/>
      <geom type="capsule" size="{r}" fromto="0 0 0 {m} 0 0" mass="{kg}"/></body>
  </worldbody></mujoco>"""


def scaled(length: float, mass: float) -> Motion:
    """Slide a box and swing a rod, in units of 1 / length m and 1 / mass kg."""
    xml = SCALED.format(
        g=-9.81 * length, m=length, z=0.049 * length, z2=3 * length, a=0.1 * length,
        b=0.05 * length, r=0.03 * length, kg=mass, width=0.001 * length,
        damping=0.1 * mass * length**2,
    )  # fmt: skip
    return motion_of(xml, 0.4, qvel=[length, 0, 0, 0, 0, 0, 0])


def test_millimetres_and_grams_give_the_same_numbers() -> None:
    """Forces scale exactly but for rounding, which windows do not amplify.

    MuJoCo's tolerance is of accelerations, which have a unit, so it is set below what would show.
    """
    settings = Settings(places=False)
    one, other = (measured(scaled(*units), settings) for units in ((1, 1), (1000, 1000)))
    assert one.run.error > 1e-4
    np.testing.assert_allclose(one.run.errors, other.run.errors, rtol=1e-6)
    np.testing.assert_allclose(one.energy, other.energy, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(one.energy_rk4, other.energy_rk4, rtol=1e-6, atol=1e-12)
    for row, same in zip(one.rows, other.rows, strict=True):
        assert row.exercised == same.exercised
        np.testing.assert_allclose(row.errors, same.errors, rtol=1e-5, atol=1e-9)


SLOPE = """<mujoco><option timestep=".002" gravity="{}"/><worldbody>
    <geom name="floor" type="plane" size="0 0 1"/><body pos="0 0 .05"><freejoint/>
    <geom type="box" size=".1 .1 .05" mass="2"/></body></worldbody></mujoco>"""
PULL = np.array([2.0, 0.0, -9.6])  # m/s^2, of a slope of 12 degrees


def on_a_slope(where: str) -> Motion:
    """Rest a box on a slope, whose weight is gravity or a force that is applied."""
    gravity = PULL if where == "gravity" else 0 * PULL
    motion = motion_of(SLOPE.format(" ".join(map(str, gravity))), 0.6)
    bits = {"start": "XFRC_APPLIED", "steps": "XFRC_APPLIED", "joint": "QFRC_APPLIED"}
    if where == "gravity":
        return motion
    bit = int(getattr(mujoco.mjtState, f"mjSTATE_{bits[where]}"))
    forces = np.zeros(mujoco.mj_stateSize(motion.model, bit))
    forces[-6:-3] = 2 * PULL
    if where == "steps":
        inputs = np.tile(forces, (1, motion.steps, 1))
        return replace(motion, inputs=inputs, spec=bit)
    begin = mujoco.mj_stateSize(motion.model, (bit - 1) & INTEGRATION)
    starts = motion.starts.copy()
    starts[:, begin : begin + len(forces)] = forces
    return replace(motion, starts=starts)


@pytest.mark.parametrize("where", ["start", "steps", "joint"])
def test_a_weight_that_is_applied_is_as_real_as_gravity(where: str) -> None:
    """The same acceleration in each step but for rounding, so that shares are the same too.

    The box lands softly in the first window and then rests: nothing but weight is real any more.
    """
    there, here = measured(on_a_slope("gravity")).run, measured(on_a_slope(where)).run
    assert 1e-5 < there.error < 0.01
    assert here.error == pytest.approx(there.error, rel=1e-6)


def slow_shares(motion: Motion) -> np.ndarray:
    """Return (S, W, B) the run's shares by loops over `mj_step` that say the definition."""
    span = motion.steps * motion.model.opt.timestep
    pairs = zip(motion.starts, motion.inputs, strict=True)
    found = [slow_sums(motion.model, start, inputs) for start, inputs in pairs]
    return np.array([defects / (real + 0.1 * 9.81 * span) for defects, real in found])


def slow_sums(
    model: mujoco.MjModel, start: np.ndarray, inputs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (W, B) defects, and (B,) the first speed and the path of velocity."""
    length, finer, steps = round(0.04 / model.opt.timestep), 4, len(inputs)
    states, velocities = stepped(model, start, [*inputs, inputs[-1]])
    fine = mujoco.MjModel.from_xml_string(mjcf(model))
    defects, real = list[np.ndarray](), np.linalg.norm(velocities[0], axis=1)
    for begin in range(0, steps, length):
        held = [
            inputs[min(begin + step // finer, steps - 1)] for step in range((length + 1) * finer)
        ]
        found = stepped(fine, states[begin], held)[1]
        own = velocities[begin + length - 1 : begin + length + 2]
        there = nearest_by_trying(own[1], found[(length - 1) * finer :])
        back = nearest_by_trying(found[length * finer], own)
        defects.append(np.maximum(there, back))
        real += sum(
            np.linalg.norm(later - earlier, axis=1)
            for earlier, later in pairwise(found[: length * finer + 1 : finer])
        )
    return np.array(defects), real


def nearest_by_trying(point: np.ndarray, others: Sequence[np.ndarray]) -> np.ndarray:
    """Return (B,) distances of (B, 6) from polylines, the least of 1000 places on each part."""
    places = np.linspace(0, 1, 1001)[:, None, None]
    return np.min(
        [
            np.linalg.norm(begin + places * (end - begin) - point, axis=2).min(axis=0)
            for begin, end in pairwise(others)
        ],
        axis=0,
    )


def stepped(
    model: mujoco.MjModel, start: np.ndarray, inputs: Sequence[np.ndarray]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return states and velocities, before each step and after the last."""
    data, states, velocities = mujoco.MjData(model), list[np.ndarray](), list[np.ndarray]()
    mujoco.mj_setState(model, data, start, INTEGRATION)
    for held in [*inputs, None]:
        states.append(np.empty_like(start))
        mujoco.mj_getState(model, data, states[-1], INTEGRATION)
        velocities.append(seen(model, states[-1]))
        if held is not None:
            data.ctrl[:] = held
            mujoco.mj_step(model, data)
    return states, velocities


def mjcf(model: mujoco.MjModel) -> str:
    """Return the walker at a quarter of its step."""
    text = WALKER.format(
        step=model.opt.timestep / 4, integrator="Euler", solver="Newton", iterations=100
    )
    return text.replace("<option", '<option tolerance="1e-12" jacobian="dense"')


def seen(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """Return (B, 6) velocities of centres of mass, and spins times radius of gyration."""
    data, found = mujoco.MjData(model), list[list[float]]()
    mujoco.mj_setState(model, data, state, INTEGRATION)
    mujoco.mj_forward(model, data)
    radius = np.sqrt(model.body_inertia.max(axis=1)[1:] / model.body_mass[1:])
    for body in range(1, model.nbody):
        twist = np.empty(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
        found.append([*twist[3:], *twist[:3] * radius[body - 1]])
    return np.array(found)


@pytest.mark.long
def test_batches_equal_an_obvious_loop() -> None:
    """Places on a polyline are tried 1e-3 of its parts apart, which are no longer than 1 m/s.

    The nearest is then too far by at most (1e-3 / 2)^2 / 2 over a defect of 1e-2, in parts of both.
    """
    motion = walker()
    phase = measured(motion)
    slow = slow_shares(motion)
    shares = slow.sum(axis=1).mean(axis=0)
    assert shares.max() > 1e-3
    np.testing.assert_allclose(phase.run.errors, shares, rtol=1e-4)
    for body, name in enumerate(phase.bodies):
        run = measured(replace(motion, observed=(name,))).run
        seed, window = np.unravel_index(slow[..., body].argmax(), slow.shape[:2])
        assert run.error == pytest.approx(shares[body], rel=1e-4)
        np.testing.assert_allclose(run.seeds, slow[..., body].sum(axis=1), rtol=1e-4)
        assert (run.seed, run.time) == (seed, pytest.approx(0.04 * window))


WATCHED = """<mujoco><option timestep=".005"/><worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="ball" pos="0 0 .4"><freejoint/><geom name="ball" size=".1"/></body>
    <body name="box" pos="3 0 .0499"><freejoint/>
      <geom name="box" type="box" size=".1 .1 .05"/></body>
    <body name="sign" pos="6 0 1"><geom size=".1"/></body></worldbody></mujoco>"""


@pytest.mark.long
def test_watched_bodies_are_the_columns_of_all() -> None:
    """Bit for bit; the ball drops on the floor at .25 s, and the box slides on it from the start.

    What is shown of a body beside its shares is of its own worst window: of the box, of its pair.
    """
    motion = motion_of(WATCHED, 0.6, qvel=[0.0] * 6 + [1.0] + [0.0] * 5)
    settings = Settings(energy=True)
    whole = measured(motion, settings)
    assert whole.bodies == ("ball", "box")
    times = dict[str, float]()
    for body, name in enumerate(whole.bodies):
        watched = measured(replace(motion, observed=(name, "sign")), settings)
        assert watched.bodies == (name,)
        np.testing.assert_array_equal(watched.energy, whole.energy)
        assert watched.run.place == f"contact world - {name}"
        times[name] = watched.run.time
        for row, column in zip((watched.run, *watched.rows), (whole.run, *whole.rows), strict=True):
            np.testing.assert_array_equal(row.errors, column.errors[body : body + len(row.errors)])
            np.testing.assert_array_equal(row.seeds.mean(axis=0), row.error)
            if column.exercised and column.body == body:
                assert (row.time, row.place) == (column.time, column.place)
    assert times["ball"] >= 0.2
    assert times["box"] < 0.2
    both = measured(replace(motion, observed=("box", "ball")), settings)
    assert (both.run.body, both.run.time) == (whole.run.body, whole.run.time)


def test_none_of_the_watched_bodies_moves() -> None:
    with pytest.raises(EngineError, match=r"no observed body moves .*those that do: ball"):
        measured(replace(motion_of(WATCHED, 0.1), observed=("sign",)))


def test_no_bit_depends_on_the_number_of_workers() -> None:
    one, other = (error_budget([walker()], workers=count).phases[0] for count in (1, 3))
    for row, same in zip((one.run, *one.rows), (other.run, *other.rows), strict=True):
        np.testing.assert_array_equal(row.errors, same.errors)
        np.testing.assert_array_equal(row.seeds, same.seeds)
        assert (row.body, row.place, row.exercised) == (same.body, same.place, same.exercised)
    np.testing.assert_array_equal(one.energy, other.energy)
    np.testing.assert_array_equal(one.energy_rk4, other.energy_rk4)
    assert (one.upper_bound, one.worst_window) == (other.upper_bound, other.worst_window)


def test_no_bit_depends_on_the_looks_before() -> None:
    """A first seed alone, then all at h/4, then the whole are the whole at once."""
    motion, settings = walker(seconds=0.2), Settings(places=False)
    rows = [row for row in list_rows() if row.name in ("solver", "contact softness")]
    one = replace(motion, starts=motion.starts[:1], inputs=motion.inputs[:1])
    alone = PhaseMeasure(one, rows, settings)
    begun = PhaseMeasure(motion, rows, settings, begun=alone.first_pass)
    assert np.isnan(begun.first_look().upper_bound)
    assert repr(begun.measure_budget()) == repr(
        PhaseMeasure(motion, rows, settings).measure_budget()
    )


def test_windows_cover_every_step() -> None:
    """83 steps are 10 windows of 8, and one that begins 5 steps earlier than they end."""
    motion = walker(seconds=0.415)
    phase = measured(motion)
    assert (phase.windows, phase.window) == (11, pytest.approx(0.04))


def test_an_event_in_the_last_steps_is_not_missed() -> None:
    """A ball that hits the floor within the last window, which is short: there is its defect."""
    xml = """<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="0 0 1"
        solref="-40000 -10"/><body name="ball" pos="0 0 1"><freejoint/><geom size=".1"
        solref="-40000 -10"/></body></worldbody></mujoco>"""
    phase = measured(motion_of(xml, 0.43))
    assert phase.run.error > 0.005
    assert phase.run.time == pytest.approx(0.39)


def test_what_stands_still_is_sound() -> None:
    """Without gravity nothing is real, and nothing is wrong either: 0, not 0 / 0."""
    box = """<mujoco><option {}/><worldbody><geom type="plane" size="0 0 1"/>
        <body pos="0 0 {}"><freejoint/><geom type="box" size=".1 .1 .05"/></body></worldbody>
        </mujoco>"""
    for option, height in (("", 0.0499), ('gravity="0 0 0"', 0.051)):
        budget = error_budget([motion_of(box.format(option, height), 1.0)])
        assert judge(budget).word == "ok"
        assert not np.isnan(budget.error)
        assert abs(budget.phases[0].energy_drift) < 0.01


def test_idle_time_in_another_phase_hides_nothing() -> None:
    busy, idle = walker(0.01, seconds=0.4), walker(0.01, seconds=2.0)
    idle = replace(idle, inputs=0 * idle.inputs)
    alone = error_budget([busy], rows=[]).error
    assert error_budget([busy, idle], rows=[]).error == pytest.approx(
        max(alone, error_budget([idle], rows=[]).error)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"starts": np.zeros((1, 3))}, "starts have shape"),
        ({"inputs": np.zeros((5, 3, 2))}, "inputs have shape"),
        ({"inputs": np.zeros((2, 3, 1))}, "a row of inputs has 1 numbers"),
        ({"inputs": np.zeros((2, 0, 2))}, "0 steps"),
    ],
)
def test_a_motion_says_what_is_wrong_with_it(change: dict[str, Any], message: str) -> None:
    with pytest.raises(EngineError, match=message):
        replace(walker(), **change)


def test_an_unknown_row_names_its_neighbour() -> None:
    with pytest.raises(EngineError, match="friction loss"):
        error_budget([walker()], rows=["friction los"])


def test_equal_models_of_several_rows_are_rolled_out_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The solver is as converged in its row as in that of the step: one roll serves both."""
    motion, rolls = walker(0.01), list[int]()
    wanted = [row for row in list_rows() if row.name in ("step", "solver")]

    roll = Windows.roll_out

    def count_rolls(self: Windows, model: mujoco.MjModel, rate: int, **options: Any) -> Any:
        rolls.append(rate)
        return roll(self, model, rate, **options)

    monkeypatch.setattr(Windows, "roll_out", count_rolls)
    both = PhaseMeasure(motion, wanted, PLAIN).measure_budget()
    assert rolls == [4, 1], "the reference, and the run with a converged solver"
    for row, reading in zip(wanted, both.rows, strict=True):
        (alone,) = measured(motion, rows=[row.name]).rows
        assert reading.exercised
        np.testing.assert_array_equal(reading.errors, alone.errors)


def test_a_row_is_timed_in_the_phase_in_which_it_is_largest() -> None:
    """A row that is small in a phase is not worth the time there."""
    still = replace(walker(0.01), name="still")
    moving = replace(still, inputs=np.ones_like(still.inputs), name="moving")
    timed = replace(PLAIN, measures_time=True)
    budget = error_budget([still, moving], rows=["cone", "gravity"], settings=timed, workers=1)
    for name in ("cone", "gravity"):
        worst, reading = budget.worst(name) or (None, None)
        assert worst is not None
        assert reading is not None
        assert reading.time_ratio is not None
        others = [row for phase in budget.phases if phase is not worst for row in phase.rows]
        assert all(row.time_ratio is None for row in others if row.name == name)
