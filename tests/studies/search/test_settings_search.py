"""The search finds what its aim means, of errors and costs in closed form, and repeats itself."""

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import mujoco
import numpy as np
import pytest

from contactlab.modifications.model_predicates import has_possible_contacts
from contactlab.studies.search.configuration import (
    AS_WRITTEN,
    Configuration,
    Key,
    changed_settings,
    format_settings,
)
from contactlab.studies.search.search_space import Parameter
from contactlab.studies.search.settings_search import (
    EQUAL_ERROR_RATIO,
    SAVING,
    STEP_MARGIN,
    Bound,
    Search,
    SearchSpace,
    error_of,
    find_undominated,
    find_usable_steps,
)
from contactlab.tasks.reference_error import ErrorEstimate

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
    """Costs that go with the number of steps: RK4 takes four, a sparse Jacobian half the work."""

    counted: list[int] = field(default_factory=list[int])

    def count_cost(self, model: mujoco.MjModel, multiple: int) -> float:
        self.counted.append(multiple)
        cost = FINER / multiple * (4 if model.opt.integrator == RK4 else 1)
        cost *= 0.5 if model.opt.jacobian == SPARSE else 1
        # A loose tolerance ends what few iterations end as well.
        early = model.opt.iterations < 100 or model.opt.tolerance > 1e-8
        return cost * (0.8 if early else 1)


STEPS = find_usable_steps(0.004, 0.001, 0.4, None)[1:]  # the first is the reference's


def searched(
    measure: Ideal,
    limit: float,
    *,
    max_cost: float | None = None,
    integrators: tuple[str, ...] = ("Euler",),
    seconds: float = 60.0,
    work: float = 1e6,
    bounds: tuple[Bound, ...] = (),
    more: tuple[Parameter, ...] = (),
    steps: Sequence[int] = STEPS,
    exact: tuple[str, ...] = (),
    front_limit: float = 0.0,
) -> Search:
    levers = [
        Parameter("jacobian", [{"jacobian": "sparse"}, {"jacobian": "dense"}], cost_falls=False),
        Parameter("iterations", [], [{"iterations": 5}]),
        *more,
    ]
    space = SearchSpace({AS_WRITTEN: MODEL}, AS_WRITTEN, FINER, steps, levers, integrators)

    def is_exact(model: mujoco.MjModel) -> bool:
        return "jacobian" in exact and model.opt.jacobian == SPARSE

    until = time.monotonic() + seconds
    search = Search(
        space,
        measure,
        Costs(),
        bounds or (Bound.of(limit),),
        max_cost,
        work,
        lambda: time.monotonic() > until,
        is_exact,
        front_limit,
        work,
    )
    search.run_search()
    return search


def longest_step(multiple: float) -> int:
    return max(step for step in STEPS if step <= multiple)


@pytest.mark.parametrize("limit", [0.01, 0.02, 0.05, 0.3])
def test_the_step_is_the_longest_usable_one_that_keeps_the_limit(limit: float) -> None:
    slope = 1e-3
    best = searched(Ideal(slope), limit).rank_candidates(Bound.of(limit))[0].configuration
    assert best.multiple == longest_step(limit / slope)
    assert best.settings == {"jacobian": "sparse", "iterations": 5}


def test_steps_beyond_one_whose_error_is_larger_are_found_and_beyond_two_are_not() -> None:
    limit, slope = 0.1, 1e-3
    search = searched(Ideal(slope, bump=(8, 20)), limit)  # 10 fine steps fail
    assert search.rank_candidates(Bound.of(limit))[0].configuration.multiple == 100
    search = searched(Ideal(slope, bump=(8, 40)), limit)  # 10, 20 and 25 fail
    assert search.rank_candidates(Bound.of(limit))[0].configuration.multiple == 8


def test_a_model_that_misses_the_limit_gets_a_finer_step() -> None:
    limit = 0.035
    search = searched(Ideal(0.01), limit)
    assert search.rank_candidates(Bound.of(limit))[0].configuration.multiple == 2
    assert search.evaluations[search.current.key].error


def test_usable_steps_divide_the_period_of_a_controller() -> None:
    steps = find_usable_steps(0.002, 0.0005, 0.04, 0.02)
    assert all(math.isclose(0.02 / (0.0005 * each) % 1, 0, abs_tol=1e-9) for each in steps)
    assert 40 in steps  # the period itself
    assert not any(0.0005 * each > 0.02 for each in steps)


def test_usable_steps_are_round_numbers_and_keep_a_margin_to_the_next() -> None:
    steps = find_usable_steps(0.002, 0.0005, 0.04, None)
    assert [0.0005 * each for each in steps] == pytest.approx(
        [0.0005, 0.001, 0.002, 0.0025, 0.004, 0.005, 0.008, 0.01, 0.02, 0.025, 0.04]
    )
    for shorter, longer in itertools.pairwise(steps):
        assert shorter <= STEP_MARGIN * longer


def test_steps_of_an_odd_step_are_its_own_parts_and_doubles() -> None:
    own = 1 / 240
    steps = find_usable_steps(own, own / 4, 0.04, None)
    assert steps == (1, 2, 4, 8, 16, 24, 32)  # 24 are 25 ms


@pytest.mark.parametrize(("steps", "found"), [((4, 90, 100), 4), ((4, 80, 100), 80)])
def test_a_step_near_one_that_failed_is_not_recommended(steps: tuple[int, ...], found: int) -> None:
    search = searched(Ideal(1e-3), 0.095, steps=steps)
    measured = [one for one in search.evaluations.values() if one.error]
    failed = {one.configuration.multiple for one in measured if error_of(one) > 0.095}
    assert failed == {100}
    assert search.rank_candidates(Bound.of(0.095))[0].configuration.multiple == found


@pytest.mark.parametrize("work", [0.5, 1.0, 2.0, 1e6])
def test_the_same_search_makes_the_same_trials_on_any_machine(
    work: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock that runs at another rate in each look, as beside busy programs, changes nothing."""
    runs = list[list[tuple[Key, float]]]()
    for seed in range(4):
        looks = itertools.accumulate(np.random.default_rng(seed).exponential(seed, size=10_000))
        monkeypatch.setattr(time, "monotonic", partial(next, looks))
        search = searched(Ideal(1e-3), 0.05, work=work, seconds=1e9, integrators=("Euler", "RK4"))
        assert search.ending == ("complete" if work > 1e3 else "work")
        runs.append([(key, error_of(one)) for key, one in search.evaluations.items()])
    assert all(run == runs[0] for run in runs)


def test_exact_savings_are_found_before_all_else() -> None:
    """Of a slow model, the work of two tasks is enough for them."""
    search = searched(Ideal(1e-3), 0.05, work=2.0, exact=("jacobian",))
    assert search.ending == "work"
    (best,) = (one for one in search.evaluations.values() if one.exact and one.cost < 1)
    assert best.configuration.settings == {"jacobian": "sparse"}
    assert best.configuration.multiple == FINER


def test_time_ends_the_search_and_it_says_so() -> None:
    search = searched(Ideal(1e-3), 0.05, seconds=-1.0)
    assert search.ending == "time"
    measured = [one.configuration for one in search.evaluations.values() if one.error]
    assert measured == [search.current]
    assert search.trials > 1


def test_what_nothing_meets_has_a_nearest() -> None:
    limit = 0.01
    search = searched(Ideal(1.0), limit)
    assert not search.rank_candidates(Bound.of(limit))
    nearest = search.closest_to(limit)
    assert nearest
    assert nearest.configuration.multiple == 2


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


def test_each_integrator_has_a_ladder_of_finer_and_longer_steps() -> None:
    """RK4 takes four times the work; at a fine step it is far more accurate."""
    slope, limit = 1e-3, 0.05
    search = searched(Ideal(slope), limit, integrators=("Euler", "RK4"), front_limit=0.1)
    tried = {
        (one.configuration.settings.get("integrator"), one.configuration.multiple): error_of(one)
        for one in search.evaluations.values()
        if one.error
    }
    for name in (None, "RK4"):
        own = sorted(step for integrator, step in tried if integrator == name)
        longest = max(step for step in own if tried[name, step] <= 0.1)
        assert own[0] == STEPS[0] < FINER < longest
        assert all(tried[name, step] > 0.1 for step in STEPS if step in own and step > longest)
    assert tried["RK4", FINER] == pytest.approx(tried[None, FINER] / 64)


def test_an_integrator_of_higher_order_wins_where_its_steps_are_four_times_as_long() -> None:
    """Errors are m times the slope, and for RK4 (m / 8)^4 times."""
    for slope, limit in ((1e-2, 0.05), (4e-3, 0.01)):
        search = searched(Ideal(slope), limit, integrators=("Euler", "RK4"))
        best = search.rank_candidates(Bound.of(limit))[0].configuration
        euler = longest_step(limit / slope)
        rk4 = longest_step(8 * (limit / slope) ** 0.25)
        assert (best.settings.get("integrator") == "RK4") is (rk4 > 4 * euler)


def test_what_saves_time_and_misses_the_limit_is_left_out() -> None:
    limit = 0.02
    best = searched(Ideal(1e-3, few=0.05), limit).rank_candidates(Bound.of(limit))[0].configuration
    assert "iterations" not in best.settings
    assert best.settings["jacobian"] == "sparse"


def test_of_settings_that_save_the_same_work_one_is_left() -> None:
    limit, loose = 0.02, Parameter("tolerance", [{"tolerance": 1e-6}])
    search = searched(Ideal(1e-3), limit, more=(loose,))
    best = search.rank_candidates(Bound.of(limit))[0].configuration
    assert best.settings == {"jacobian": "sparse", "tolerance": 1e-6}


def test_of_values_that_save_the_same_work_the_nearest_is_taken() -> None:
    loose = Parameter("tolerance", [{"tolerance": 1e-6}, {"tolerance": 1e-5}, {"tolerance": 1e-4}])
    search = searched(Ideal(1e-3), 0.02, more=(loose,))
    best = search.rank_candidates(Bound.of(0.02))[0].configuration
    assert best.settings["tolerance"] == 1e-6


def test_at_a_cost_the_most_accurate_is_found() -> None:
    """Half the work, of which the Jacobian saves half: so the step stays what it is."""
    limit = 0.02
    search = searched(Ideal(1e-3), limit, max_cost=0.5)
    best = search.rank_candidates(Bound.of(limit))[0]
    assert best.cost <= 0.5
    assert best.configuration.multiple == FINER


def test_a_choice_says_what_it_changes() -> None:
    choice = Configuration({"geom_condim[ball]": 3, "cone": "elliptic", "island": False}, 2)
    made = choice.apply_to(MODEL)
    assert made.geom_condim[0] == 3
    assert MODEL.geom_condim[0] == 6
    assert changed_settings(choice.settings, made) == {}
    assert changed_settings({"cone": "elliptic", "iterations": 100}, MODEL) == {"cone": "elliptic"}
    assert format_settings(choice.settings) == "cone elliptic, island off, geom_condim 3 of 1 geom"
    assert math.isclose(choice.with_step(5).multiple, 5)


def test_of_a_model_that_misses_its_aim_what_is_as_accurate_is_found_and_what_keeps_the_aim() -> (
    None
):
    """One step has 1 % of error, so 4 % as written: equal at its own step, or 2 steps for 2 %."""
    aim = Bound.of(0.035)
    as_current = Bound.as_current(0.04)
    search = searched(Ideal(0.01), aim.limit, bounds=(as_current, aim))
    same, kept = (search.rank_candidates(bound)[0] for bound in (as_current, aim))
    assert (same.configuration.multiple, kept.configuration.multiple) == (FINER, 2)
    assert (
        same.configuration.settings
        == kept.configuration.settings
        == {"jacobian": "sparse", "iterations": 5}
    )
    assert same.cost < 1


def test_what_keeps_its_aim_may_stay_as_accurate_as_it_is() -> None:
    """Just within the aim as written, equal steps have equal noise, which would refuse some."""
    aim = Bound.of(0.02)
    assert aim.or_as_current(0.0199) == Bound(0.02, EQUAL_ERROR_RATIO * 0.0199)
    assert aim.or_as_current(0.001) == aim
    assert aim.or_as_current(0.2) == aim


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
    assert has_possible_contacts(mujoco.MjModel.from_xml_string(text)) is may_touch
    if not may_touch and other:
        pair = '<contact><pair geom1="ball" geom2="floor"/></contact>'
        listed = text.replace("<geom type", '<geom name="floor" type')
        listed = listed.replace("</worldbody>", f"</worldbody>{pair}")
        assert has_possible_contacts(mujoco.MjModel.from_xml_string(listed))


def test_settings_of_one_point_are_tried_at_the_steps_of_the_others() -> None:
    """Few iterations are found at the longest step; they cost less at all others, too."""
    search = searched(Ideal(1e-3), 0.01, integrators=("Euler", "RK4"), front_limit=0.2)
    known = [one for one in search.evaluations.values() if error_of(one) <= 0.2]
    front = find_undominated(known)
    longer = [one for one in front if one.configuration.multiple >= FINER]
    assert len(longer) > 3
    assert all(one.configuration.settings.get("iterations") == 5 for one in longer)


def test_an_integrator_that_moves_like_a_cheaper_one_has_no_ladder() -> None:
    names = ("Euler", "implicit", "RK4")
    search = searched(Ideal(1e-3), 0.01, integrators=names, front_limit=0.2)
    steps: dict[object, set[int]] = {name: set() for name in names}
    for one in filter(lambda one: one.error, search.evaluations.values()):
        name = one.configuration.settings.get("integrator", "Euler")
        steps[name].add(one.configuration.multiple)
    assert len(steps["implicit"]) < 0.7 * min(len(steps["Euler"]), len(steps["RK4"]))


@dataclass
class GeomCosts:
    """Costs of a model in which each geom of condim 3 saves a share of the work."""

    saving: float = 0.01

    def count_cost(self, model: mujoco.MjModel, multiple: int) -> float:
        return FINER / multiple * (1 - self.saving * float((model.geom_condim == 3).sum()))


@pytest.mark.parametrize("count", [10, 40])
def test_geoms_that_save_work_only_together_stay_together(count: int) -> None:
    """None of them saves the least saving alone, and few trials tell that they save it together."""
    geoms = "".join(f'<geom name="g{each}" size=".1" condim="4"/>' for each in range(count))
    body = f"<body><freejoint/>{geoms}</body>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    settings = {f"geom_condim[g{each}]": 3 for each in range(count)}
    parameter = Parameter("geom_condim", [settings])
    space = SearchSpace({AS_WRITTEN: model}, AS_WRITTEN, FINER, (FINER,), [parameter], ["Euler"])
    measure, bound = Ideal(1e-3), Bound.of(0.05)
    search = Search(space, measure, GeomCosts(), (bound,), None, 1e6, lambda: False)
    search.run_search()
    best = search.rank_candidates(bound)[0]
    assert best.cost <= (1 - 0.01 * count) / SAVING
    assert measure.asked < 20


def test_few_of_many_geoms_that_save_too_little_are_not_tried_alone() -> None:
    """Twelve of a hundred geoms save 1.2 %, and all of them together miss the limit."""
    geoms = "".join(f'<geom name="g{each}" size=".1" condim="4"/>' for each in range(100))
    body = f"<body><freejoint/>{geoms}</body>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")

    @dataclass
    class Rough(Ideal):
        def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
            found = super().estimate_error(model, multiple)
            return replace(found, error=float((model.geom_condim == 3).mean()))

    parameter = Parameter("geom_condim", [{f"geom_condim[g{each}]": 3 for each in range(100)}])
    space = SearchSpace({AS_WRITTEN: model}, AS_WRITTEN, FINER, (FINER,), [parameter], ["Euler"])
    measure, costs = Rough(1e-3), GeomCosts(1e-3)
    Search(space, measure, costs, (Bound.of(0.05),), None, 1e6, lambda: False).run_search()
    assert measure.asked < 5


@pytest.mark.parametrize(("work", "is_tried"), [(60.0, False), (1e6, True)])
def test_sleep_is_tried_after_the_ladders_if_work_allows(work: float, *, is_tried: bool) -> None:
    class Asleep(Costs):
        def count_cost(self, model: mujoco.MjModel, multiple: int) -> float:
            sleeps = model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_SLEEP)
            return super().count_cost(model, multiple) * (0.5 if sleeps else 1.0)

    space = SearchSpace(
        {AS_WRITTEN: MODEL}, AS_WRITTEN, FINER, STEPS, [], ["Euler"], may_sleep=True
    )
    search = Search(
        space, Ideal(1e-3), Asleep(), (Bound.of(0.05),), None, work, lambda: False,
        front_limit=0.1, front_work=work, sleep_work=1e4,
    )  # fmt: skip
    search.run_search()
    measured = [one.configuration for one in search.evaluations.values() if one.error]
    slept = [place for place, one in enumerate(measured) if one.settings.get("sleep")]
    finer = [place for place, one in enumerate(measured) if one.multiple == STEPS[0]]
    assert bool(slept) is is_tried
    assert not slept or min(finer) < min(slept)
    assert is_tried or search.work_done < 2 * work
