"""A plan that is streamed is the plan that a list of everything would be, in little memory."""

import hashlib
import json
import pickle
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.engines import engine_of
from contactlab.errors import SceneError
from contactlab.plan.grid import Plan
from contactlab.plan.overrides import Overrides
from contactlab.plan.sweep_file import read_sweep
from contactlab.run import forecast, planned_runs
from contactlab.run.planned_runs import (
    JOB_BYTES,
    LEAST_WORK,
    MAX_RUNS,
    SMALL_WORK,
    RunIndex,
    pack_jobs,
)
from contactlab.run.sampled_cost import SampledCost
from contactlab.run.sweep_request import SceneLoader, SweepRequest
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene

Draw = Callable[[st.SearchStrategy[Any]], Any]
SCENES = SceneLoader(None)
TIMESTEPS = [1e-3, 2e-3, 4e-3]
# Of these some are the model's own values, and some of them equal others.
AXES: dict[str, list[object]] = {
    "timestep": list(TIMESTEPS),
    "cone": ["pyramidal", "elliptic"],
    "friction.slide": [0.5, 1.0, 1.0 + 1e-15],
    "solver": ["Newton", "CG"],
    "warmstart": [True, False],
}
OWN: dict[str, dict[str, list[object]]] = {
    "ball_drop": {"drop_height": [0.5, 1.0, 1.0], "restitution": [0.4, 0.8]},
    "box_stack": {"boxes": [2, 3]},
    "box_slide": {"speed": [1.0, 2.0]},
}


def planned(plan: Plan, scene: Scene) -> list[RunSpec]:
    """Return all runs at once, each resolved by itself."""
    found: dict[str, RunSpec] = {}
    for run in plan.iterate_runs():
        resolved = scene.resolve(run.values, run.seed, plan.sweep.duration)
        run_id = scene.run_id(resolved)
        place = {"axes": run.values, "index": run.index, "run_id": run_id}
        found.setdefault(run_id, replace(resolved, **place))
    return list(found.values())


@st.composite
def plans(draw: Draw) -> tuple[Plan, Scene]:
    """Draw a plan: a product with excluded and included rows, seeds that may be equal, a limit."""
    name = draw(st.sampled_from(sorted(OWN)))
    offered = AXES | OWN[name]
    swept = draw(st.lists(st.sampled_from(sorted(offered)), min_size=1, max_size=4, unique=True))
    axes = {
        axis: draw(st.lists(st.sampled_from(offered[axis]), min_size=1, max_size=3))
        for axis in swept
    }
    sweep: dict[str, object] = {"version": 1, "scene": name, "duration": 0.1, "axes": axes}
    sweep["seeds"] = draw(st.integers(1, 3) | st.lists(st.integers(0, 9), min_size=1, unique=True))
    sweep["include"] = [{"timestep": draw(st.sampled_from(TIMESTEPS))}]
    if "timestep" in swept:
        sweep["exclude"] = [{"where": "timestep > 3e-3"}]
    limit = draw(st.none() | st.integers(1, 20))
    read = read_sweep(json.dumps(sweep), SCENES.vocabulary, Overrides(limit=limit))
    return read.plan, SCENES.open(name)


@pytest.mark.long
@settings(max_examples=100, deadline=None)
@given(
    drawn=plans(),
    done=st.randoms(use_true_random=False),
    workers=st.integers(0, 3),
    kept=st.sampled_from([0, 3, 1 << 12]),
)
def test_a_roster_is_the_list_of_its_runs(
    drawn: tuple[Plan, Scene], done: Any, workers: int, kept: int
) -> None:
    plan, scene = drawn
    expected = planned(plan, scene)
    with patch.object(planned_runs, "MAX_KEPT", kept):
        roster = RunIndex(plan, scene)
    assert len(roster) == len(expected)
    assert list(roster.iterate_runs()) == expected
    ids = [run.run_id for run in expected]
    seeds = len(plan.sweep.seed_values)
    firsts = "".join(run.run_id for run in expected if run.index % seeds == 0)
    assert roster.hash == hashlib.sha256(firsts.encode()).hexdigest()[:32]
    stored = {run_id for run_id in ids if done.random() < 0.5} | {"0" * 16}
    left = [run for run in expected if run.run_id not in stored]
    assert roster.count_done(stored) == len(expected) - len(left)
    assert list(roster.iterate_runs(stored)) == left
    assert sum(count for _, count in roster.iterate_rows()) == len(expected)
    _check_jobs(left, scene, workers)


def _check_jobs(left: list[RunSpec], scene: Scene, workers: int) -> None:
    """Check that every run is in one job, in order within each, and that jobs are bounded."""
    jobs = list(pack_jobs(iter(left), len(left), scene, workers))
    resolved = {run.run_id: run for run in left}
    assert Counter(run for job in jobs for run in map(_id, job)) == Counter(resolved.keys())
    for job in jobs:
        assert [run.index for run in job] == sorted(run.index for run in job)
        each = [resolved[run.run_id] for run in job]
        assert len({(*run.structure.values(), run.steps) for run in each}) == 1
        base, steps = scene.base_of(each[0]), each[0].steps
        size = engine_of(each[0]).least_bytes(base, each[0])
        assert len(job) == 1 or len(job) * size <= JOB_BYTES
        # As many as give each worker four jobs, or one if they are quick, or as take no time.
        work, workers = steps * base.model.nv**2, max(1, workers)
        quick = max(LEAST_WORK // work, min(SMALL_WORK // work, -(-len(left) // workers)))
        assert len(job) <= max(1, min(MAX_RUNS, max(quick, len(left) // (4 * workers))))


def test_a_plan_is_resolved_once(sweeper: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each row of a small sweep once, whatever its seeds and whoever asks: index, job or worker."""
    taken: list[object] = []
    resolve = Scene.resolve

    def counted(self: Scene, values: Any, *rest: Any) -> RunSpec:
        taken.extend(values.items())
        return resolve(self, values, *rest)

    monkeypatch.setattr(Scene, "resolve", counted)
    text = "version: 1\nscene: ball_drop\nduration: 0.01\nseeds: 2\ntrace: none\nchecks: none\n"
    sweeper.run(f"{text}axes: {{drop_height: [0.3, 0.4]}}")
    assert taken == [("drop_height", 0.3), ("drop_height", 0.4)]


def test_a_run_is_what_it_was_after_its_way_to_a_worker() -> None:
    scene = SCENES.open("grasp_mug")
    job = tuple(scene.plan_runs({"timestep": 1e-3}, [3, 5], None, 7))
    sent = pickle.loads(pickle.dumps(job))  # noqa: S301 - it is our own
    assert sent == job
    assert {*sent} == {*job}
    assert sent[0].settings is sent[1].settings
    assert len({*job}) == 2


def test_short_runs_share_a_job(sweeper: Any) -> None:
    """Up to 512 of them, whatever a step costs; long ones go 32 at a time."""
    for duration, most in (("1.0e-2", 512), ("2.0", 32)):
        text = f"version: 1\nscene: ball_drop\nduration: {duration}\nseeds: 4096\n"
        request = sweeper.ask(f"{text}axes: {{timestep: [1.0e-3]}}\nchecks: none", "short")
        index = RunIndex(request.plan, request.scene)
        jobs = list(pack_jobs(index.iterate_runs(), len(index), request.scene, 1))
        assert max(map(len, jobs)) == most


def _id(run: RunSpec) -> str:
    return run.run_id


@pytest.mark.long
@settings(max_examples=50, deadline=None)
@given(drawn=plans())
def test_a_forecast_adds_up_all_runs(drawn: tuple[Plan, Scene]) -> None:
    plan, scene = drawn
    expected = planned(plan, scene)
    request = SweepRequest(plan, scene, "drawn", "", (), Path("unused"), workers=1)
    with patch.object(forecast, "sample_cost", return_value=SampledCost(1e-6, {})):
        told = forecast.forecast_sweep(request)
    assert told.runs == len(expected)
    assert told.steps == sum(run.steps for run in expected)


LARGE = """
version: 1
scene: ball_drop
seeds: 20
axes:
  drop_height: {linspace: [0.1, 2, 50]}
  friction.slide: {linspace: [0.1, 1, 10]}
  timestep: {logspace: [1e-3, 5e-3, 10]}
"""


@pytest.fixture(scope="module")
def large() -> tuple[Plan, Scene]:
    read = read_sweep(LARGE, SCENES.vocabulary)
    return read.plan, SCENES.open("ball_drop")


@pytest.mark.long
def test_a_plan_takes_little_memory(large: tuple[Plan, Scene]) -> None:
    plan, scene = large
    assert plan.count == 100_000
    tracemalloc.start()
    roster = RunIndex(plan, scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # A run is a mark (1 byte), a row 8 bytes of id, in an array that grows by half, then sorted
    # (ids and places, 8 bytes each, and as much to sort them by); models and one row beside.
    assert peak < 100_000 + 5_000 * (8 * 1.5 + 4 * 8) + 2e6
    assert len(roster) == 100_000


@pytest.mark.long
def test_jobs_are_handed_out_as_they_are_asked_for(large: tuple[Plan, Scene]) -> None:
    plan, scene = large
    roster, taken = RunIndex(plan, scene), 0

    def counted() -> Iterator[RunSpec]:
        nonlocal taken
        for each in roster.iterate_runs():
            taken += 1
            yield each

    jobs = pack_jobs(counted(), len(roster), scene, 2)
    done = sum(len(next(jobs)) for _ in range(10))
    # One group waits for each of the ten step counts.
    assert taken - done < 10 * MAX_RUNS


@pytest.fixture
def checked(monkeypatch: pytest.MonkeyPatch) -> list[RunSpec]:
    """What is checked of a scene whose runs depend on time."""
    seen: list[RunSpec] = []
    check = Scene.check_start

    def watched(self: Scene, run: RunSpec) -> None:
        seen.append(run)
        check(self, run)

    monkeypatch.setattr(Scene, "check_start", watched)
    return seen


def timed(times: list[float]) -> RunIndex:
    axes = {"lift_time": times, "timestep": TIMESTEPS, "shape": [1, 2]}
    sweep = {"version": 1, "scene": "grasp_mug", "seeds": 5, "axes": axes}
    plan = read_sweep(json.dumps(sweep), SCENES.vocabulary).plan
    return RunIndex(plan, SCENES.open("grasp_mug"))


def test_what_depends_on_time_is_checked_once_a_start(checked: list[RunSpec]) -> None:
    assert len(timed([0.2, 0.3, 0.4])) == 3 * 3 * 2 * 5
    starts = [(run.structure["shape"], run.initial["lift_time"]) for run in checked]
    assert sorted(starts) == [(shape, time) for shape in (1, 2) for time in (0.2, 0.3, 0.4)]


def test_times_that_make_no_sense_are_refused() -> None:
    with pytest.raises(SceneError, match="times must not decrease"):
        timed([0.3, -1.0])
