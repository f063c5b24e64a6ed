"""Planted defects get their label, and healthy runs get none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Trace
from contactlab.contact.trace_setup import Barrier, FreeBody, Setup
from contactlab.errors import SceneError
from contactlab.measure import LABELS, THRESHOLDS, AppliedLabel, assess_runs, threshold_values

ORDER = (
    "crashed timeout invalid buffer_overflow diverged solver_inconsistent solver_nonconvergence "
    "broken tunneling "
    "missed_contact constraint_violated phantom_contact asleep_unsupported contact_at_distance "
    "energy_injection energy_loss penetration_growth exploited squeezed deep_penetration drift "
    "chatter constraint_gain step_dependent slipping unsettled creep broken_requirement "
    "pair_expectation oracle_miss contacts_cut "
    "choice_dependent stable"
)


def outcomes(trace: Trace, setup: Setup, run: int = 0) -> list[AppliedLabel]:
    return list(assess_runs(trace, setup).labels[run])


def only(trace: Trace, setup: Setup) -> AppliedLabel:
    found = outcomes(trace, setup)
    assert len(found) == 1, found
    return found[0]


def test_every_label_and_threshold_says_what_it_is() -> None:
    assert " ".join(LABELS) == ORDER
    read = {limit.name for label in LABELS.values() for limit in label.thresholds}
    assert read == set(THRESHOLDS)
    for label in LABELS.values():
        assert label.meaning.endswith(".")
    for threshold in THRESHOLDS.values():
        assert threshold.unit
        assert threshold.source.endswith(".")
        assert threshold.default is None or threshold.default > 0


def test_unknown_thresholds_are_refused() -> None:
    with pytest.raises(SceneError, match="did you mean 'energy_gain'"):
        threshold_values({"energy_gian": 1})
    assert threshold_values({"energy_gain": 0.5})["energy_gain"] == 0.5


def test_a_healthy_run_is_stable(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of()
    assert only(trace, setup_of(trace)).label == "stable"


def test_the_worst_label_is_first_and_all_are_kept(
    pair_of: Any, trace_of: Any, setup_of: Any
) -> None:
    pair = pair_of(2, 100, normal=1.0, distance=-0.02)
    trace = trace_of(2, 100, pairs=(pair,))
    trace.qvel[1, 40, 0] = np.nan
    found = assess_runs(trace, setup_of(trace, thickness=np.full(1, 0.03))).labels
    assert [each.label for each in found[0]] == ["deep_penetration"]
    assert [each.label for each in found[1]] == ["diverged", "deep_penetration"]


class TestDiverged:
    @pytest.mark.parametrize("name", ["qpos", "qvel"])
    @pytest.mark.parametrize("poison", [np.nan, np.inf])
    def test_numbers(self, trace_of: Any, setup_of: Any, name: str, poison: float) -> None:
        trace = trace_of()
        getattr(trace, name)[0, 40, 1] = poison
        found = outcomes(trace, setup_of(trace))[0]
        assert found == ("diverged", f"{name} is not finite", 39, ())

    def test_energy(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of()
        trace.kinetic[0, 40] = np.nan
        found = outcomes(trace, setup_of(trace))[0]
        assert found == ("diverged", "energy is not finite", 40, ())

    def test_warnings_by_name(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of(warnings=({"BADQACC": 2, "INERTIA": 0},))
        assert only(trace, setup_of(trace)).reason == "engine warnings: BADQACC x2"

    def test_a_run_cut_short(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of().select([0], 60)
        assert only(trace, setup_of(trace)).reason == "stopped after 60 of 100 steps"

    def test_a_silent_reset(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of()
        trace.time[0, 50:] -= trace.time[0, 50]
        found = only(trace, setup_of(trace))
        assert (found.label, found.step) == ("diverged", 49)
        assert "the clock moved by -0.098 s" in found.reason

    def test_long_clocks_round(self, trace_of: Any, setup_of: Any) -> None:
        time = np.cumsum(np.full((1, 100001), 1e-5), axis=1) - 1e-5 + 500
        trace = trace_of(1, 100000, 1e-5, time=time)
        assert only(trace, setup_of(trace)).label == "stable"

    @pytest.mark.parametrize(("norm", "label"), [(1.0005, "stable"), (0.995, "diverged")])
    def test_quaternions(self, trace_of: Any, setup_of: Any, norm: float, label: str) -> None:
        trace = trace_of()
        trace.qpos[0, 30, 3] = norm
        assert only(trace, setup_of(trace)).label == label

    def test_every_sign_is_in_the_reason(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of(warnings=({"BADQVEL": 1},))
        trace.qpos[0, 30, 0] = trace.qvel[0, 20, 0] = np.nan
        found = outcomes(trace, setup_of(trace))[0]
        assert found.reason.count(";") == 2
        assert found.step == 19


@pytest.mark.parametrize("case", ["steps", "timestep", "duration"])
def test_invalid(trace_of: Any, setup_of: Any, case: str) -> None:
    trace = trace_of(steps=0) if case == "steps" else trace_of()
    setup = setup_of(trace, duration=np.full(1, 0.0 if case == "duration" else 0.2))
    if case == "timestep":
        trace = replace(trace, timestep=np.zeros(1))
    assert outcomes(trace, setup)[0].label == "invalid"


@pytest.mark.parametrize(
    ("residual", "used", "known", "label"),
    [
        (0.11, 20, None, "solver_nonconvergence"),
        (0.11, 19, None, "solver_inconsistent"),
        (0.11, 20, 0.09, "solver_nonconvergence"),
        (0.11, 19, 0.09, "stable"),
        (0.09, 20, None, "stable"),
        (0.0, 20, None, "stable"),
    ],
)
def test_what_a_solver_leaves_is_held_against_the_tolerance(
    trace_of: Any,
    setup_of: Any,
    checks_of: Any,
    *,
    residual: float,
    used: int,
    known: float | None,
    label: str,
) -> None:
    """Forces that differ by more than a tenth are phantom; all 20 iterations alone are nothing.

    Nor are forces of a solver that was content, where the run is its model's motion all the same.
    """
    contacts = np.ones((1, 100), np.int32)
    trace = trace_of(contacts=contacts, iterations_most=np.full((1, 100), used, np.int32))
    setup = setup_of(trace, iterations=np.array([20], np.int32))
    checks = checks_of(100, residual, known)
    (found,) = assess_runs(trace, setup, checks).labels[0]
    assert found.label == label


@pytest.mark.parametrize(("hard", "label"), [(1, "stable"), (3, "solver_nonconvergence")])
def test_a_single_hard_step_is_no_failure(
    trace_of: Any, setup_of: Any, checks_of: Any, hard: int, label: str
) -> None:
    """Whatever the others leave, in which the solver was done."""
    used = np.where(np.arange(100) < hard, 20, 3).astype(np.int32)[None]
    trace = trace_of(contacts=np.ones((1, 100), np.int32), iterations_most=used)
    checks = checks_of(100)
    checks.residual[0, :hard] = 0.5
    setup = setup_of(trace, iterations=np.array([20], np.int32))
    assert assess_runs(trace, setup, checks).labels[0][0].label == label


class TestTunneling:
    def crossing(self, trace_of: Any, setup_of: Any, pair_of: Any, **changes: Any) -> Any:
        pair = pair_of(1, 100, **changes.pop("contact", {}))
        trace = trace_of(pairs=(pair,))
        trace.qpos[0, :, 0] = changes.pop("x", 0.0)
        trace.qpos[0, :, 2] = changes.pop("z", np.linspace(1, -1, 101))
        body = FreeBody("ball", 0, 0, np.ones(1))
        point = np.array([0.0, 0.0, changes.pop("height", 0.0)])
        plate = Barrier(0, body, point, np.array([0.0, 0.0, 1.0]), changes.pop("reach", 0.1))
        return trace, setup_of(trace, barriers=(plate,), passive=False)

    @pytest.mark.parametrize("start", [1.0, -1.0])
    def test_with_or_without_contact(
        self, trace_of: Any, setup_of: Any, pair_of: Any, start: float
    ) -> None:
        z = np.linspace(start, -start, 101) + 0.01
        for contact in ({}, {"normal": 1.0}):
            made = self.crossing(trace_of, setup_of, pair_of, z=z, contact=contact)
            found = only(*made)
            assert (found.label, found.step) == ("tunneling", 50 if start > 0 else 49)
            assert "ball passed the mid-plane of floor-box" in found.reason

    @pytest.mark.parametrize(
        ("own", "cause"), [(0.02, "the model"), (0.2, "the numerics"), (None, "the numerics")]
    )
    def test_its_cause_is_that_of_its_own_body(
        self,
        trace_of: Any,
        setup_of: Any,
        pair_of: Any,
        checks_of: Any,
        own: float | None,
        cause: str,
    ) -> None:
        """A run with an error of 30 % in `b`; that counts for bodies without one of their own."""
        trace, setup = self.crossing(trace_of, setup_of, pair_of)
        checks = checks_of(100, backward=0.3)
        errors = (("b", 0.3), *(() if own is None else (("ball", own),)))
        checks = replace(checks, backward=(checks.backward[0]._replace(errors=errors),))
        found = assess_runs(trace, setup, checks).labels[0][0]
        share, body = (30, "b") if own is None else (100 * own, "ball")
        assert found.label == "tunneling"
        assert found.reason.endswith(f"; cause: {cause} (numerical error {share:g} % in {body})")

    def test_its_cause_may_be_the_numerics_of_a_body_that_touched_it(
        self, trace_of: Any, setup_of: Any, pair_of: Any, checks_of: Any
    ) -> None:
        for touches in (0.0, 1.0):
            trace, setup = self.crossing(trace_of, setup_of, pair_of, contact={"normal": touches})
            checks = checks_of(100, backward=0.3)
            errors = ("b", 0.3), ("ball", 0.01)
            checks = replace(checks, backward=(checks.backward[0]._replace(errors=errors),))
            setup = replace(setup, sides=(("ball", "b"),))
            reason = assess_runs(trace, setup, checks).labels[0][0].reason
            assert ("cause: the numerics" in reason) == bool(touches)

    def test_a_plate_is_where_it_is(self, trace_of: Any, setup_of: Any, pair_of: Any) -> None:
        z = np.linspace(3, 1, 101) + 0.01
        for height, label in ((2.0, "tunneling"), (0.5, "stable"), (-2.0, "stable")):
            made = self.crossing(trace_of, setup_of, pair_of, z=z, height=height)
            assert only(*made).label == label

    def test_beside_a_plate_there_is_nothing_to_pass(
        self, trace_of: Any, setup_of: Any, pair_of: Any
    ) -> None:
        made = self.crossing(trace_of, setup_of, pair_of, x=0.11)
        assert only(*made).label == "stable"
        assert only(*self.crossing(trace_of, setup_of, pair_of, x=0.09)).label == "tunneling"
        plane = self.crossing(trace_of, setup_of, pair_of, x=1e3, reach=np.inf)
        assert only(*plane).label == "tunneling"

    def test_the_way_between_two_states_is_straight(
        self, trace_of: Any, setup_of: Any, pair_of: Any
    ) -> None:
        # The plane is met at a quarter of the step, where x is a quarter of 0.3 or of 0.5.
        z = np.where(np.arange(101) < 50, 0.1, -0.3)
        for far, label in ((0.3, "tunneling"), (0.5, "stable")):
            x = np.where(np.arange(101) < 50, 0.0, far)
            assert only(*self.crossing(trace_of, setup_of, pair_of, z=z, x=x)).label == label

    def test_a_pair_without_barrier_by_its_thickness(
        self, trace_of: Any, setup_of: Any, pair_of: Any
    ) -> None:
        distance = np.zeros((1, 100, 1))
        distance[0, 30:33] = -0.006
        pair = pair_of(1, 100, distance=distance, touching=distance < 0)
        trace = trace_of(pairs=(pair,))
        assert only(trace, setup_of(trace, thickness=np.array([0.007]))).label == "stable"
        thin = setup_of(trace, thickness=np.array([0.005]))
        assert only(trace, thin)[::2] == ("tunneling", 30)
        speculative = replace(thin, speculative=np.array([True]))
        assert only(trace, speculative).label == "stable"

    def test_an_overlap_with_a_fixed_plate_is_in_the_reason(
        self, trace_of: Any, setup_of: Any, pair_of: Any
    ) -> None:
        """A ball may be deeper in a plate than its middle, while its center is outside."""
        distance = np.zeros((1, 100, 1))
        distance[0, 30:33] = -0.006
        contact = {"distance": distance, "touching": distance < 0}
        made = {"z": np.full(101, 0.5), "contact": contact}
        trace, setup = self.crossing(trace_of, setup_of, pair_of, **made)
        found = only(trace, replace(setup, thickness=np.array([0.005])))
        assert found.label == "stable"
        assert "5 mm from the surface, for 6 ms; its center stays outside" in found.reason
        assert "deeper" not in only(trace, replace(setup, thickness=np.array([0.007]))).reason


class TestEnergy:
    @pytest.mark.parametrize(("gain", "label"), [(0.02, "energy_injection"), (0.005, "stable")])
    def test_gain(self, trace_of: Any, setup_of: Any, gain: float, label: str) -> None:
        potential = np.full((1, 100), 10.0)
        potential[0, 50], potential[0, 70:] = 0, 10 * (1 + gain)
        trace = trace_of(potential=potential)
        found = only(trace, setup_of(trace))
        assert found.label == label
        assert found.step == (70 if label != "stable" else 0)
        assert only(trace, setup_of(trace, passive=False)).label == "stable"
        assert only(trace, setup_of(trace, thresholds={"energy_gain": 0.03})).label == "stable"

    def test_an_ejected_body(self, trace_of: Any, setup_of: Any) -> None:
        trace = trace_of(kinetic=np.full((1, 100), 0.5))
        trace.qvel[0, 30:, 0] = 1.04
        assert only(trace, setup_of(trace)).label == "stable"
        trace.qvel[0, 40:, 0] = 1.06
        found = only(trace, setup_of(trace))
        assert (found.label, found.step) == ("energy_injection", 39)


class TestDepth:
    @pytest.mark.parametrize(
        ("depth", "accepted", "label"),
        [
            (1.9e-3, {"thickness": np.array([4e-3])}, "stable"),
            (2.1e-3, {"thickness": np.array([4e-3])}, "deep_penetration"),
            (2.6e-3, {"thickness": np.array([4e-3]), "widths": np.array([2e-3])}, "stable"),
            (
                2.7e-3,
                {"thickness": np.array([4e-3]), "widths": np.array([2e-3])},
                "deep_penetration",
            ),
            (8e-3, {"thickness": np.array([4.0])}, "stable"),
            (2e-4, {"thresholds": {"penetration_steady": 1e-4}}, "deep_penetration"),
            (
                2.1e-3,
                {"thickness": np.array([4e-3]), "thresholds": {"penetration_steady": 3e-3}},
                "stable",
            ),
        ],
    )
    def test_deep_penetration(
        self, pair_of: Any, trace_of: Any, setup_of: Any, *, depth: float, accepted: Any, label: str
    ) -> None:
        trace = trace_of(pairs=(pair_of(1, 100, normal=1.0, distance=-depth),))
        assert only(trace, setup_of(trace, **accepted)).label == label

    @pytest.mark.parametrize("steps", [250, 1000, 2500])
    @pytest.mark.parametrize(
        ("rate", "label"), [(1.25e-4, "penetration_growth"), (1.15e-4, "stable")]
    )
    def test_growth_is_a_rate_whatever_the_duration(
        self, pair_of: Any, trace_of: Any, setup_of: Any, rate: float, label: str, steps: int
    ) -> None:
        """Per second, 3 % of 4 mm are 0.12 mm."""
        depth = (1e-4 + rate * np.arange(steps) * 2e-3)[None, :, None]
        trace = trace_of(1, steps, pairs=(pair_of(1, steps, normal=1.0, distance=-depth),))
        assert only(trace, setup_of(trace, thickness=np.array([4e-3]))).label == label

    @pytest.mark.parametrize(("own_time", "label"), [(1.1, "stable"), (0.9, "penetration_growth")])
    def test_no_contact_sinks_sooner_than_its_own_time(
        self, pair_of: Any, trace_of: Any, setup_of: Any, own_time: float, label: str
    ) -> None:
        depth = (1e-4 + 1.25e-4 * np.arange(1000) * 2e-3)[None, :, None]
        trace = trace_of(1, 1000, pairs=(pair_of(1, 1000, normal=1.0, distance=-depth),))
        judged = setup_of(trace, thickness=np.array([4e-3]), contact_time=np.array([own_time]))
        assert only(trace, judged).label == label

    @pytest.mark.parametrize("time_constants", [3, 4, 8])
    @pytest.mark.parametrize("steps", [48, 1000])
    def test_contact_that_settles_does_not_sink(
        self, pair_of: Any, trace_of: Any, setup_of: Any, time_constants: float, steps: int
    ) -> None:
        """A critically damped contact reaches its depth as 1 - (1 + t) exp(-t)."""
        times = np.linspace(0, time_constants, steps + 1)[1:]
        depth = 1e-3 * (1 - (1 + times) * np.exp(-times))[None, :, None]
        trace = trace_of(1, steps, pairs=(pair_of(1, steps, normal=1.0, distance=-depth),))
        assert only(trace, setup_of(trace, thickness=np.array([4e-3]))).label == "stable"

    @pytest.mark.parametrize(("power", "label"), [(1.0, "stable"), (0.5, "penetration_growth")])
    def test_depth_in_proportion_to_its_load_is_no_growth(
        self, pair_of: Any, trace_of: Any, setup_of: Any, power: float, label: str
    ) -> None:
        load = (1 + np.arange(1000) / 500)[None, :, None]
        pair = pair_of(1, 1000, normal=load**power, distance=-1e-3 * load)
        trace = trace_of(1, 1000, pairs=(pair,))
        assert only(trace, setup_of(trace, thickness=np.array([8e-3]))).label == label


class TestFriction:
    def pad(self, pair_of: Any, trace_of: Any, slides: Any) -> Any:
        """Return a trace of 1 s in which a pair slides wherever `slides` (500,) holds."""
        slides = np.asarray(slides)[None, :, None, None]
        pair = pair_of(
            1,
            500,
            normal=1.0,
            tangential=np.where(slides, 0.5, 0.1) * [1.0, 0.0],
            velocity=np.where(slides, 0.1, 0.0) * [1.0, 0.0],
        )
        return trace_of(1, 500, pairs=(pair,))

    @pytest.mark.parametrize(("period", "label"), [(50, "chatter"), (125, "stable")])
    def test_chatter(
        self, pair_of: Any, trace_of: Any, setup_of: Any, period: int, label: str
    ) -> None:
        trace = self.pad(pair_of, trace_of, np.arange(500) // period % 2)
        found = only(trace, setup_of(trace))
        assert (found.label, found.step) == (label, period if label == "chatter" else 0)

    @pytest.mark.parametrize(("extent", "label"), [(0.5, "stable"), (0.2, "chatter")])
    def test_what_hops_and_trembles_is_no_chatter(
        self, pair_of: Any, trace_of: Any, setup_of: Any, *, extent: float, label: str
    ) -> None:
        """Half of the time at 0.1 m/s, in stretches of 0.1 s: 5 mm from switch to switch."""
        trace = self.pad(pair_of, trace_of, np.arange(500) // 50 % 2)
        assert only(trace, setup_of(trace, thickness=np.array([extent]))).label == "chatter"
        trace.pairs[0].slots[:, ::5] = 0
        assert only(trace, setup_of(trace, thickness=np.array([extent]))).label == label

    def test_two_switches_are_no_chatter_however_short(
        self, pair_of: Any, trace_of: Any, setup_of: Any
    ) -> None:
        trace = self.pad(pair_of, trace_of, np.arange(500) // 10 % 2)
        setup = setup_of(trace)
        assert only(trace.select([0], 500), setup).label == "chatter"
        short = replace(trace.select([0], 25), steps_asked=25)
        assert assess_runs(short, setup).metrics["mode_switches"][0] > 5
        assert only(short, setup).label == "stable"

    @pytest.mark.parametrize("when", ["first", "last"])
    @pytest.mark.parametrize("wanted", ["stick", "slide"])
    def test_unexpected_modes(
        self, pair_of: Any, trace_of: Any, setup_of: Any, when: str, wanted: str
    ) -> None:
        early = np.arange(500) < 250
        for first in ("stick", "slide"):
            trace = self.pad(pair_of, trace_of, early if first == "slide" else ~early)
            shown = first if when == "first" else {"stick": "slide", "slide": "stick"}[first]
            found = only(trace, setup_of(trace, **{f"{when}_mode": f"{wanted}s"}))
            expected = "stable" if shown == wanted else "pair_expectation"
            assert found.label == expected
            assert expected == "stable" or f"but {shown}s" in found.reason
            assert found.step == (250 if expected != "stable" and when == "last" else 0)

    def test_a_mode_must_be_held(self, pair_of: Any, trace_of: Any, setup_of: Any) -> None:
        # Ten samples last 20 ms.
        steps = np.arange(500)
        for samples, label in ((9, "stable"), (10, "pair_expectation")):
            trace = self.pad(pair_of, trace_of, steps >= samples)
            assert only(trace, setup_of(trace, first_mode="slides")).label == label
