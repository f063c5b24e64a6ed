"""The search against what trying everything finds, on laws of error and cost."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from contactlab.studies.session import Values
from contactlab.studies.tune.search import Knob, Search, Space

STEPS = tuple(1e-3 * 2.0 ** (each / 2) for each in range(-4, 8))
ORDERS = {"Euler": 1, "implicitfast": 1, "RK4": 4}
WEIGHTS = {"Euler": 1.0, "implicitfast": 1.0, "RK4": 4.0}
KNOBS = ("cone", "solver", "noslip")


class Law:
    """Errors c h^p of each integrator, and costs w / h, times a factor for each knob that is set.

    A knob changes nothing, or too much.
    """

    def __init__(self, seed: int) -> None:
        draw = np.random.default_rng(seed)
        self.constants = {each: 10 ** draw.uniform(-1, 1) for each in ORDERS}
        self.errors: dict[str, float] = {each: draw.choice([1.0, 1.0, 1e9]) for each in KNOBS}
        self.costs = {each: draw.uniform(0.5, 1.5) for each in KNOBS}
        self.calls = 0

    def excess(self, values: Values) -> float:
        name, step = str(values["integrator"]), float(str(values["timestep"]))
        error = self.constants[name] * (step / 1e-3) ** ORDERS[name]
        return error * math.prod(self.errors[each] for each in KNOBS if values[each])

    def cost(self, values: Values) -> float:
        name, step = str(values["integrator"]), float(str(values["timestep"]))
        return WEIGHTS[name] / step * math.prod(self.costs[each] for each in KNOBS if values[each])

    def judge(self, configurations: Sequence[Values]) -> list[float]:
        self.calls += 1
        return [self.excess(each) for each in configurations]

    def clock(self, configurations: Sequence[Values]) -> list[float]:
        return [self.cost(each) for each in configurations]


def searched(law: Law, written: Mapping[str, object] | None = None) -> Search:
    start = {"integrator": "Euler", "timestep": STEPS[4], **dict.fromkeys(KNOBS, False)}
    knobs = tuple(Knob(each, ({each: True}, {each: False})) for each in KNOBS)
    space = Space({**start, **(written or {})}, STEPS, tuple(ORDERS), knobs)
    search = Search(space, law.judge, law.clock)
    search.run()
    return search


def everything() -> list[dict[str, object]]:
    names = ("integrator", "timestep", *KNOBS)
    values = (ORDERS, STEPS, *[(False, True)] * len(KNOBS))
    return [dict(zip(names, each, strict=True)) for each in itertools.product(*values)]


@pytest.mark.parametrize("seed", range(40))
def test_it_finds_what_trying_everything_finds_in_a_third_of_the_runs(seed: int) -> None:
    law = Law(seed)
    feasible = [each for each in everything() if law.excess(each) <= 1]
    search = searched(law)
    # A knob that saves less than 5 % stays as it is, and so does a step.
    assert law.cost(search.here) <= min(map(law.cost, feasible)) / 0.95**4
    assert law.excess(search.here) <= 1
    assert len(search.excess) <= len(everything()) / 3


def test_a_model_that_is_not_good_enough_is_left_for_one_that_is() -> None:
    """It may take another knob than the model has, at a shorter step."""
    law = Law(0)
    law.errors["cone"] = 1e4
    search = searched(law, {"cone": True})
    assert search.here["cone"] is False
    assert law.excess(search.here) <= 1


def test_of_what_makes_a_model_good_enough_the_cheapest_is_taken() -> None:
    """Two knobs do, of which one that does more than enough takes half as long again."""
    law = Law(5)
    law.constants = {"Euler": 20.0, "implicitfast": 1e9, "RK4": 1e9}
    law.errors = {"cone": 0.01, "solver": 0.02, "noslip": 1e9}
    law.costs = {"cone": 1.5, "solver": 1.0, "noslip": 1.0}
    search = searched(law)
    assert search.here["solver"] is True
    assert search.here["cone"] is False
    assert law.excess(search.here) <= 1


def test_what_makes_all_that_follows_slow_is_changed_before_the_step() -> None:
    law = Law(6)
    law.constants["Euler"] = 0.5
    law.errors["solver"], law.costs["solver"] = 1.0, 0.2
    space = replace(searched(law).space, first=(Knob("solver", ({"solver": True},)),))
    judged: list[Values] = []

    def judge(configurations: Sequence[Values]) -> list[float]:
        judged.extend(configurations)
        return law.judge(configurations)

    Search(space, judge, law.clock).run()
    steps = [each for each in judged if each["timestep"] != space.written["timestep"]]
    assert steps
    assert steps[0]["solver"]


def test_where_nothing_is_feasible_the_model_stays_as_it_is() -> None:
    law = Law(1)
    law.constants = dict.fromkeys(ORDERS, 1e9)
    search = searched(law)
    assert search.here == search.space.written


@pytest.mark.parametrize("calls", range(1, 8))
def test_a_search_that_ends_early_has_what_was_best_so_far(calls: int) -> None:
    law = Law(2)

    def judge(configurations: Sequence[Values]) -> list[float]:
        if law.calls == calls:
            raise TimeoutError
        return law.judge(configurations)

    whole = searched(law)
    law.calls = 0
    search = Search(whole.space, judge, law.clock)
    try:
        search.run()
    except TimeoutError:
        assert law.calls == calls
    assert law.excess(search.here) <= 1
    assert law.cost(whole.here) <= law.cost(search.here) <= law.cost(whole.space.written)


def test_of_changes_that_do_the_same_one_is_made() -> None:
    """A solver that stops early saves nothing beside one that needs few iterations."""
    law = Law(3)
    law.errors.update(dict.fromkeys(KNOBS, 1.0))

    def clock(configurations: Sequence[Values]) -> list[float]:
        return [
            WEIGHTS[str(each["integrator"])]
            / float(str(each["timestep"]))
            * (0.2 if each["cone"] else 0.21 if each["solver"] else 1.0)
            for each in configurations
        ]

    search = Search(searched(law).space, law.judge, clock)
    search.run()
    assert search.here["cone"] is True
    assert search.here["solver"] is False
    assert search.here["noslip"] is False


def test_the_most_accurate_takes_no_longer_than_the_model_as_written() -> None:
    for seed in range(10):
        law = Law(seed)
        law.constants["Euler"] = 0.5
        search = searched(law)
        price = law.cost(search.space.written)
        search.sharpen()
        assert law.cost(search.here) <= price * (1 + 1e-9)
        same = [each for each in everything() if all(each[k] == search.here[k] for k in KNOBS)]
        affordable = [each for each in same if law.cost(each) <= price * (1 + 1e-9)]
        best = min(map(law.excess, affordable))
        assert law.excess(search.here) <= best * (1 + 1e-9)


def test_what_misses_by_little_is_tried_with_a_second_change() -> None:
    """Half the time takes half as much error again, which another knob takes back for a fifth."""
    law = Law(4)
    law.constants = {"Euler": 0.9, "implicitfast": 1e9, "RK4": 1e9}
    law.errors = {"cone": 1.5, "solver": 0.5, "noslip": 1e9}
    law.costs = {"cone": 0.5, "solver": 1.2, "noslip": 1.0}
    search = searched(law)
    assert search.here["cone"] is search.here["solver"] is True
    assert law.excess(search.here) <= 1
