"""Plans equal a slow obvious loop over everything that the file asks for."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.plan.diagnostics import SweepMistakesError
from contactlab.plan.grid import CONFIRM_ABOVE, Plan, find_expectations
from contactlab.plan.overrides import Overrides
from contactlab.plan.sweep_file import SweepFile
from contactlab.plan.sweep_file import read_sweep as read_file

Reader = Callable[..., SweepFile]

VALUES: dict[str, list[Any]] = {
    "timestep": [1e-3, 2e-3, 5e-3],
    "friction.slide": [0.0, 0.3, 1.0],
    "iterations": [1, 10, 50],
    "cone": ["pyramidal", "elliptic"],
    "integrator": ["Euler", "RK4", "implicitfast"],
    "multiccd": [True, False],
}


def row_of(names: list[str]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({}, optional={n: st.sampled_from(VALUES[n]) for n in names})


@st.composite
def sweeps(draw: st.DrawFn) -> dict[str, Any]:
    names = draw(st.permutations(sorted(VALUES)))
    cut = draw(st.integers(1, len(names)))
    axes = {
        n: draw(st.lists(st.sampled_from(VALUES[n]), min_size=1, max_size=3)) for n in names[:cut]
    }
    rest = names[cut:]
    pairs = [rest[start : start + 2] for start in range(0, len(rest), 2)]
    blocks = [{name: VALUES[name][:2] for name in pair} for pair in pairs]
    swept = [*axes, *(name for block in blocks for name in block)]
    return {
        "axes": axes,
        "zip": blocks,
        "seeds": draw(st.one_of(st.integers(1, 3), st.just([7, 0]))),
        "exclude": draw(st.lists(row_of(swept).filter(bool), max_size=3)),
        "include": draw(st.lists(row_of(sorted(VALUES)), max_size=3)),
    }


def slow_rows(sweep: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the rows by nested loops, one axis after the other."""
    rows: list[dict[str, Any]] = [{}]
    for name, values in sweep["axes"].items():
        rows = [{**row, name: value} for row in rows for value in values]
    for block in sweep["zip"]:
        length = len(next(iter(block.values())))
        steps = [{name: block[name][k] for name in block} for k in range(length)]
        rows = [{**row, **step} for row in rows for step in steps]
    for excluded in sweep["exclude"]:
        rows = [row for row in rows if not all(row[n] == v for n, v in excluded.items())]
    return rows + sweep["include"]


def slow_runs(sweep: dict[str, Any]) -> list[tuple[dict[str, Any], int]]:
    seeds = sweep["seeds"]
    seeds = list(range(seeds)) if isinstance(seeds, int) else seeds
    return [(row, seed) for row in slow_rows(sweep) for seed in seeds]


def listed(plan: Plan) -> list[tuple[dict[str, Any], int]]:
    return [(dict(run.values), run.seed) for run in plan.iterate_runs()]


@pytest.mark.long
@given(sweep=sweeps(), data=st.data())
def test_runs_equal_a_slow_loop(read: Reader, sweep: dict[str, Any], data: st.DataObject) -> None:
    expected = slow_runs(sweep)
    limit = data.draw(st.none() | st.integers(1, len(expected) + 3))
    body = "".join(f"{key}: {json.dumps(part)}\n" for key, part in sweep.items())
    if not expected:
        with pytest.raises(SweepMistakesError, match="no runs are left"):
            read(body, limit=limit)
        return
    plan = read(body, limit=limit).plan
    assert listed(plan) == expected[:limit]
    assert plan.count == len(expected[:limit])
    assert [run.index for run in plan.iterate_runs()] == list(range(plan.count))


@pytest.mark.long
@given(sweep=sweeps(), data=st.data())
def test_only_equals_a_filter(read: Reader, sweep: dict[str, Any], data: st.DataObject) -> None:
    rows = slow_runs(sweep)
    taken = {(n, v) for row, _ in rows for n, v in row.items() if not isinstance(v, bool)}
    if not taken:
        return
    name = data.draw(st.sampled_from(sorted({name for name, _ in taken})))
    values = data.draw(
        st.sets(st.sampled_from(sorted(v for n, v in taken if n == name)), min_size=1)
    )
    body = "".join(f"{key}: {json.dumps(part)}\n" for key, part in sweep.items())
    option = f"{name}={','.join(str(value) for value in values)}"
    expected = [(row, seed) for row, seed in rows if row.get(name) in values]
    assert listed(read(body, where=[option]).plan) == expected


def test_an_expression_excludes_what_it_holds_for(read: Reader) -> None:
    body = (
        "axes: {timestep: {linspace: [1e-3, 1e-2, 10]}, friction.slide: [0, 0.01, 0.02]}\n"
        "exclude:\n"
        '  - {where: "friction.slide < 2*timestep", timestep: 5e-3}\n'
        '  - {where: "timestep > 8e-3"}'
    )
    pairs = itertools.product([k / 1000 for k in range(1, 11)], [0.0, 0.01, 0.02])
    kept = [(h, f) for h, f in pairs if not (h == 5e-3 and f < 2 * h) and not h > 8e-3]
    runs = read(body).plan.iterate_runs()
    assert [(run.values["timestep"], run.values["friction.slide"]) for run in runs] == kept


def test_order_is_as_written_with_samples_last(read: Reader) -> None:
    plan = read(
        "axes: {drop_height: {uniform: [1, 2]}, cone: [pyramidal, elliptic]}\n"
        "zip: [{timestep: [1e-3, 2e-3], iterations: [5, 6]}]\n"
        "sample: {n: 3}\nseeds: [9, 4]\ninclude: [{iterations: 7}]"
    ).plan
    assert [axis.name for axis in plan.axes] == ["cone", "timestep", "iterations", "drop_height"]
    runs = [
        (run.values.get("cone"), run.values["iterations"], run.seed) for run in plan.iterate_runs()
    ]
    one_block = [("pyramidal", 5, 9), ("pyramidal", 5, 4)]
    assert runs[:6] == one_block * 3
    assert runs[6][:2] == ("pyramidal", 6)
    assert runs[12][:2] == ("elliptic", 5)
    assert runs[-2:] == [(None, 7, 9), (None, 7, 4)]
    heights = [
        run.values["drop_height"] for run in plan.iterate_runs() if "drop_height" in run.values
    ]
    assert heights[:6:2] == heights[6:12:2]
    assert len(set(heights)) == 3


def test_included_rows_alone_make_no_product(read: Reader) -> None:
    assert listed(read("include: [{timestep: 1e-3}]").plan) == [({"timestep": 1e-3}, 0)]
    assert listed(read().plan) == [({}, 0)]


def test_effects_hold_in_every_run_unless_a_row_says_otherwise(read: Reader) -> None:
    body = (
        "effects: {multiccd: true}\naxes: {iterations: [1]}\n"
        "include: [{multiccd: false}, {iterations: 2}]"
    )
    values = [dict(run.values) for run in read(body).plan.iterate_runs()]
    assert values == [
        {"multiccd": True, "iterations": 1},
        {"multiccd": False},
        {"multiccd": True, "iterations": 2},
    ]
    kept = [dict(run.values) for run in read(body, where=["multiccd=false"]).plan.iterate_runs()]
    assert kept == [{"multiccd": False}]


def test_only_on_an_included_axis_leaves_no_product(read: Reader) -> None:
    body = "axes: {cone: [elliptic]}\ninclude: [{timestep: 1e-3}, {timestep: 2e-3}]"
    assert listed(read(body, where=["timestep=2e-3"]).plan) == [({"timestep": 2e-3}, 0)]


def test_axes_have_roles_and_different_values(read: Reader) -> None:
    plan = read(
        "axes: {drop_height: {values: [1, 2, 1.0], role: scenario}, cone: [elliptic]}\n"
        "include: [{timestep: 1e-3}]"
    ).plan
    assert [(axis.name, axis.role, axis.count) for axis in plan.axes] == [
        ("drop_height", "scenario", 2),
        ("cone", "knob", 1),
        ("timestep", "knob", 1),
    ]


def test_expectations_are_those_whose_condition_holds(read: Reader) -> None:
    plan = read(
        'axes: {solref: ["0.02 1", [0.01, 1]], timestep: [1e-3, 2e-3]}\n'
        "expect:\n"
        "  - {where: {solref: 0.02 1}, label: stable}\n"
        '  - {where: {where: "timestep > 1e-3"}, label: [tunneling, stable]}\n'
        "  - {metrics: {penetration_max: {max: 1e-3}}}\n"
    ).plan
    met = [
        [plan.sweep.expect.index(e) for e in find_expectations(plan.expected, run.values)]
        for run in plan.iterate_runs()
    ]
    assert met == [[0, 2], [0, 1, 2], [2], [1, 2]]


def test_what_meets_nothing_is_a_warning(read: Reader) -> None:
    body = (
        "axes: {cone: [elliptic], timestep: [1e-3]}\n"
        "exclude:\n  - {cone: pyramidal}\n"
        "expect:\n  - {where: {timestep: 2e-3}, label: stable}\n"
    )
    warnings = read(body).plan.warnings
    assert [(each.code, each.severity, each.place.line) for each in warnings] == [
        ("unmatched-expect", "warning", 7),
        ("unmatched-exclude", "warning", 5),
    ]


def test_a_written_out_sweep_reads_as_itself(read: Reader) -> None:
    first = read(
        "axes: {timestep: {logspace: [1e-4, 1e-2, 5]}, drop_height: {uniform: [0, 1]}}\n"
        "sample: {n: 4}\nzip: [{cone: [elliptic, pyramidal], iterations: [1, 2]}]\n"
        'exclude: [{where: "timestep > 5e-3", cone: elliptic}]\ntolerances: {energy_gain: 2%}\n'
        "expect: [{where: {cone: elliptic}, label: stable}]"
    )
    data = first.sweep.model_dump(mode="json", exclude_none=True, exclude={"version", "scene"})
    again = read("".join(f"{key}: {json.dumps(part)}\n" for key, part in data.items()))
    assert again.sweep == first.sweep
    assert listed(again.plan) == listed(first.plan)


def test_a_table_of_rows_equals_rows_in_the_file(
    read: Reader, vocabulary: Any, tmp_path: Path
) -> None:
    (tmp_path / "runs.csv").write_text(
        "\ufefftimestep, cone ,solref,multiccd\r\n"
        '1e-3,elliptic,"0.02 1",true\r\n\r\n'
        ".5e-2,,,False\r\n",
        encoding="utf-8",
    )
    path = tmp_path / "sweep.yaml"
    path.write_text("version: 1\nscene: ball\ninclude: {file: runs.csv}\n", encoding="utf-8")
    from_table = read_file(path, vocabulary)
    inline = read(
        "include: [{timestep: 1e-3, cone: elliptic, solref: 0.02 1, multiccd: true},"
        " {timestep: .5e-2, multiccd: false}]"
    )
    assert listed(from_table.plan) == listed(inline.plan)
    assert from_table.path == path


def test_limits(read: Reader) -> None:
    many = (
        "axes: {timestep: {linspace: [1e-4, 1e-2, 5000]}, friction.slide: {linspace: [0, 1, 5000]}}"
    )
    with pytest.raises(SweepMistakesError, match="25,000,000 runs; a sweep takes at most 10,000,"):
        read(many)
    assert read(many, limit=CONFIRM_ABOVE).plan.count == 100_000
    with pytest.raises(SweepMistakesError, match="25,000,000 rows before `exclude`"):
        read(f"{many}\nexclude: [{{timestep: 1e-4}}]", limit=10)
    with pytest.raises(SweepMistakesError, match="at least 1 run"):
        read(limit=0)


@pytest.mark.night
def test_a_million_runs_stream(vocabulary: Any) -> None:
    text = (
        "version: 1\nscene: ball\naxes:\n  timestep: {linspace: [1e-4, 1e-2, 500]}\n"
        "  friction.slide: {linspace: [0, 1, 2000]}\n"
    )
    plan = read_file(text, vocabulary, Overrides()).plan
    assert sum(1 for _ in plan.iterate_runs()) == plan.count == 1_000_000


def test_merged_entries_are_those_that_are_written_out(read: Reader) -> None:
    """Own entries go before merged ones, and of these the first."""
    merged = """
axes:
  <<: [{timestep: [1.0e-3], cone: [elliptic]}, &more {cone: [pyramidal], iterations: [1, 2]}]
  timestep: [2.0e-3]
include:
- &row {timestep: 1.0e-4, iterations: 5}
- {cone: elliptic, <<: *row}
"""
    plain = """
axes: {timestep: [2.0e-3], cone: [elliptic], iterations: [1, 2]}
include: [{timestep: 1.0e-4, iterations: 5}, {timestep: 1.0e-4, iterations: 5, cone: elliptic}]
"""
    one, two = (
        [dict(row.values) for row in read(text).plan.iterate_rows()] for text in (merged, plain)
    )
    assert one == two
    assert len(one) == 4


def test_an_anchor_may_be_set_again_without_a_word(read: Reader) -> None:
    """YAML allows it; warnings are errors in these tests."""
    text = "duration: &a 0.1\ntimeout: &a 2\naxes: {timestep: [0.1]}\n"
    assert read(text).sweep.timeout == 2
