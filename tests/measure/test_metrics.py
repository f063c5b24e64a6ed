"""Metrics of traces whose values are known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Trace
from contactlab.contact.trace_setup import FreeBody
from contactlab.measure import METRICS, assess_runs

NONE = np.nan


def value(trace: Trace, setup: Any, name: str) -> Any:
    found = assess_runs(trace, setup).metrics[name]
    return found[0] if len(found) == 1 else found


def test_every_metric_says_what_it_is() -> None:
    names = [metric.name for metric in METRICS.values()]
    assert names == list(METRICS)
    for metric in METRICS.values():
        assert metric.unit
        assert metric.version >= 1
        assert metric.resolution >= 0
        assert metric.better in {"lower", "higher", "none"}
        assert metric.definition.endswith(".")


def test_values_below_the_resolution_are_zero(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of(2, potential=np.tile(np.linspace(0, 1, 100), (2, 1)))
    trace.qvel[:, -1, 0] = 0.9e-9, 1.1e-9
    assert value(trace, setup_of(trace), "final_speed").tolist() == [0, 1.1e-9]


class TestPenetration:
    def test_largest_mean_and_steady(self, pair_of: Any, trace_of: Any, setup_of: Any) -> None:
        distance = np.zeros((1, 100, 1))
        distance[0, 10:, 0] = -1e-3
        distance[0, 80:, 0] = -2e-3
        distance[0, 15, 0] = -7e-3
        pair = pair_of(1, 100, distance=distance, touching=distance < 0)
        shallow = pair_of(1, 100, distance=-1e-6, touching=np.ones((1, 100, 1), dtype=bool))
        trace = trace_of(pairs=(shallow, pair))
        setup = setup_of(trace)
        assert value(trace, setup, "penetration_max") == 7e-3
        expected = (69 * 1e-3 + 7e-3 + 20 * 2e-3) / 90
        assert value(trace, setup, "penetration_mean") == pytest.approx(expected)
        assert value(trace, setup, "penetration_steady") == pytest.approx(2e-3)
        speculative = replace(setup, speculative=np.array([True]))
        assert np.isnan(value(trace, speculative, "penetration_max"))

    def test_a_flight_has_no_steady_depth(self, pair_of: Any, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of(pairs=(pair_of(1, 100),))
        assert value(trace, setup_of(trace), "penetration_max") == 0
        assert np.isnan(value(trace, setup_of(trace), "penetration_steady"))

    def test_growth_is_the_slope_and_shrugs_off_spikes(
        self, pair_of: Any, trace_of: Any, setup_of: Any
    ) -> None:
        depth = 1e-3 + 5e-4 * np.arange(1000) * 2e-3
        depth[600:650] = 1.0
        pair = pair_of(1, 1000, distance=-depth[None, :, None], touching=depth[None, :, None] > 0)
        trace = trace_of(1, 1000, pairs=(pair,))
        # The spikes take 50 of 250 samples from one quarter, so its median moves by 50 at most.
        slope = value(trace, setup_of(trace), "penetration_growth")
        assert slope == pytest.approx(5e-4, rel=0.21)

    def test_without_monitored_pairs_all_contacts_count(self, trace_of: Any, setup_of: Any) -> None:
        least = np.full((1, 100), -3e-3)
        trace = trace_of(contacts=np.ones((1, 100), np.int32), least_distance=least)
        assert value(trace, setup_of(trace), "penetration_max") == 3e-3
        assert value(trace, setup_of(trace), "distance_min") == -3e-3


class TestConservation:
    @pytest.mark.parametrize("datum", [0.0, 100.0, -100.0])
    def test_gain_is_over_the_energy_at_the_start(
        self, trace_of: Any, setup_of: Any, datum: float
    ) -> None:
        height = np.array([[2.0, 1.0, 0.0, 1.0, 2.06]])
        trace = trace_of(1, 5, potential=height * 9.81 + datum)
        trace.kinetic[0, 1] = 9.81
        gain = value(trace, setup_of(trace), "energy_gain")
        assert gain == pytest.approx(0.03)
        assert np.isnan(value(trace, setup_of(trace, passive=False), "energy_gain"))

    def test_gain_of_a_scene_at_rest_counts_from_a_hundredth_of_a_body(
        self, trace_of: Any, setup_of: Any
    ) -> None:
        trace = trace_of(1, 50)
        trace.kinetic[0, 30] = 1e-9
        assert value(trace, setup_of(trace), "energy_gain") < 1e-6
        trace.kinetic[0, 30] = 0.1
        assert value(trace, setup_of(trace), "energy_gain") > 1

    def test_drift_is_over_peak_kinetic_energy_and_time(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of(1, 100, kinetic=np.linspace(5, 4, 100)[None])
        drift = value(trace, setup_of(trace), "energy_drift")
        assert drift == pytest.approx(-1 / 5 / 0.2)

    def test_speed_ratio_is_one_for_a_fall(self, trace_of: Any, setup_of: Any) -> None:
        time = np.arange(101) * 2e-3
        trace = trace_of(potential=(-9.81 * 9.81 / 2 * time**2 - 9.81 * time)[None, :100])
        trace.kinetic[:] = 0.5
        trace.qvel[0, :, 2] = -np.sqrt(1 + 9.81**2 * time**2 + 2 * 9.81 * time)
        # The last sensor row is one step before the last state: 1 step in 100.
        assert value(trace, setup_of(trace), "speed_ratio") == pytest.approx(1, abs=0.01)
        trace.qvel[0, 50, 0] = 10
        assert value(trace, setup_of(trace), "speed_ratio") > 3

    def test_momentum_and_spin_of_free_systems_only(self, trace_of: Any, setup_of: Any) -> None:
        still = trace_of()
        assert np.isnan(value(still, setup_of(still), "momentum_drift"))
        vectors = np.tile([2.0, 0, 0], (1, 100, 1))
        vectors[0, 40] = 2, 0.02, 0
        trace = trace_of(momentum=vectors, angular_momentum=vectors, kinetic=np.full((1, 100), 2.0))
        assert value(trace, setup_of(trace), "momentum_drift") == pytest.approx(0.01)
        assert value(trace, setup_of(trace), "spin_drift") == pytest.approx(0.01, rel=1e-4)

    def test_settle_time_is_of_the_last_motion(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of(3, 100)
        trace.kinetic[0, [0, 60]] = 1, 2e-6
        trace.kinetic[1, :] = 1
        found = value(trace, setup_of(trace), "settle_time")
        assert found == pytest.approx([61 * 2e-3, np.nan, 0], nan_ok=True)

    def test_final_speed_is_of_the_fastest(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of(1, 10, qvel=np.zeros((1, 11, 12)))
        trace.qvel[0, -1, [0, 6, 7]] = 1, 3, 4
        bodies = (FreeBody("a", 0, 0, np.ones(1)), FreeBody("b", 0, 6, np.ones(1)))
        assert value(trace, setup_of(trace, free_bodies=bodies), "final_speed") == 5


class TestSliding:
    def test_slip_creep_impulse(self, pair_of: Any, trace_of: Any, setup_of: Any) -> None:
        speed = np.zeros((1, 100, 1, 2))
        speed[0, :50, 0, 0], speed[0, 50:, 0, 1] = 0.1, 1e-3
        used = np.where(np.arange(100) < 50, 0.5, 0.1)[None, :, None, None] * [1.0, 0.0]
        pair = pair_of(1, 100, normal=10.0, tangential=used * 10, velocity=speed)
        trace = trace_of(pairs=(pair_of(1, 100, normal=1.0), pair))
        setup = setup_of(trace)
        assert value(trace, setup, "slip_distance") == pytest.approx(0.1 * 0.1 + 1e-3 * 0.1)
        assert value(trace, setup, "creep_speed") == pytest.approx(1e-3)
        assert value(trace, setup, "normal_impulse") == pytest.approx(2)
        assert value(trace, setup, "mode_switches") == pytest.approx(1 / 0.2)
        assert value(trace, setup, "cone_violation") == 0
        assert value(trace, setup, "complementarity") == 0

    def test_cone_and_complementarity_are_violated(
        self, pair_of: Any, trace_of: Any, setup_of: Any
    ) -> None:
        pair = pair_of(1, 100, normal=1.0, tangential=(0.6, 0.0), distance=1e-4)
        trace = trace_of(pairs=(pair,))
        assert value(trace, setup_of(trace), "cone_violation") == pytest.approx(0.2)
        assert value(trace, setup_of(trace), "complementarity") == pytest.approx(1e-4)
        assert "solver_inconsistent" in {
            each.label for each in assess_runs(trace, setup_of(trace)).labels[0]
        }


class TestSolver:
    def test_counts(self, pair_of: Any, trace_of: Any, setup_of: Any) -> None:
        touching = np.ones((1, 100, 2), dtype=bool)
        pair = pair_of(1, 100, slots=2, touching=touching)
        pair.slots[0, :7, :, 0] = 3
        contacts = np.full((1, 100), 2, np.int32)
        contacts[0, 7:11] = 4
        contacts[0, :7] = 3
        iterations = np.full((1, 100), 2, np.int32)
        iterations[0, :25] = 100
        trace = trace_of(
            pairs=(pair,), contacts=contacts, iterations=iterations * 2, iterations_most=iterations
        )
        expected = {
            "solver_iterations_mean": (25 * 200 + 75 * 4) / 100,
            "solver_iterations_max": 100,
            "solver_iterations": 25 * 200 + 75 * 4,
            "saturated_share": 0.25,
            "contacts_mean": (7 * 3 + 4 * 4 + 89 * 2) / 100,
            "contacts_max": 4,
            "contacts_cut": 7,
            "ungraded_contacts": 4,
        }
        found = assess_runs(trace, setup_of(trace)).metrics
        assert {name: found[name][0] for name in expected} == pytest.approx(expected)


@pytest.mark.parametrize("steps", [0, 1, 2, 7])
@pytest.mark.parametrize("poison", [0.0, np.nan, np.inf, -np.inf])
def test_every_metric_survives_short_and_broken_runs(
    pair_of: Any, trace_of: Any, setup_of: Any, steps: int, poison: float
) -> None:
    pairs = tuple(pair_of(2, steps, slots=s, normal=1.0, distance=-1e-3) for s in (1, 3))
    free = np.full((2, steps, 3), poison)
    trace = trace_of(2, steps, pairs=pairs, momentum=free, angular_momentum=free)
    for array in (trace.qpos, trace.qvel, trace.kinetic, trace.potential, trace.least_distance):
        array[:, -1:] += poison
    for pair in pairs:
        pair.slots[1, :, :, 1:] += poison
    setup = setup_of(trace, last_mode="slides")
    found = assess_runs(trace, setup)
    assert set(found.metrics) == set(METRICS)
    assert all(values.shape == (2,) for values in found.metrics.values())
    assert all(run for run in found.labels)
