"""Distances from a recording equal those of a slow loop over its frames."""

from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import FreeBody, RecordedMotion, RecordedPart
from contactlab.measure import assess_runs

STEP, STEPS, RUNS = 2e-3, 50, 3
LENGTHS = (40, 31, 12)  # frames of each recording, 3 ms apart: the first ends after the run
WIDTH, RANGE, MASS = 0.2, 2.5, 0.7
PARTS = (
    RecordedPart("box", 1, "point", slice(0, 3), slice(0, 3), WIDTH),
    RecordedPart("box", 1, "turn", slice(3, 7), slice(3, 6), np.inf),
    RecordedPart("hinge", 2, "hinge", slice(7, 8), slice(6, 7), RANGE),
)


def unit(values: Floats) -> Floats:
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


@pytest.fixture
def runs(trace_of: Any, setup_of: Any) -> tuple[Any, Any]:
    """Return the trace and the setup of random runs, and random recordings of them."""
    rng = np.random.default_rng(5)
    turn = unit(rng.normal(size=(RUNS, 1, 4)) + 0.02 * rng.normal(size=(RUNS, STEPS + 1, 4)))
    qpos = np.concatenate([rng.normal(size=(RUNS, STEPS + 1, 3)), turn], axis=2)
    qpos = np.concatenate([qpos, rng.normal(size=(RUNS, STEPS + 1, 1))], axis=2)
    trace = trace_of(RUNS, STEPS, STEP, qpos=qpos, qvel=rng.normal(size=(RUNS, STEPS + 1, 7)))
    most = max(LENGTHS)
    times: Floats = np.tile(3e-3 * np.arange(most, dtype=np.float64), (RUNS, 1))
    there = np.concatenate(
        [rng.normal(size=(RUNS, most, 3)), unit(rng.normal(size=(RUNS, most, 4)))], 2
    )
    there = np.concatenate([there, rng.normal(size=(RUNS, most, 1))], axis=2)
    speeds = rng.normal(size=(RUNS, most, 7))
    for run, length in enumerate(LENGTHS):
        for array in (times, there, speeds):
            array[run, length:] = np.nan
    touched, impact = np.full(RUNS, 0.01), np.array([[3, 20], [3, 25], [-1, -1]])
    lost = np.array([0.3, 0.1, np.nan])
    motion = RecordedMotion(PARTS, times, there, speeds, touched, impact, lost)
    body = FreeBody("box", 0, 0, np.full(RUNS, MASS))
    return trace, setup_of(trace, free_bodies=(body,), recorded=motion)


def frames(trace: Any, motion: RecordedMotion, run: int) -> list[tuple[float, float, float, float]]:
    """Return distance, angle, difference of speed and share at each frame, in a plain loop."""
    found: list[tuple[float, float, float, float]] = []
    for frame in range(LENGTHS[run]):
        time = motion.times[run, frame]
        if time > STEP * STEPS * (1 + 1e-9):
            break
        first = min(int(time / STEP + 1e-9), STEPS - 1)
        share = time / STEP - first
        qpos, qvel = (
            (1 - share) * each[run, first] + share * each[run, first + 1]
            for each in (trace.qpos, trace.qvel)
        )
        there = motion.qpos[run, frame]
        distance = float(np.linalg.norm(qpos[:3] - there[:3]))
        dot = abs(float(unit(qpos[3:7]) @ there[3:7]))
        hinge = abs(qpos[7] - there[7])
        angle = max(2 * np.arccos(min(dot, 1.0)), hinge)
        speed = float(np.linalg.norm(qvel[:3] - motion.qvel[run, frame, :3]))
        found.append((distance, angle, speed, max(distance / WIDTH, hinge / RANGE)))
    return found


def test_metrics_equal_a_loop_over_frames(runs: tuple[Any, Any]) -> None:
    trace, setup = runs
    metrics = assess_runs(trace, setup).metrics
    for run in range(RUNS):
        distance, angle, speed, share = np.array(frames(trace, setup.recorded, run)).T
        expected = {
            "reality": share.mean(),
            "reality_position": distance.mean(),
            "reality_position_peak": distance.max(),
            "reality_position_end": distance[-1],
            "reality_rotation": angle.mean(),
            "reality_rotation_peak": angle.max(),
            "reality_rotation_end": angle[-1],
            "reality_velocity": speed.mean(),
        }
        found = {name: float(metrics[name][run]) for name in expected}
        # arccos loses half the digits of angles near 0 and pi.
        assert found == pytest.approx(expected, rel=1e-6)


def test_the_first_contact_is_what_changes_between_two_rows(runs: tuple[Any, Any]) -> None:
    """Impulse and energy are those of a plain difference of two interpolated states."""
    trace, setup = runs
    metrics, recorded = assess_runs(trace, setup).metrics, setup.recorded
    times = np.arange(STEPS + 1) * STEP
    for run, (before, after) in enumerate(recorded.impact[:2]):

        def at(values: Floats, frame: int, run: int = run) -> float:
            count = len(values)  # energies have no value after the last step
            return float(np.interp(recorded.times[run, frame], times[:count], values))

        here = [
            at(trace.qvel[run, :, k], after) - at(trace.qvel[run, :, k], before) for k in (0, 1, 2)
        ]
        there = recorded.qvel[run, after, :3] - recorded.qvel[run, before, :3]
        impulse = MASS * float(np.linalg.norm(np.array(here) - there))
        assert metrics["reality_impulse"][run] == pytest.approx(impulse, rel=1e-9)
        energy = trace.kinetic[run] + trace.potential[run]
        lost = at(energy, before) - at(energy, after)
        assert metrics["reality_energy"][run] == pytest.approx(lost - recorded.lost[run], rel=1e-9)
    assert np.isnan([metrics[name][2] for name in ("reality_impulse", "reality_energy")]).all()


def test_a_run_that_ended_early_has_no_distance(runs: tuple[Any, Any]) -> None:
    trace, setup = runs
    cut = trace.select([1], 20)
    metrics = assess_runs(cut, setup.select([1])).metrics
    assert np.isnan(metrics["reality"]).all()
    assert np.isnan(metrics["reality_side"]).all()


@pytest.mark.parametrize(("tilt", "same"), [(0.0, 1.0), (0.7, 1.0), (0.9, 0.0), (np.pi, 0.0)])
def test_the_side_that_is_down(trace_of: Any, setup_of: Any, tilt: float, same: float) -> None:
    """A quarter of a right angle more or less tells the sides apart."""
    trace = trace_of(1, STEPS, STEP)
    qpos = np.array([[[0, 0, 0, np.cos(tilt / 2), np.sin(tilt / 2), 0, 0]]] * 1)
    none = np.full((1, 2), -1)
    motion = RecordedMotion(
        PARTS[:2], np.array([[0.05]]), qpos, np.zeros((1, 1, 6)), np.zeros(1), none, np.zeros(1)
    )
    gravity = np.array([[0, 0, -9.81]])
    body = FreeBody("box", 0, 0, np.ones(1))
    setup = setup_of(trace, free_bodies=(body,), recorded=motion, gravity=gravity)
    assert assess_runs(trace, setup).metrics["reality_side"].tolist() == [same]


def test_nothing_is_measured_without_a_recording(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of(2, STEPS, STEP)
    metrics = assess_runs(trace, setup_of(trace)).metrics
    assert all(np.isnan(metrics[name]).all() for name in metrics if name.startswith("reality"))
