"""The search finds what its aim means, within the time, of errors and prices in closed form."""

import math
import time
from dataclasses import dataclass, field

import mujoco
import pytest

from contactlab.schema.time_ratio import TimeRatio
from contactlab.studies.search.configuration import (
    AS_WRITTEN,
    Configuration,
    Key,
    changed_settings,
    format_settings,
)
from contactlab.studies.search.reference_error import ErrorEstimate
from contactlab.studies.search.search_space import Parameter, has_contacts
from contactlab.studies.search.settings_search import (
    EQUAL_ERROR_RATIO,
    Bound,
    Search,
    SearchSpace,
    error_of,
)

FINER, LONGEST = 4, 400
MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><option timestep="0.004"/><worldbody>
    <body><freejoint/><geom name="ball" size=".1" condim="6"/></body></worldbody></mujoco>"""
)
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
SPARSE = int(mujoco.mjtJacobian.mjJAC_SPARSE)


@dataclass
class Ideal:
    """Errors of first order in the step, of fourth for RK4; few iterations add theirs.

    Between two steps lies a bump.
    """

    slope: float
    few: float = 0.0
    bump: tuple[int, int] = (0, 0)
    asked: int = 0

    def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        self.asked += 1
        share = self.slope * multiple
        if model.opt.integrator == RK4:
            share = self.slope * (multiple / 8) ** 4
        if model.opt.iterations < 100:
            share += self.few
        if self.bump[0] < multiple < self.bump[1]:
            share = 1.0
        return ErrorEstimate(share, "ball", "neutral", 0.0, share, share)


@dataclass
class Costs:
    """Prices that go with the number of steps: RK4 takes four, a sparse Jacobian half the time."""

    base_seconds: float = 0.01
    timed: list[int] = field(default_factory=list[int])
    calls: int = 0

    def time_ratios(
        self,
        models: list[tuple[mujoco.MjModel, int]],
        turns: int = 3,
    ) -> list[TimeRatio]:
        del turns
        self.calls += 1
        return [self._price(*each) for each in models]

    def compare_segments(
        self, one: tuple[mujoco.MjModel, int], other: tuple[mujoco.MjModel, int], turns: int
    ) -> TimeRatio:
        del turns
        self.calls += 1
        ratio = self._price(*one).ratio / self._price(*other).ratio
        return TimeRatio.of(ratio, ratio, ratio)

    def _price(self, model: mujoco.MjModel, multiple: int) -> TimeRatio:
        self.timed.append(multiple)
        ratio = FINER / multiple * (4 if model.opt.integrator == RK4 else 1)
        ratio *= 0.5 if model.opt.jacobian == SPARSE else 1
        # A loose tolerance ends what few iterations end as well.
        early = model.opt.iterations < 100 or model.opt.tolerance > 1e-8
        ratio *= 0.8 if early else 1
        return TimeRatio.of(ratio, ratio, ratio)


def searched(
    measure: Ideal,
    limit: float,
    *,
    max_time_ratio: float | None = None,
    integrators: tuple[str, ...] = ("Euler",),
    seconds: float = 60.0,
    bounds: tuple[Bound, ...] = (),
    more: tuple[Parameter, ...] = (),
    costs: Costs | None = None,
) -> Search:
    levers = [
        Parameter("jacobian", [{"jacobian": "sparse"}, {"jacobian": "dense"}], cost_falls=False),
        Parameter("iterations", [], [{"iterations": 5}]),
        *more,
    ]
    space = SearchSpace({AS_WRITTEN: MODEL}, AS_WRITTEN, FINER, LONGEST, levers, integrators)
    deadline = time.monotonic() + seconds
    clock: object = costs or Costs()
    search = Search(
        space,
        measure,
        clock,  # pyright: ignore[reportArgumentType]
        bounds or (Bound.of(limit),),
        max_time_ratio,
        deadline,
    )
    search.run_search()
    return search


@pytest.mark.parametrize("limit", [0.01, 0.02, 0.05, 0.3])
def test_the_step_is_the_longest_that_keeps_the_limit(limit: float) -> None:
    slope = 1e-3
    best = searched(Ideal(slope), limit).rank_candidates(Bound.of(limit))[0].configuration
    longest = limit / slope
    assert longest / 1.2 <= best.multiple <= longest
    assert best.settings == {"jacobian": "sparse", "iterations": 5}


def test_steps_are_sought_beyond_those_whose_errors_are_larger() -> None:
    """The model has 4 fine steps, and 100 keep the limit; 64 are one of its doublings."""
    limit, slope = 0.1, 1e-3
    for bump in ((FINER, 32), (FINER, 60), (17, 40)):
        search = searched(Ideal(slope, bump=bump), limit)
        assert 100 / 1.2 <= search.rank_candidates(Bound.of(limit))[0].configuration.multiple <= 100
    # Beyond the last doubling that keeps the limit, nothing is sought.
    search = searched(Ideal(slope, bump=(FINER, 100)), limit)
    assert search.rank_candidates(Bound.of(limit))[0].configuration.multiple == FINER


def test_a_model_that_misses_the_limit_gets_a_finer_step() -> None:
    limit = 0.035
    search = searched(Ideal(0.01), limit)
    assert search.rank_candidates(Bound.of(limit))[0].configuration.multiple == 3
    assert search.evaluations[search.current.key].error


def test_what_nothing_meets_has_a_nearest() -> None:
    limit = 0.01
    search = searched(Ideal(1.0), limit)
    assert not search.rank_candidates(Bound.of(limit))
    nearest = search.closest_to(limit)
    assert nearest
    assert nearest.configuration.multiple == 2


def test_steps_of_a_later_bound_are_sought_without_what_the_first_found_to_be_waste() -> None:
    bounds = Bound.as_current(0.04), Bound.of(0.02)
    tried = searched(Ideal(0.01), 0.02, bounds=bounds).evaluations.values()
    shorter = [one.configuration for one in tried if one.configuration.multiple < FINER]
    assert shorter
    assert all("jacobian" in choice.settings for choice in shorter)


def test_what_time_did_not_allow_to_judge_is_the_cheapest_within_the_limit() -> None:
    """Not what has the least error; of what failed on fresh seeds, the next."""
    bound, failed = Bound.of(0.035), set[Key]()
    search = searched(Ideal(0.01), bound.limit)
    for tried in search.rank_candidates(bound):
        assert search.closest_to(bound.limit, failed) is tried
        failed.add(tried.configuration.key)
    within = [one for one in search.evaluations.values() if error_of(one) <= bound.limit]
    nearest = search.closest_to(bound.limit, {one.configuration.key for one in within})
    assert nearest
    assert error_of(nearest) == min(map(error_of, search.evaluations.values()))


def test_an_integrator_of_higher_order_wins_where_its_steps_are_four_times_as_long() -> None:
    """Errors are 1e-2 at one step, and for RK4 1e-2 (m / 8)^4: 4 m > 4 x the other's step."""
    limit = 0.05
    best = (
        searched(Ideal(1e-2), limit, integrators=("Euler", "RK4"))
        .rank_candidates(Bound.of(limit))[0]
        .configuration
    )
    euler, rk4 = limit / 1e-2, 8 * (limit / 1e-2) ** 0.25
    assert rk4 < 4 * euler
    assert "integrator" not in best.settings
    limit = 0.01
    best = (
        searched(Ideal(4e-3), limit, integrators=("Euler", "RK4"))
        .rank_candidates(Bound.of(limit))[0]
        .configuration
    )
    euler, rk4 = limit / 4e-3, 8 * (limit / 4e-3) ** 0.25
    assert rk4 > 4 * euler
    assert best.settings["integrator"] == "RK4"


def test_what_saves_time_and_misses_the_limit_is_left_out() -> None:
    limit = 0.02
    best = searched(Ideal(1e-3, few=0.05), limit).rank_candidates(Bound.of(limit))[0].configuration
    assert "iterations" not in best.settings
    assert best.settings["jacobian"] == "sparse"


def test_of_settings_that_save_the_same_time_one_is_left() -> None:
    limit, loose = 0.02, Parameter("tolerance", [{"tolerance": 1e-6}])
    search = searched(Ideal(1e-3), limit, more=(loose,))
    best = search.rank_candidates(Bound.of(limit))[0].configuration
    assert best.settings == {"jacobian": "sparse", "tolerance": 1e-6}


def test_the_step_is_found_first_by_errors_and_what_is_free_by_few_timings() -> None:
    """Each of three rounds times all values at once, what is added beside it, and what is left."""
    limit = 0.02
    search = searched(Ideal(1e-3), limit, more=(Parameter("noslip", [{"noslip_iterations": 1}]),))
    tried = list(search.evaluations.values())
    set_first = next(place for place, one in enumerate(tried) if one.configuration.settings)
    (alone,) = (one for one in tried[1:set_first] if one.time_ratio)
    assert 20 / 1.15 <= alone.configuration.multiple <= 20
    assert isinstance(search.clock, Costs)
    assert search.clock.calls < 17


def test_at_a_price_the_most_accurate_is_found() -> None:
    """Half the time, of which the Jacobian saves half: so the step stays what it is."""
    limit = 0.02
    search = searched(Ideal(1e-3), limit, max_time_ratio=0.5)
    best = search.rank_candidates(Bound.of(limit))[0]
    assert best.time_ratio
    assert best.time_ratio.ratio <= 0.5
    assert best.configuration.multiple in (FINER - 1, FINER)


@pytest.mark.parametrize(("seconds", "longest"), [(0.0, FINER), (20.0, 298), (1000.0, 298)])
def test_little_time_gives_the_longest_step(
    seconds: float, longest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Errors take a second, a price three: five errors tell the step, before all else is timed."""
    measure, limit = Ideal(1e-3), 0.3
    costs = Costs()
    monkeypatch.setattr(time, "monotonic", lambda: measure.asked + 3.0 * len(costs.timed))
    search = searched(measure, limit, seconds=seconds, costs=costs)
    assert search.timed_out is (seconds < 1000)
    ranked = search.rank_candidates(Bound.of(limit))
    assert ranked[0].configuration.multiple >= longest if ranked else longest == FINER
    assert time.monotonic() < seconds + 3.0 * 12


def test_a_choice_says_what_it_changes() -> None:
    choice = Configuration({"geom_condim[ball]": 3, "cone": "elliptic", "island": False}, 2)
    made = choice.apply_to(MODEL)
    assert made.geom_condim[0] == 3
    assert MODEL.geom_condim[0] == 6
    assert changed_settings(choice.settings, made) == {}
    assert changed_settings({"cone": "elliptic", "iterations": 100}, MODEL) == {"cone": "elliptic"}
    assert format_settings(choice.settings) == "cone elliptic, island off, geom_condim 3 of 1"
    assert math.isclose(choice.with_step(5).multiple, 5)


def test_of_a_model_that_misses_its_aim_what_is_as_accurate_is_found_and_what_keeps_the_aim() -> (
    None
):
    """One step has 1 % of error, so 4 % as written: equal at its own step, or 3 steps for 3 %."""
    aim = Bound.of(0.035)
    as_current = Bound.as_current(0.04)
    search = searched(Ideal(0.01), aim.limit, bounds=(as_current, aim))
    same, kept = (search.rank_candidates(bound)[0] for bound in (as_current, aim))
    assert (same.configuration.multiple, kept.configuration.multiple) == (FINER, 3)
    assert (
        same.configuration.settings
        == kept.configuration.settings
        == {"jacobian": "sparse", "iterations": 5}
    )
    assert same.time_ratio
    assert same.time_ratio.ratio < 1


def test_what_keeps_its_aim_may_stay_as_accurate_as_it_is() -> None:
    """Just within the aim as written, equal steps have equal noise, which would refuse some."""
    aim = Bound.of(0.02)
    assert aim.or_as_current(0.0199) == Bound(0.02, EQUAL_ERROR_RATIO * 0.0199)
    assert aim.or_as_current(0.001) == aim
    assert aim.or_as_current(0.2) == aim


def test_the_safest_is_as_accurate_as_now_at_its_own_step() -> None:
    """Longer steps are cheaper, and nearly use up the limit; the Jacobian costs no accuracy."""
    limit = 0.3
    search = searched(Ideal(1e-3, few=0.05), limit)
    best = search.rank_candidates(Bound.of(limit))[0]
    safest = search.as_accurate_as_current(time.monotonic() + 10)[0]
    assert best.configuration.multiple > 10 * FINER
    assert (safest.configuration.multiple, safest.configuration.settings) == (
        FINER,
        {"jacobian": "sparse"},
    )
    # Without time, it is what is known, and never at longer steps.
    late = searched(Ideal(1e-3, few=0.05), limit).as_accurate_as_current(-math.inf)
    assert late
    assert all(one.time_ratio and one.configuration.multiple <= FINER for one in late)


@pytest.mark.parametrize(
    ("other", "may_touch"),
    [
        ("", False),
        ('<geom type="plane" size="1 1 1"/>', True),
        ('<geom type="plane" size="1 1 1" contype="0" conaffinity="2"/>', False),
    ],
)
def test_contacts_go_only_where_there_can_be_none(other: str, *, may_touch: bool) -> None:
    ball = '<body><freejoint/><geom name="ball" size=".1"/></body>'
    text = f"<mujoco><worldbody>{other}{ball}</worldbody></mujoco>"
    assert has_contacts(mujoco.MjModel.from_xml_string(text)) is may_touch
    if not may_touch and other:
        pair = '<contact><pair geom1="ball" geom2="floor"/></contact>'
        listed = text.replace("<geom type", '<geom name="floor" type')
        listed = listed.replace("</worldbody>", f"</worldbody>{pair}")
        assert has_contacts(mujoco.MjModel.from_xml_string(listed))
