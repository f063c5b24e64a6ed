"""The impulse engine: the same scenes without a contact model, in the same arrays."""

from typing import Any

import numpy as np
import pytest

from contactlab.contact.contact_laws import resolve_impact
from contactlab.contact.trace_arrays import Trace
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.impulse import ImpulseEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import SceneError
from contactlab.scene.scene import Scene


def simulated(name: str, values: dict[str, Any]) -> Trace:
    scene = Scene.open(name)
    run = scene.resolve({"engine": "impulse", **values}, 0, None)
    runs = PreparedRuns.of(scene, run)
    return make_trace(runs.base, runs.prepared, ImpulseEngine().roll_out(runs, Buffers()))


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 70.0])
@pytest.mark.parametrize(("restitution", "friction"), [(0.6, 0.1), (0.9, 0.6)])
def test_the_last_velocity_is_that_of_the_law(
    angle: float, restitution: float, friction: float
) -> None:
    """Zero gravity and one impact: exact, but for the bisection of the damping ratio (1e-15)."""
    values = {"angle": angle, "restitution": restitution, "friction.slide": friction}
    trace = simulated("oblique_impact", values)
    first, last = trace.qvel[0, 0], trace.qvel[0, -1]
    impulse = resolve_impact(1.0, first, np.array([0, 0, 1]), restitution, friction)
    assert last == pytest.approx(first + impulse, abs=1e-12)
    force = trace.pairs[0].slots[0, :, 0, 1]
    assert force.sum() * trace.timestep[0] == pytest.approx(impulse[2], abs=1e-12)


def test_momentum_changes_by_the_recorded_forces() -> None:
    trace = simulated("ball_drop", {"restitution": 0.6, "timestep": 1e-3})
    step = trace.timestep[0]
    lift = trace.pairs[0].slots[0, :, 0, 1] - 9.81
    # Sums of 3000 numbers of order 10.
    assert np.diff(trace.qvel[0, :, 2]) == pytest.approx(lift * step, abs=1e-11)


@pytest.mark.parametrize("timestep", [4e-3, 2e-3, 1e-3])
def test_peaks_fall_by_restitution_squared(timestep: float) -> None:
    """Semi-implicit flight gains or loses at most g h v a bounce, a share of 2 g h / v."""
    trace = simulated("ball_drop", {"restitution": 0.9, "timestep": timestep, "drop_height": 2.0})
    height = trace.qpos[0, :, 2] - 0.05
    inner = (height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])
    peaks = height[1:-1][inner]
    ratios = peaks[:2] / np.array([height[0], peaks[0]])
    speed = np.sqrt(2 * 9.81 * peaks[:2])
    assert (np.abs(ratios - 0.81) <= 4 * 9.81 * timestep / speed).all()


def test_a_scene_that_is_no_sphere_above_a_plane_is_refused() -> None:
    scene = Scene.open("box_slide")
    reason = ImpulseEngine().refusal(scene, scene.resolve({}, 0, None))
    assert "impulse engine moves one sphere" in str(reason)
    with pytest.raises(SceneError, match="impulse engine moves one sphere"):
        simulated("box_slide", {})


@pytest.mark.parametrize("timestep", [1e-3, 4e-3])
def test_flight_keeps_the_energy_of_its_steps(timestep: float) -> None:
    """Semi-implicit flight changes m v^2 / 2 + m g z by -m (g h)^2 / 2 in each step, exactly.

    The speed falls by g h, and the height changes by h times the speed after that: what is left is
    m (g h)^2 / 2 - m (g h)^2. The mass is that which the kinetic energy has; sums of up to 1,000
    numbers of order 10 round to 1e-12.
    """
    trace = simulated("ball_drop", {"timestep": timestep, "drop_height": 1.0, "restitution": 0.6})
    kinetic, potential = trace.kinetic[0], trace.potential[0]
    flight = int(np.argmax(trace.contacts[0] > 0))
    mass = 2 * kinetic[1] / trace.qvel[0, 1, 2] ** 2
    lost = -np.diff(kinetic + potential)[: flight - 1]
    assert flight > 10
    assert lost == pytest.approx(mass * (9.81 * timestep) ** 2 / 2, abs=1e-12)
