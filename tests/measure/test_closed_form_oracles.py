"""Oracles of free, sliding, rolling and struck bodies, on motions made by hand."""

from typing import Any

import numpy as np
import pytest

from contactlab.contact.contact_laws import damping_ratio_of
from contactlab.contact.trace_setup import FreeBody
from contactlab.measure import assess_runs

GRAVITY, STEP, STEPS = 9.81, 2e-3, 100
RADIUS = 0.05


def found(trace: Any, setup: Any) -> list[float]:
    metrics = assess_runs(trace, setup).metrics
    return [metrics[f"oracle_{part}"][0] for part in ("expected", "measured", "error")]


def friction(slide: float = 0.5, torsion: float = 0.005, roll: float = 1e-4) -> dict[str, Any]:
    return {"friction": [(slide, slide, torsion, roll, roll)], "integrator": ["Euler"]}


def accelerated(trace: Any, column: int, rate: float) -> None:
    """Let a body start from rest at this rate, by the engine's recursion, step by step."""
    speed = place = 0.0
    for step in range(1, STEPS + 1):
        speed += STEP * rate
        place += STEP * speed
        trace.qpos[0, step, column] += place
        trace.qvel[0, step, column] += speed


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_free_fall(trace_of: Any, setup_of: Any, integrator: str) -> None:
    trace = trace_of(1, STEPS, STEP)
    if integrator == "RK4":
        trace.qpos[0, :, 2] = -GRAVITY * trace.time[0] ** 2 / 2
    else:
        accelerated(trace, 2, -GRAVITY)
    trace.qvel[0, :, 1] = 3.0
    trace.qpos[0, :, 1] = 3.0 * trace.time[0]
    settings = {"integrator": [integrator]}
    setup = setup_of(trace, oracle="free_fall", oracle_tolerance=1e-9, settings=settings)
    assert found(trace, setup) == pytest.approx([0, 0, 0], abs=1e-12)
    trace.qpos[0, 40, 0] = 1e-6
    assert found(trace, setup) == pytest.approx([0, 1e-6, 1e-6], rel=1e-6)


def test_rest_penetration(trace_of: Any, setup_of: Any, pair_of: Any) -> None:
    # F A (1 - d) dwidth^2 / (K d^2) with d = 0.9 throughout and K = 100: g / 1000.
    depth = GRAVITY * 0.1 / 100
    pair = pair_of(1, STEPS, normal=GRAVITY, distance=-depth)
    trace = trace_of(1, STEPS, STEP, pairs=(pair,))
    settings = {"solref": [(-100.0, -20.0)], "solimp": [(0.9, 0.9, 0.001, 0.5, 2.0)]}
    body = FreeBody("ball", 0, 0, np.array([7.0]))
    setup = setup_of(trace, oracle="rest_penetration", settings=settings, free_bodies=(body,))
    assert found(trace, setup) == pytest.approx([depth, depth, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("speed", "mu", "after"),
    [
        ((3.0, -2.0), 0.05, (3.0 - 0.05 * 1.8 * 2, 1.6)),
        ((3.0, -2.0), 0.5, (3.0 - 0.5 * 1.8 * 2, 1.6)),
        ((0.5, -2.0), 2.0, (0.0, 1.6)),
    ],
)
def test_oblique_impact(
    trace_of: Any,
    setup_of: Any,
    speed: tuple[float, float],
    mu: float,
    after: tuple[float, float],
) -> None:
    """A velocity change of (1 + e) v_n, e = 0.8, and mu times that along the floor or to rest."""
    trace = trace_of(1, STEPS, STEP)
    trace.qvel[0, :, [0, 2]] = np.array(speed)[:, None]
    trace.qvel[0, 50:, [0, 2]] = np.array(after)[:, None]
    zeta = float(damping_ratio_of(0.8))
    settings = friction(mu) | {"solref": [(0.02, zeta)]}
    setup = setup_of(trace, oracle="oblique_impact", settings=settings, free_bodies=())
    assert found(trace, setup) == pytest.approx([0, 0, 0], abs=1e-12)
    trace.qvel[0, -1, 1] = 0.1 * np.hypot(*speed)
    assert found(trace, setup)[2] == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize("tilt", [20.0, 30.0])
def test_incline(trace_of: Any, setup_of: Any, tilt: float) -> None:
    trace, angle = trace_of(1, STEPS, STEP), np.radians(tilt)
    slides = max(np.sin(angle) - 0.5 * np.cos(angle), 0)
    accelerated(trace, 0, GRAVITY * slides * np.cos(1))
    accelerated(trace, 1, GRAVITY * slides * np.sin(1))
    settings = friction(0.5) | {
        "tilt": [tilt],
        "weight": [2 * GRAVITY],
        "direction": [np.degrees(1)],
    }
    body = FreeBody("box", 0, 0, np.array([2.0]))
    setup = setup_of(trace, oracle="incline", settings=settings, free_bodies=(body,))
    share = slides / np.sin(angle)
    assert found(trace, setup) == pytest.approx([share, share, 0], abs=1e-12)


@pytest.mark.parametrize("over", [0.4, 1.5])
def test_pushed_box(trace_of: Any, setup_of: Any, over: float) -> None:
    trace, share = trace_of(1, STEPS, STEP), max(1 - 1 / over, 0)
    push = over * 0.5 * GRAVITY
    accelerated(trace, 1, push * share)
    settings = friction(0.5) | {"push": [push], "direction": [90.0]}
    setup = setup_of(trace, oracle="pushed_box", settings=settings)
    assert found(trace, setup) == pytest.approx([share, share, 0], abs=1e-12)


@pytest.mark.parametrize(("mu", "share"), [(1.0, 5 / 7), (0.3, 1 - 0.3 / np.sqrt(3))])
def test_roll_down(trace_of: Any, setup_of: Any, mu: float, share: float) -> None:
    trace = trace_of(1, STEPS, STEP)
    accelerated(trace, 0, GRAVITY * np.sin(np.pi / 3) * share)
    settings = friction(mu) | {"tilt": [60.0], "weight": [GRAVITY], "direction": [0.0]}
    setup = setup_of(trace, oracle="roll_down", settings=settings)
    assert found(trace, setup) == pytest.approx([share, share, 0], abs=1e-12)


def ball(trace_of: Any, setup_of: Any, pair_of: Any, oracle: str, **values: float) -> Any:
    pair = pair_of(1, STEPS, normal=GRAVITY)
    trace = trace_of(1, STEPS, STEP, pairs=(pair,))
    thickness = np.array([RADIUS])
    setup = setup_of(trace, oracle=oracle, settings=friction(**values), thickness=thickness)
    return trace, setup


def test_slide_to_roll(trace_of: Any, setup_of: Any, pair_of: Any) -> None:
    trace, setup = ball(trace_of, setup_of, pair_of, "slide_to_roll", slide=1.0)
    lost = np.minimum(GRAVITY * trace.time[0], 2 / 7 * 1.0)
    trace.qvel[0, :, 0] = 1.0 - lost
    trace.qvel[0, :, 4] = 2.5 * lost / RADIUS
    rolls = 0.95 * 2 / (7 * GRAVITY)
    expected, measured, _ = found(trace, setup)
    assert expected == pytest.approx(rolls)
    assert rolls <= measured < rolls + STEP
    trace.qvel[0, :, 4] = 0
    assert np.isnan(found(trace, setup)[1])


def test_roll_friction(trace_of: Any, setup_of: Any, pair_of: Any) -> None:
    trace, setup = ball(trace_of, setup_of, pair_of, "roll_friction", roll=1e-3)
    rate = 1e-3 * GRAVITY / (1.4 * RADIUS)
    trace.qvel[0, :, 1] = 1 - rate * trace.time[0]
    assert found(trace, setup) == pytest.approx([rate, rate, 0], abs=1e-12)


def test_spin_down(trace_of: Any, setup_of: Any, pair_of: Any) -> None:
    trace, setup = ball(trace_of, setup_of, pair_of, "spin_down", torsion=2e-3)
    trace.qvel[0, :, 5] = 30 - 19.62 * trace.time[0]
    assert found(trace, setup) == pytest.approx([19.62, 19.62, 0], abs=1e-12)


@pytest.mark.parametrize(("angle", "falls"), [(31.2, 0), (31.3, 1)])
def test_ladder(trace_of: Any, setup_of: Any, pair_of: Any, angle: float, falls: int) -> None:
    """31.257 degrees at 0.3 and a radius of 10 mm: 2 mu (1 + 0.01 / cos 31.257 deg) = 0.60702."""
    pair = pair_of(1, STEPS, normal=GRAVITY)
    trace = trace_of(1, STEPS, STEP, pairs=(pair,))
    trace.qpos[0, :, 2] = np.radians(angle)
    trace.qpos[0, -1, 2] += np.radians(10) * falls
    settings = friction(0.3) | {"angle": [angle]}
    setup = setup_of(trace, oracle="ladder", settings=settings, thickness=np.array([0.01]))
    assert found(trace, setup) == pytest.approx([falls, falls, 0], abs=1e-12)


def test_creep_counts_only_where_a_scene_forbids_it(
    trace_of: Any, setup_of: Any, pair_of: Any
) -> None:
    pair = pair_of(
        1, STEPS, normal=GRAVITY, tangential=(1.0, 0.0), velocity=(2e-4, 0.0), friction=0.5
    )
    trace = trace_of(1, STEPS, STEP, pairs=(pair,))
    for limits, label in (({}, "stable"), ({"creep_speed": 1e-4}, "creep")):
        outcome = assess_runs(trace, setup_of(trace, thresholds=limits)).labels[0][0]
        assert outcome.label == label
    assert outcome.step == STEPS * 4 // 5
    relaxed = setup_of(trace, thresholds={"creep_speed": 3e-4})
    assert assess_runs(trace, relaxed).labels[0][0].label == "stable"
