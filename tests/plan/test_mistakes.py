"""Planted mistakes: each is found, all in one pass, at its own characters."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.errors import SweepFileError
from contactlab.plan.diagnostics import MOST_SHOWN_MISTAKES, SweepMistakesError
from contactlab.plan.grid import Plan
from contactlab.plan.overrides import Overrides
from contactlab.plan.sweep_file import read_sweep
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.vocabulary import Vocabulary

Mistakes = Callable[..., list[tuple[str, str]]]

MANY = """\
version: 1
scene: ball
durations: 3
seeds: [0, 1.5]
axes:
  timestep: {logspce: [5e-4, 2e-2, 8]}
  solref.timeconstant: [0.002, 0.004]
  cone: [pyramidal, eliptic]
  friction.slide: {linspace: [0, 1]}
  iterations: []
zip:
  - {drop_height: [1, 2], integrator: [Euler]}
exclude:
  - {solref: 0.02 1}
  - {where: "timestep < 2 * friction.slid"}
tolerances: {penetration: 1e-3}
expect:
  - {where: {timestep: 1e-3}, label: [stable, tuneling]}
seeds: 4
"""


def found(text: str, vocabulary: Any, path: Path | None = None) -> SweepMistakesError:
    with pytest.raises(SweepMistakesError) as caught:
        read_sweep(path or text, vocabulary)
    return caught.value


def test_all_mistakes_are_found_in_one_pass(vocabulary: Any) -> None:
    marks = [
        (each.code, each.place.line, each.place.column, each.place.width)
        for each in found(MANY, vocabulary).diagnostics
    ]
    assert marks == [
        ("unknown-key", 3, 1, 9),
        ("wrong-type", 4, 12, 3),
        ("unknown-key", 6, 14, 7),
        ("unknown-axis", 7, 3, 19),
        ("bad-value", 8, 21, 7),
        ("wrong-length", 9, 30, 6),
        ("empty-axis", 10, 15, 2),
        ("zip-length", 12, 39, 7),
        ("axis-not-swept", 14, 6, 6),
        ("axis-not-swept", 15, 29, 13),
        ("unknown-metric", 16, 14, 11),
        ("unknown-label", 18, 47, 8),
        ("duplicate-key", 19, 1, 5),
    ]


def test_a_broken_entry_does_not_shift_the_others(mistakes: Mistakes) -> None:
    body = (
        "axes: {cone: [elliptic]}\n"
        "exclude: [{cone: ~}, {cone: elliptic}, {cnoe: 1}]\n"
        "include: [{cone: []}, 3, {cone: elliptc}]\n"
    )
    assert mistakes(body) == [
        ("value", "~"),
        ("axis-not-swept", "cnoe"),
        ("bad-value", "[]"),
        ("wrong-type", "3"),
        ("bad-value", "elliptc"),
    ]


def test_a_rendered_mistake(vocabulary: Any, tmp_path: Path) -> None:
    path = tmp_path / "grid.yaml"
    path.write_text("version: 1\nscene: ball\naxes:\n  timestp: [1e-3]\n", encoding="utf-8")
    assert str(found("", vocabulary, path)) == (
        "error[unknown-axis]: unknown axis 'timestp'\n"
        f"  --> {path}:4:3\n"
        "  |\n"
        "4 |   timestp: [1e-3]\n"
        "  |   ^^^^^^^ did you mean 'timestep'?"
    )


def test_a_rendered_mistake_of_the_command_line(read: Any) -> None:
    with pytest.raises(SweepMistakesError) as caught:
        read("axes: {cone: [elliptic]}", assign=["timestep=logspace(1e-3,-1,8)"])
    assert str(caught.value) == (
        "error[out-of-range]: 'logspace' must be greater than 0\n"
        " --> command line, column 30\n"
        " |\n"
        " | --set timestep=logspace(1e-3,-1,8)\n"
        " |                              ^^ write a number above 0"
    )


PLANTED = [
    ("wrong-type", "axes: [1]", "[1]"),
    ("wrong-type", "axes:", "axes"),
    ("wrong-type", "duration: '3'", "'3'"),
    ("wrong-type", "seeds: true", "true"),
    ("wrong-type", "axes: {timestep: 1e-3}", "1e-3"),
    ("wrong-type", "exclude: [cone]", "cone"),
    ("value", "axes: {timestep: [~]}", "~"),
    ("number", "axes: {solref: [[0.02, x]]}", "[0.02, x]"),
    ("not-finite", "axes: {timestep: [1e-3, .nan]}", ".nan"),
    ("not-finite", "axes: {timestep: {linspace: [0, 1e999, 3]}}", "1e999"),
    ("not-finite", "duration: .inf", ".inf"),
    ("out-of-range", "duration: 0", "0"),
    ("out-of-range", "axes: {timestep: {logspace: [0, 1, 3]}}", "0"),
    ("out-of-range", "axes: {timestep: {linspace: [1, 2, 1]}}", "1"),
    ("out-of-range", "axes: {timestep: {linspace: [1, 2, 999999999]}}", "999999999"),
    ("out-of-range", "seeds: 0", "0"),
    ("out-of-range", "seeds: [-1]", "-1"),
    ("out-of-range", "timeout: -1", "-1"),
    ("wrong-length", "axes: {timestep: {logspace: [1, 2]}}", "[1, 2]"),
    ("wrong-length", "axes: {timestep: {logspace: [1, 2, 3, 4]}}", "[1, 2, 3, 4]"),
    ("wrong-length", "zip: [{}]", "{}"),
    ("range-step", "axes: {timestep: {range: [1, 2, -1]}}", "[1, 2, -1]"),
    ("range-step", "axes: {timestep: {range: [0, 1, 1e-9]}}", "[0, 1, 1e-9]"),
    ("span-order", "axes: {timestep: {uniform: [2, 1]}}\nsample: {n: 1}", "[2, 1]"),
    ("empty-axis", "axes: {timestep: {role: knob}}", "{role: knob}"),
    ("empty-axis", "axes: {timestep: {values: []}}", "[]"),
    ("unknown-key", "axes: {timestep: {values: [1], rol: knob}}", "rol"),
    ("unknown-key", "axes: {timestep: {values: [1], linspace: [1, 2, 3]}}", "linspace"),
    ("unknown-key", "sample: {n: 3, nn: 4}\naxes: {timestep: {uniform: [1, 2]}}", "nn"),
    ("unknown-key", "expect: [{label: stable, lable: x}]", "lable"),
    ("missing-key", "sample: {method: lhs}\naxes: {timestep: {uniform: [1, 2]}}", "s"),
    ("bad-value", "axes: {timestep: {values: [1], role: nob}}", "nob"),
    ("bad-value", "axes: {timestep: [-1]}", "-1"),
    ("bad-value", "axes: {timestep: {linspace: [-1, 1, 3]}}", "[-1, 1, 3]"),
    ("bad-value", "axes: {iterations: {linspace: [1, 2, 3]}}", "[1, 2, 3]"),
    ("bad-value", "axes: {timestep: {uniform: [-1, 1]}}\nsample: {n: 3}", "-1"),
    ("bad-value", "axes: {solref: [0.02]}", "0.02"),
    ("bad-value", "axes: {cone: [elliptic]}\nexclude: [{cone: eliptic}]", "eliptic"),
    ("bad-value", "trace: sample:0", "sample:0"),
    ("unknown-axis", "zip: [{timestp: [1]}]", "timestp"),
    ("unknown-axis", "axes: {seed: [1]}", "seed"),
    ("unknown-axis", "include: [{timestp: 1}]", "timestp"),
    ("unknown-effect", "effects: {multicd: true}", "multicd"),
    ("unknown-metric", "expect: [{metrics: {penetration: {max: 1}}}]", "penetration"),
    ("bounds-empty", "expect: [{metrics: {penetration_max: {}}}]", "{}"),
    ("bounds-order", "expect: [{metrics: {energy_gain: {min: 2, max: 1}}}]", "{min: 2, max: 1}"),
    ("expect-empty", "expect: [{reason: why}]", "{reason: why}"),
    ("axis-twice", "axes: {timestep: [1]}\nzip: [{timestep: [1]}]", "timestep"),
    ("axis-twice", "axes: {multiccd: [true]}\neffects: {multiccd: true}", "multiccd"),
    ("axis-conflict", "axes: {solref: [0.02 1], solref.timeconst: [1]}", "solref.timeconst"),
    ("axis-conflict", "include: [{solref.timeconst: 1, solref: 0.02 1}]", "solref"),
    ("zip-length", "zip: [{timestep: [1, 2], iterations: {linspace: [1, 3, 3]}}]",
     "{linspace: [1, 3, 3]}"),
    ("sample-missing", "axes: {timestep: {uniform: [1, 2]}}", "timestep"),
    ("sample-unused", "axes: {timestep: [1]}\nsample: {n: 3}", "sample"),
    ("sampled-in-zip", "zip: [{timestep: {uniform: [1, 2]}}]", "timestep"),
    ("axis-not-swept", "exclude: [{cone: elliptic}]", "cone"),
    ("axis-not-swept", "include: [{cone: elliptic}]\nexclude: [{cone: elliptic}]", "cone"),
    ("axis-not-swept", "expect: [{where: {cone: elliptic}, label: stable}]", "cone"),
    ("axis-not-swept", "axes: {cone: [elliptic]}\nexclude: [{where: cone == elliptic}]",
     "elliptic"),
    ("bad-expression", "axes: {timestep: [1]}\nexclude: [{where: timestep % 2}]", "timestep % 2"),
    ("bad-expression", "axes: {timestep: [1]}\nexclude: [{where: 'sqrt(0 - timestep)'}]",
     "sqrt(0 - timestep)"),
    ("bad-expression", "axes: {solref: [0.02 1]}\nexclude: [{where: 1 < solref}]", "solref"),
    ("no-runs", "axes: {cone: [elliptic]}\nexclude: [{cone: elliptic}]", "exclude"),
    ("syntax", "axes: {timestep: !oops 3}", "!oops 3"),
    ("syntax", "axes: {? [1] : 3}", "[1]"),
]  # fmt: skip


@pytest.mark.parametrize(("code", "body", "marked"), PLANTED)
def test_a_planted_mistake_is_found_alone(
    mistakes: Mistakes, code: str, body: str, marked: str
) -> None:
    assert mistakes(body) == [(code, marked)]


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [
        ("version: 1\nscene: [ball", 2, 13),
        ("version: 1\nscene: ball: x", 2, 12),
        ("version: 1\naxes:\n\ttimestep: [1]", 3, 1),
        ("version: 1\n---\nversion: 1", 2, 1),
        ("version: 1\nscene: *ball", 2, 8),
        ("version: 1\nscene: b\x00", 2, 9),
        ("version: 1\nscene: ball\naxes: {timestep: !evil [1]}", 3, 18),
        ("version: 1\nscene: ball\naxes: !evil {timestep: [1]}", 3, 7),
        ("a: &a [*a]", 1, 1),
        ("{" * 1000, 1, 1),
        ("version: 1\nscene: ball\nduration: " + "9" * 5000, 3, 11),
        ("", 1, 1),
        ("- version: 1", 1, 1),
    ],
)
def test_what_is_no_sweep_file_is_refused_in_place(
    vocabulary: Any, text: str, line: int, column: int
) -> None:
    first = found(text, vocabulary).diagnostics[0]
    assert first.code in {"syntax", "wrong-type", "missing-key", "unknown-key"}
    assert (first.place.line, first.place.column) == (line, column)


def test_an_unknown_scene_is_marked(vocabulary: Any) -> None:
    error = found("version: 1\nscene: bal\nduration: 0\n", vocabulary)
    assert [(each.code, each.place.line) for each in error.diagnostics] == [
        ("unknown-scene", 2),
        ("out-of-range", 3),
    ]
    assert error.diagnostics[0].message == "no shipped scene named 'bal'; did you mean 'ball'?"


def test_another_version_is_refused(vocabulary: Any) -> None:
    assert "'version' must be 1" in str(found("version: 2\nscene: ball\n", vocabulary))


def test_a_missing_file_is_named(vocabulary: Any, tmp_path: Path) -> None:
    with pytest.raises(SweepFileError, match=r"no file .*none\.yaml; the folder .* no .yaml file"):
        read_sweep(tmp_path / "none.yaml", vocabulary)
    (tmp_path / "latin.yaml").write_bytes(b"scene: \xe9")
    with pytest.raises(SweepFileError, match="not UTF-8"):
        read_sweep(tmp_path / "latin.yaml", vocabulary)


def test_wide_characters_and_long_lines_keep_the_caret_in_place(vocabulary: Any) -> None:
    wide = found("version: 1\nscene: ball\naxes: {箱: [1], cone: [x]}\n", vocabulary)
    lines = str(wide.diagnostics[0]).splitlines()
    # Each of the two-column characters before the caret counts for two.
    assert lines[4].index("^") == lines[3].index("箱")
    assert "^^ known" in lines[4]
    values = ", ".join(["pyramidal"] * 200 + ["x"])
    long = found(f"version: 1\nscene: ball\naxes: {{cone: [{values}]}}\n", vocabulary)
    lines = str(long.diagnostics[0]).splitlines()
    assert lines[3][lines[4].index("^")] == "x"
    assert len(lines[3]) < 120


@pytest.mark.parametrize(
    ("table", "code", "where"),
    [
        ("timestep,con\n1,2\n", "unknown-axis", (1, 10, 3)),
        ("timestep,cone\n1e-3,elliptic\n1e-3,  eliptic\n", "bad-value", (3, 8, 7)),
        ('solref,timestep\n"0.02 1",-1\n', "bad-value", (2, 10, 2)),
        ("timestep,cone\n1e-3\n", "bad-table", (2, 1, 4)),
        ("timestep,timestep\n1,1\n", "bad-table", (1, 10, 8)),
        ("timestep,\n1,1\n", "bad-table", (1, 10, 1)),
        ("timestep\n", "bad-table", (3, 17, 8)),
        ("solref,solref.timeconst\n0.02 1,1\n", "axis-conflict", (1, 8, 16)),
        ("timestep\n1e999\n", "not-finite", (2, 1, 5)),
    ],
)
def test_mistakes_in_a_table_are_marked_there(
    vocabulary: Any, tmp_path: Path, table: str, code: str, where: tuple[int, ...]
) -> None:
    (tmp_path / "runs.csv").write_text(table, encoding="utf-8")
    path = tmp_path / "sweep.yaml"
    path.write_text("version: 1\nscene: ball\ninclude: {file: runs.csv}\n", encoding="utf-8")
    (only,) = found("", vocabulary, path).diagnostics
    place = only.place
    assert (only.code, (place.line, place.column, place.width)) == (code, where)
    assert place.source.name.endswith(
        "sweep.yaml" if where[2] == 8 and where[0] == 3 else "runs.csv"
    )


@pytest.mark.parametrize("name", ["/etc/passwd", "../other.csv", "sub/link.csv", "pipe"])
def test_a_table_lies_below_the_sweep(vocabulary: Any, tmp_path: Path, name: str) -> None:
    """A stranger's sweep prints no other file's first line, and waits for no pipe."""
    folder = tmp_path / "sweeps"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "other.csv").write_text("secret\n1\n")
    (folder / "sub" / "link.csv").symlink_to(tmp_path / "other.csv")
    os.mkfifo(folder / "pipe")
    path = folder / "sweep.yaml"
    path.write_text(f"version: 1\nscene: ball\ninclude: {{file: {name}}}\n", encoding="utf-8")
    (only,) = found("", vocabulary, path).diagnostics
    assert only.code == "bad-table"
    assert "outside of the sweep's folder" in only.message or "is not a file" in only.message
    assert "secret" not in str(only)


def test_a_missing_table_is_marked_in_the_sweep_file(mistakes: Mistakes) -> None:
    assert mistakes("include: {file: none.csv}") == [("bad-table", "none.csv")]


WORDS = st.sampled_from([
    "timestep", "cone", "elliptic", "values", "linspace", "uniform", "role", "where", "label",
    "metrics", "file", "n", "", "timestep > 1", "0.02 1", "solref",
])  # fmt: skip
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | WORDS
ANYTHING = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.long
@given(st.dictionaries(st.sampled_from(sorted(Sweep.model_fields)), ANYTHING, max_size=6))
def test_any_data_is_read_or_refused_politely(vocabulary: Any, data: dict[str, object]) -> None:
    text = json.dumps({"version": 1, "scene": "ball"} | data)
    outcome = read_or_refused(text, vocabulary)
    if isinstance(outcome, SweepMistakesError):
        assert all(each.place.source.lines == (text,) for each in outcome.diagnostics)
        assert any(each.severity == "error" for each in outcome.diagnostics)
    else:
        assert sum(1 for _ in outcome.iterate_runs()) == outcome.count


def read_or_refused(text: str, vocabulary: Any) -> Plan | SweepMistakesError:
    try:
        return read_sweep(text, vocabulary).plan
    except SweepMistakesError as error:
        return error


@pytest.mark.long
@given(st.text(max_size=60))
def test_any_text_is_read_or_refused_politely(text: str) -> None:
    with pytest.raises(SweepFileError):
        read_sweep(f"axes: {text}", _no_scene)


def _no_scene(_: str) -> Any:
    raise AssertionError("a text without a scene asks for no vocabulary")


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("timestep: 2ms", "write [0.002]"),
        ("timestep: [5 mm]", "write a number in s"),
        ("drop_height: [5 ms]", "write a number in m"),
        ("timestep: [2 parsec]", "write a number in s"),
        ("cone: [2ms]", "write one of pyramidal, elliptic"),
    ],
)
def test_a_number_with_a_unit_is_told_without(line: str, hint: str, vocabulary: Any) -> None:
    (diagnostic,) = found(f"version: 1\nscene: ball\naxes: {{{line}}}\n", vocabulary).diagnostics
    assert diagnostic.hint == hint


def test_a_number_may_have_a_unit_of_its_axis(vocabulary: Any) -> None:
    """It is the same value as in the axis' own unit, to the last bit."""
    text = (
        "version: 1\nscene: ball\naxes: {timestep: [500 us, 2ms, 0.003 s], drop_height: [1e1cm]}\n"
    )
    rows = [run.values for run in read_sweep(text, vocabulary).plan.iterate_runs()]
    assert [row["timestep"] for row in rows] == [0.0005, 0.002, 0.003]
    assert {row["drop_height"] for row in rows} == {0.1}


@pytest.mark.parametrize(
    ("axis", "values"),
    [
        ("1..3 ms", [0.001, 0.002, 0.003]),
        ("0.5 .. 2 ms", None),
        ("{linspace: [.5 ms, 2 ms, 4]}", [0.0005, 0.001, 0.0015, 0.002]),
        ("{linspace: [500 us, 2ms, 4], role: scenario}", [0.0005, 0.001, 0.0015, 0.002]),
        ("{range: [3 ms, 1 ms, -1 ms]}", [0.003, 0.002, 0.001]),
        ("{logspace: [1 ms, 4 ms, 3]}", [0.001, 0.002, 0.004]),
    ],
)
def test_forms_may_have_units(axis: str, values: list[float] | None, vocabulary: Any) -> None:
    """They are the same values as in the axis' own unit, to the last bit; in files and options."""
    head = "version: 1\nscene: ball\n"
    if values is None:
        assert found(f"{head}axes: {{timestep: {axis}}}\n", vocabulary).diagnostics
        return
    read = read_sweep(f"{head}axes: {{timestep: {axis}}}\n", vocabulary)
    assert [run.values["timestep"] for run in read.plan.iterate_runs()] == values
    assert read.plan.axes[0].role == ("scenario" if "role" in axis else "knob")
    zipped = read_sweep(f"{head}zip: [{{timestep: {axis}}}]\n", vocabulary)
    assert [run.values["timestep"] for run in zipped.plan.iterate_runs()] == values


@pytest.mark.parametrize("form", ["uniform", "loguniform"])
def test_bounds_of_what_is_sampled_may_have_units(form: str, vocabulary: Any) -> None:
    """They are converted to the unit of the axis, and what is drawn is the same to the bit."""
    head = "version: 1\nscene: ball\nsample: {n: 8}\naxes: {timestep: "
    drawn = [
        [
            run.values["timestep"]
            for run in read_sweep(f"{head}{axis}}}\n", vocabulary).plan.iterate_runs()
        ]
        for axis in (f"{{{form}: [0.0005, 0.002]}}", f"{{{form}: [500 us, 2 ms], role: knob}}")
    ]
    assert drawn[0] == drawn[1]
    mistakes = found(f"{head}{{{form}: [1 mm, 2 mm]}}}}\n", vocabulary).diagnostics
    assert f"'{form}' takes a number, not '1 mm'" in str(mistakes[0])


def test_a_span_without_a_unit_is_no_value(vocabulary: Any) -> None:
    text = "version: 1\nscene: ball\naxes: {timestep: [0.2..0.4]}\n"
    mistakes = found(text, vocabulary).diagnostics
    assert [each.message for each in mistakes] == ["'0.2..0.4' is not a value of 'timestep'"]


@pytest.mark.parametrize("option", ["timestep=1..3 ms", "timestep=linspace(1 ms, 3 ms, 3)"])
def test_options_may_have_units(option: str, vocabulary: Any) -> None:
    text = "version: 1\nscene: ball\naxes: {timestep: {values: [0.1], role: scenario}}\n"
    read = read_sweep(text, vocabulary, Overrides([option]))
    assert [run.values["timestep"] for run in read.plan.iterate_runs()] == [0.001, 0.002, 0.003]
    assert read.plan.axes[0].role == "scenario"


@pytest.mark.parametrize(
    ("axis", "message"),
    [
        ("{linspace: [1 N, 3 N, 2]}", "'1 N' is not a value of 'timestep'"),
        ("{linspace: [1 ms, 3 mm, 2]}", "'linspace' takes a number, not '1 ms'"),
        ("{linspace: [1, 3 ms, 2]}", "'linspace' takes a number, not '3 ms'"),
        ("{range: [1 ms, 3 ms, -1 ms]}", "a step that leads from the first value to the last"),
        ("3..1 ms", "a step that leads from the first value to the last"),
    ],
)
def test_units_that_do_not_fit_are_told(axis: str, message: str, vocabulary: Any) -> None:
    text = f"version: 1\nscene: ball\naxes: {{timestep: {axis}}}\n"
    assert message in found(text, vocabulary).diagnostics[0].message


def test_a_merge_of_what_is_no_mapping_is_told(mistakes: Mistakes) -> None:
    assert mistakes("axes: {<<: 3}\n") == [("syntax", "3")]


@pytest.mark.long
def test_merges_of_merges_are_counted(mistakes: Mistakes) -> None:
    """Each line has twice as many entries as the one before."""
    lines = [
        "m0: &m0 {a: 1}",
        *(f"m{n}: &m{n} {{<<: [*m{n - 1}, *m{n - 1}]}}" for n in range(1, 64)),
    ]
    (first, *_) = mistakes("\n".join(lines))
    assert first[0] == "syntax"


def test_what_a_scene_itself_asks_for_has_a_boundary(vocabulary: Any) -> None:
    """`where: must` is of what the sweep asks for, or of what its scene's manifest does."""
    text = (
        "version: 1\nscene: ball\naxes:\n  timestep: {linspace: [1e-3, 2e-3, 5]}\n"
        "refine: {axes: [timestep], to: 5, where: must}\n"
    )
    assert "not-asked" in {each.code for each in found(text, vocabulary).diagnostics}
    read_sweep(text, lambda scene: replace(vocabulary(scene), asks=True))


def test_close_names_are_searched_for_printed_mistakes_only(vocabulary: Any) -> None:
    axes = "".join(f"  timestep{number}: [1]\n" for number in range(MOST_SHOWN_MISTAKES + 10))
    error = found(f"version: 1\nscene: ball\nduration: 1\naxes:\n{axes}", vocabulary)
    hints = [each.hint for each in error.diagnostics if each.code == "unknown-axis"]
    assert [hint == "did you mean 'timestep'?" for hint in hints] == (
        [True] * MOST_SHOWN_MISTAKES + [False] * 10
    )
    assert str(error).endswith("and 10 more")


@pytest.mark.parametrize(
    ("body", "name"),
    [("axes: {sliding_friction: [1]}", "friction.slide"), ("axes: {frictoin: [1]}", "")],
)
def test_a_description_is_taken_for_a_name(vocabulary: Any, body: str, name: str) -> None:
    """Output has descriptions, which users type; letters alone would suggest another name."""

    def described(scene: str) -> Vocabulary:
        names = vocabulary(scene)
        axes = {axis: spec.description for axis in names.axes if (spec := names.find(axis))}
        return replace(names, describe=lambda one: axes.get(one, ""))

    (mistake,) = found(f"version: 1\nscene: ball\nduration: 1\n{body}\n", described).diagnostics
    assert (mistake.hint == f"did you mean '{name}'?") == bool(name)
