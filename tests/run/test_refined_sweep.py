"""A refined sweep is a part of its grid's: its runs, its boundaries, its store."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactlab
from contactlab.errors import SweepFileError
from contactlab.plan.refined_axes import smallest_run_count
from contactlab.plan.refinement import UNKNOWN
from contactlab.reporting.boundaries import (
    Boundaries,
    Sides,
    boundary_lines,
    describe_coverage,
    find_boundaries,
)
from contactlab.run import planned_runs
from contactlab.run.recomputed_runs import recomputed_problems
from contactlab.schema.evidence import WholeGrid
from contactlab.schema.sweep_schema import Limit, Refine
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

TO = 17
WHOLE: dict[str, Any] = {
    "version": 1,
    "scene": "incline",
    "duration": 0.5,
    "axes": {
        "tilt": {"linspace": [5, 45, TO]},
        "friction.slide": {"linspace": [0.1, 1.0, TO]},
    },
    "trace": "none",
    "checks": "none",
    "effects": "all",
}
REFINE: dict[str, Any] = {
    "axes": ["tilt", "friction.slide"],
    "to": TO,
    "where": "slip_distance > 10 mm",
}


def part(refine: dict[str, Any] = REFINE, **changes: object) -> dict[str, Any]:
    return {**WHOLE, "refine": refine, **changes}


def rows(store: Store) -> dict[str, dict[str, Any]]:
    """Return what was found of each run, without what depends on the day and the machine."""
    names = [
        "run_id",
        "index",
        "label",
        "trajectory_hash",
        "slip_distance",
        "tilt",
        "friction.slide",
    ]
    return {row["run_id"]: row for row in store.columns.read_arrow(names).to_pylist()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return contactlab.sweep(WHOLE, output=tmp_path_factory.mktemp("whole") / "store", workers=0)


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return contactlab.sweep(part(), output=tmp_path_factory.mktemp("part") / "store", workers=0)


def test_its_store_is_sound(refined: Store) -> None:
    assert not [*find_problems(refined.address)]
    assert not [*recomputed_problems(refined)]


def test_its_runs_are_those_of_the_grid(whole: Store, refined: Store) -> None:
    grid, found = rows(whole), rows(refined)
    assert found.items() <= grid.items()
    assert len(found) < 0.5 * len(grid)
    assert refined.manifest.sweep.whole is not None
    assert refined.manifest.sweep.whole.runs == len(grid) == TO**2


def test_no_cell_is_wrong_and_the_boundary_is_that_of_friction(
    whole: Store, refined: Store
) -> None:
    """A box slides where the slope is steeper than arctan(mu).

    Its acceleration is g (sin - mu cos) there: within one cell above that it already slides
    further than the limit, since a cell is 2.5 degrees and g sin(2.5 degrees) (.5 s)^2 / 2 are
    53 mm. Below, soft friction creeps, by less.
    """
    found = find_boundaries(refined)
    assert found is not None
    (sides,) = found.sides
    slides = sides.codes == sides.names.index(REFINE["where"])
    grid = np.array([row["slip_distance"] for row in rows(whole).values()]).reshape(TO, TO)
    assert np.array_equal(slides, grid > 0.01)
    tilts, frictions = np.linspace(5, 45, TO), np.linspace(0.1, 1.0, TO)
    first = np.where(slides.any(axis=0), tilts[slides.argmax(axis=0)], 47.5)
    angles = np.degrees(np.arctan(frictions))
    assert (np.abs(first - 1.25 - angles) <= 2.5).all()
    assert int(sides.ran.sum()) == refined.manifest.runs
    assert (sides.codes != UNKNOWN).all()


def test_show_says_where_outcomes_change(refined: Store) -> None:
    found = find_boundaries(refined)
    assert found is not None
    lines = [*boundary_lines(found)]
    assert f"not {REFINE['where']} up to tilt" in lines[0]
    assert f"{refined.manifest.runs} of the grid's {TO**2} runs were made" in describe_coverage(
        found
    )


def test_three_axes_are_told_by_layers() -> None:
    """A plane x + z > 6 in a cube: layers of z, whose lines hold for every y."""
    x, _, z = np.mgrid[:5, :5, :5]
    codes = (x + z > 6).astype(np.int32)
    axes = {name: tuple(map(float, range(5))) for name in "xyz"}
    grid = WholeGrid(runs=125, axes=axes)
    sides = Sides({"seed": 0}, ("holds", "slips"), codes, np.ones_like(codes, bool))
    assert [*boundary_lines(Boundaries("label", grid, ("m", "1", "kg"), (sides,)))] == [
        "for z of 2 kg or less:",
        "  holds throughout, for any y",
        "for z of 3 kg:",
        "  holds up to x 3 to 4 m, then slips, for any y",
        "for z of 4 kg:",
        "  holds up to x 2 to 3 m, then slips, for any y",
    ]


def limited(
    codes: list[list[int]], seeds: list[int], scenarios: list[float], sought: str
) -> list[str]:
    """Return what is told of the last sound step of 1 to 5 ms; 1 of each code is sound."""
    grid = WholeGrid(runs=9, axes={"timestep": (1e-3, 2e-3, 3e-3, 4e-3, 5e-3)})
    limit = Limit.model_validate({sought: "timestep", "to": 5})
    sides = tuple(
        Sides(
            {"friction": scenario, "seed": seed},
            ("not stable", "stable"),
            np.array(each, np.int32),
            np.ones(5, bool),
        )
        for each, seed, scenario in zip(codes, seeds, scenarios, strict=True)
    )
    return [*boundary_lines(Boundaries("outcome", grid, ("s",), sides, limit))]


def test_a_limit_is_that_of_the_worst_seed_of_each_scenario() -> None:
    """Values count up to the first that any seed of a scenario is not sound at."""
    codes = [[1, 1, 1, 0, 0], [1, 1, 0, 1, 0], [1, 1, 1, 1, 1], [0, 1, 1, 1, 1]]
    assert limited(codes, [0, 1, 0, 0], [0.3, 0.3, 0.5, 0.7], "largest") == [
        "largest passing timestep: 2 ms; 3 ms fails, for friction 0.3",
        "largest passing timestep: 5 ms, the last of the sweep, for friction 0.5",
        "largest passing timestep: none, because 1 ms fails, for friction 0.7",
        "  beyond it 4 of 5 pass again",
        "in all 3: largest passing timestep: none, because 1 ms fails",
    ]
    assert limited(codes[-1:], [0], [0.7], "smallest") == [
        "smallest passing timestep: 2 ms; 1 ms fails, for friction 0.7"
    ]


LIMIT: dict[str, Any] = {"largest": "tilt", "to": TO, "where": "slip_distance > 10 mm"}


def test_the_steepest_tilt_that_sticks_is_that_of_friction(whole: Store, tmp_path: Path) -> None:
    """Each friction is a scenario; its runs are those of the grid, 7 of 17 at most without probes.

    A coarse grid of five is halved twice where outcomes differ; one probe is made at least.
    """
    frictions = np.linspace(0.1, 1.0, TO)[4:13:4].tolist()
    sweep = {
        **WHOLE,
        "axes": {"tilt": {"linspace": [5, 45, 5]}, "friction.slide": frictions},
        "limit": LIMIT,
    }
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    assert store.manifest.runs <= len(frictions) * (7 + 1)
    assert store.manifest.runs == len(rows(store).keys() & rows(whole).keys())
    found = find_boundaries(store)
    assert found is not None
    lines = [*boundary_lines(found)]
    for line, friction in zip(lines, frictions, strict=False):
        angle = np.degrees(np.arctan(friction))
        sound = max(tilt for tilt in np.linspace(5, 45, TO) if tilt < angle)
        assert line.startswith(f"largest passing tilt: {sound:.4g} deg; ")
    assert lines[3].startswith("in all 3: largest passing tilt: ")


@pytest.mark.long
def test_filled_up_it_is_the_grid(refined: Store, whole: Store, tmp_path: Path) -> None:
    """The same sweep without `refine` adds the rest; with it, a whole store lacks nothing."""
    store = tmp_path / "store"
    shutil.copytree(Path(str(refined.address)), store)
    filled = contactlab.sweep(WHOLE, output=store, workers=0)
    assert rows(filled) == rows(whole)
    assert filled.manifest.sweep.whole is None
    assert not [*find_problems(store)]
    before = (store / "manifest.json").read_bytes()
    again = contactlab.sweep(part(), output=store, workers=0)
    assert rows(again) == rows(whole)
    assert (store / "manifest.json").read_bytes() == before


def test_another_boundary_adds_its_runs(refined: Store, tmp_path: Path) -> None:
    store = tmp_path / "store"
    shutil.copytree(Path(str(refined.address)), store)
    asked = {**REFINE, "where": "slip_distance > 20 cm"}
    both = contactlab.sweep(part(asked), output=store, workers=0)
    assert rows(refined).items() < rows(both).items()
    assert not [*find_problems(store)]
    assert not [*recomputed_problems(both)]


class StopError(Exception):
    """Ends a sweep from its progress callback."""


def _until(portions: int) -> Callable[[int, int], None]:
    left = iter(range(portions))

    def progress(done: int, total: int) -> None:
        del done, total
        if next(left, None) is None:
            raise StopError

    return progress


@pytest.mark.long
@pytest.mark.parametrize("portions", [2, 9])
def test_stopped_anywhere_it_ends_as_if_it_were_not(
    portions: int, refined: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Portions of 4 runs; it stops again and again, until too few are left to stop in."""
    monkeypatch.setattr(planned_runs, "MAX_RUNS", 4)
    finished = False
    while not finished:
        with suppress(StopError), contactlab.progress(_until(portions)):
            contactlab.sweep(part(), output=tmp_path / "store", workers=0)
            finished = True
    assert rows(Store.open(tmp_path / "store")) == rows(refined)
    assert not [*find_problems(tmp_path / "store")]


@pytest.mark.long
@pytest.mark.parametrize(
    ("workers", "executor"),
    [(1, "local"), (2, "local"), pytest.param(2, "ray", marks=pytest.mark.night)],
)
def test_any_number_of_workers(workers: int, executor: str, refined: Store, tmp_path: Path) -> None:
    if executor == "ray":
        pytest.importorskip("ray", reason="contactlab[ray] is not installed")
    found = contactlab.sweep(part(), output=tmp_path / "s", workers=workers, executor=executor)
    assert rows(found) == rows(refined)


def test_every_seed_and_setting_has_a_grid_of_its_own(tmp_path: Path) -> None:
    """One axis: each is bisected, and a file's own rows run as they are."""
    sweep = {
        **WHOLE,
        "seeds": 2,
        "axes": {"tilt": {"linspace": [5, 45, 5]}, "friction.slide": [0.3, 0.7]},
        "include": [{"tilt": 1.0}],
        "refine": {**REFINE, "axes": ["tilt"], "probe": 0},
    }
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    found = find_boundaries(store)
    assert found is not None
    assert len(found.sides) == 4
    assert all(5 <= sides.ran.sum() <= 8 for sides in found.sides)
    assert store.manifest.runs == sum(int(sides.ran.sum()) for sides in found.sides) + 2
    resolved = store.manifest.sweep.resolved
    assert resolved["axes"]["tilt"]["linspace"] == [5, 45, TO]
    assert resolved["refine"]["start"] == 5


@pytest.mark.parametrize(
    ("changes", "code", "remedy"),
    [
        ({"axes": ["tilt", "nope"]}, "axis-not-swept", "tilt, friction.slide"),
        ({"axes": ["tilt", "tilt"]}, "axis-twice", "twice"),
        ({"axes": ["tilt", "friction.slide", "weight", "rock"]}, "wrong-length", "too many"),
        ({"to": 16}, "off-grid", "grows to 16"),
        ({"to": 33, "start": 4}, "off-grid", "write to: 49, or 25"),
        ({"where": "creep_speed"}, "no-limit", "creep_speed > VALUE"),
        ({"where": "creep_sped > 1mm/s"}, "unknown-metric", "creep_speed"),
        ({"where": "creep_speed >"}, "bad-expression", "METRIC > VALUE"),
        ({"where": "must"}, "not-asked", "must:"),
        ({"probe": 1.5}, "out-of-range", "probe"),
    ],
)
def test_mistakes_name_place_and_remedy(
    changes: dict[str, Any], code: str, remedy: str, tmp_path: Path
) -> None:
    with pytest.raises(SweepFileError) as caught:
        contactlab.sweep(part({**REFINE, **changes}), output=tmp_path / "s", workers=0)
    assert code in str(caught.value)
    assert remedy in str(caught.value)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"exclude": [{"tilt": 5.0}]}, "refine-exclude"),
        ({"axes": {"tilt": {"linspace": [5, 45, 5]}, "friction.slide": "all"}}, "refine-drawn"),
        (
            {"axes": {}, "zip": [{"tilt": [5, 10], "friction.slide": [0.1, 0.2]}]},
            "refine-zip",
        ),
    ],
)
def test_what_is_no_grid_is_refused(changes: dict[str, Any], code: str, tmp_path: Path) -> None:
    with pytest.raises(SweepFileError, match=code):
        contactlab.sweep(part(**changes), output=tmp_path / "s", workers=0)


@pytest.mark.parametrize(
    ("changes", "code", "remedy"),
    [
        ({"largest": "tlit"}, "axis-not-swept", "did you mean 'tilt'"),
        ({"smallest": "tilt"}, "bad-value", "either largest or smallest"),
        ({"to": 18}, "off-grid", "write to: 33, or 17"),
        ({"where": "label"}, "unknown-metric", "label"),
        ({"where": "slip_distance"}, "no-limit", "slip_distance > VALUE"),
        ({"probe": 1}, "unknown-key", "largest"),
    ],
)
def test_mistakes_of_a_limit_name_place_and_remedy(
    changes: dict[str, Any], code: str, remedy: str, tmp_path: Path
) -> None:
    axes = {"tilt": {"linspace": [5, 45, 5]}, "friction.slide": [0.3]}
    sweep = {**WHOLE, "axes": axes, "limit": {**LIMIT, **changes}}
    with pytest.raises(SweepFileError) as caught:
        contactlab.sweep(sweep, output=tmp_path / "s", workers=0)
    assert code in str(caught.value)
    assert remedy in str(caught.value)
    with pytest.raises(SweepFileError, match="two-choices"):
        contactlab.sweep(part(limit=LIMIT), output=tmp_path / "s", workers=0)


def test_options_that_cut_the_grid_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SweepFileError, match="cut the grid"):
        contactlab.sweep(part(), output=tmp_path / "s", workers=0, limit=3)


def test_the_least_is_made_where_nothing_differs(tmp_path: Path) -> None:
    """No box gets as far as that in half a second."""
    far = part({**REFINE, "where": "slip_distance > 100 m"})
    store = contactlab.sweep(far, output=tmp_path / "s", workers=0)
    refine = Refine.model_validate(store.manifest.sweep.resolved["refine"])
    assert store.manifest.runs == smallest_run_count(refine, TO**2) == 25 + 2
