"""A plan that is streamed is the plan that a list of everything would be, in little memory."""

import hashlib
import json
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.engines.engine import bytes_of_run
from contactlab.errors import SceneError
from contactlab.plan.grid import Plan
from contactlab.plan.overrides import Overrides
from contactlab.plan.sweep_file import read_sweep
from contactlab.run.forecast import forecast
from contactlab.run.planned_runs import (
    JOB_BYTES,
    LEAST_WORK,
    MAX_RUNS,
    SMALL_WORK,
    RunIndex,
    pack_jobs,
)
from contactlab.run.sweep_request import SceneLoader
from contactlab.run.tasks import PlannedRun
from contactlab.scene.resolution import ResolvedRun
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


def planned(plan: Plan, scene: Scene) -> list[tuple[PlannedRun, ResolvedRun]]:
    """Return all runs at once, each resolved by itself."""
    found: dict[str, tuple[PlannedRun, ResolvedRun]] = {}
    for run in plan.runs():
        resolved = scene.resolve(run.values, run.seed, plan.sweep.duration)
        run_id = scene.run_id(resolved)
        found.setdefault(run_id, (PlannedRun(run.index, run_id, run.values, run.seed), resolved))
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


@settings(max_examples=100, deadline=None)
@given(drawn=plans(), done=st.randoms(use_true_random=False), workers=st.integers(0, 3))
def test_a_roster_is_the_list_of_its_runs(
    drawn: tuple[Plan, Scene], done: Any, workers: int
) -> None:
    plan, scene = drawn
    expected = planned(plan, scene)
    roster = RunIndex(plan, scene)
    assert len(roster) == len(expected)
    assert list(roster.runs()) == expected
    ids = [run.run_id for run, _ in expected]
    assert roster.hash == hashlib.sha256("".join(ids).encode()).hexdigest()[:32]
    stored = {run_id for run_id in ids if done.random() < 0.5} | {"0" * 16}
    left = [each for each in expected if each[0].run_id not in stored]
    assert roster.count(stored) == len(expected) - len(left)
    assert list(roster.runs(stored)) == left
    assert sum(count for _, count in roster.rows()) == len(expected)
    _check_jobs(left, scene, workers)


def _check_jobs(left: list[tuple[PlannedRun, ResolvedRun]], scene: Scene, workers: int) -> None:
    """Check that every run is in one job, in order within each, and that jobs are bounded."""
    jobs = list(pack_jobs(iter(left), len(left), scene, workers))
    resolved = {run.run_id: each for run, each in left}
    assert Counter(run for job in jobs for run in map(_id, job)) == Counter(resolved.keys())
    for job in jobs:
        assert [run.index for run in job] == sorted(run.index for run in job)
        each = [resolved[run.run_id] for run in job]
        assert len({(*run.structure.values(), run.steps) for run in each}) == 1
        model, steps = scene.base_of(each[0]).model, each[0].steps
        assert len(job) == 1 or len(job) * bytes_of_run(model, steps) <= JOB_BYTES
        # As many as give each worker four jobs, or one if they are quick, or as take no time.
        work, workers = steps * model.nv**2, max(1, workers)
        quick = max(LEAST_WORK // work, min(SMALL_WORK // work, -(-len(left) // workers)))
        assert len(job) <= max(1, min(MAX_RUNS, max(quick, len(left) // (4 * workers))))


def test_short_runs_share_a_job(sweeper: Any) -> None:
    """Up to 512 of them, whatever a step costs; long ones go 32 at a time."""
    for duration, most in (("1.0e-2", 512), ("2.0", 32)):
        text = f"version: 1\nscene: ball_drop\nduration: {duration}\nseeds: 4096\n"
        request = sweeper.ask(f"{text}axes: {{timestep: [1.0e-3]}}\nchecks: none", "short")
        index = RunIndex(request.plan, request.scene)
        jobs = list(pack_jobs(index.runs(), len(index), request.scene, 1))
        assert max(map(len, jobs)) == most


def _id(run: PlannedRun) -> str:
    return run.run_id


@settings(max_examples=50, deadline=None)
@given(drawn=plans())
def test_a_forecast_adds_up_all_runs(drawn: tuple[Plan, Scene]) -> None:
    plan, scene = drawn
    expected = [resolved for _, resolved in planned(plan, scene)]
    told = forecast(plan, scene, 1)
    assert told.runs == len(expected)
    assert told.steps == sum(run.steps for run in expected)
    size = sum(bytes_of_run(scene.base_of(run).model, run.steps) for run in expected)
    assert told.bytes[1] / told.bytes[0] == pytest.approx(6.0)
    assert told.bytes[1] == pytest.approx(0.6 * size)


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


def test_a_plan_takes_little_memory(large: tuple[Plan, Scene]) -> None:
    plan, scene = large
    assert plan.count == 100_000
    tracemalloc.start()
    roster = RunIndex(plan, scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # A run is 8 bytes of id, held twice while bytes are made of what grew by an eighth at most,
    # then sorted (ids and places, 8 bytes each, and as much to sort them by) and marked (1 byte);
    # what rows share, 70 values here, is far below a MB. A list of runs took 3.6 kB each.
    assert peak < 100_000 * (8 * 1.125 + 8 + 4 * 8 + 1) + 1e6
    assert len(roster) == 100_000


def test_jobs_are_handed_out_as_they_are_asked_for(large: tuple[Plan, Scene]) -> None:
    plan, scene = large
    roster, taken = RunIndex(plan, scene), 0

    def counted() -> Iterator[tuple[PlannedRun, ResolvedRun]]:
        nonlocal taken
        for each in roster.runs():
            taken += 1
            yield each

    jobs = pack_jobs(counted(), len(roster), scene, 2)
    done = sum(len(next(jobs)) for _ in range(10))
    # One group waits for each of the ten step counts.
    assert taken - done < 10 * MAX_RUNS


@pytest.fixture
def checked(monkeypatch: pytest.MonkeyPatch) -> list[ResolvedRun]:
    """What is checked of a scene whose runs depend on time."""
    seen: list[ResolvedRun] = []
    check = Scene.check_start

    def watched(self: Scene, run: ResolvedRun) -> None:
        seen.append(run)
        check(self, run)

    monkeypatch.setattr(Scene, "check_start", watched)
    return seen


def timed(times: list[float]) -> RunIndex:
    axes = {"lift_time": times, "timestep": TIMESTEPS, "shape": [1, 2]}
    sweep = {"version": 1, "scene": "grasp_mug", "seeds": 5, "axes": axes}
    plan = read_sweep(json.dumps(sweep), SCENES.vocabulary).plan
    return RunIndex(plan, SCENES.open("grasp_mug"))


def test_what_depends_on_time_is_checked_once_a_start(checked: list[ResolvedRun]) -> None:
    assert len(timed([0.2, 0.3, 0.4])) == 3 * 3 * 2 * 5
    starts = [(run.structure["shape"], run.initial["lift_time"]) for run in checked]
    assert sorted(starts) == [(shape, time) for shape in (1, 2) for time in (0.2, 0.3, 0.4)]


def test_times_that_make_no_sense_are_refused() -> None:
    with pytest.raises(SceneError, match="times must not decrease"):
        timed([0.3, -1.0])
