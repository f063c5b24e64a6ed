"""The sentence that says what a sweep found, read back and held against every run."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.reporting.test_map_cells import axis, run_labels

from contactlab.judge.wording import share_with_interval
from contactlab.measure import LABELS
from contactlab.reporting.finding import write_finding, write_headline
from contactlab.reporting.label_shares import exact_share
from contactlab.reporting.report_columns import GridAxis

STABLE = 2
WORDS = ("red", "green", "blue", "grey", "white")

Run = tuple[int, int, int, int]
runs_of = st.lists(
    st.tuples(st.integers(0, 4), st.integers(0, 4), st.integers(0, 1)), min_size=1, max_size=60
)


def swept(rows: list[Run]) -> tuple[GridAxis, ...]:
    """Return a numeric axis `a`, and axes of words `b` and `c`, with values that occur only."""
    axes: list[GridAxis] = []
    for place, name in enumerate("abc"):
        used = sorted({row[place] for row in rows})
        made = axis(name, [used.index(row[place]) for row in rows], len(used))
        ticks = tuple(str(value) if name == "a" else WORDS[value] for value in used)
        axes.append(GridAxis(name, "", "knob", ticks, made.codes, None))
    return tuple(each for each in axes if len(each.ticks) > 1)


def meets(condition: str, row: Run) -> bool:
    """Return whether a run has what a part of the sentence says of one axis."""
    name, said = condition.split(" ", 1)
    value = row["abc".index(name)]
    number = [int(each) for each in re.findall(r"\d+", said)]
    if said.endswith(" or less"):
        return value <= number[0]
    if said.endswith(" or more"):
        return value >= number[0]
    if " to " in said:
        return number[0] <= value <= number[1]
    listed = re.split(r", | or ", said.removeprefix("other than "))
    named = (str(value) if name == "a" else WORDS[value]) in listed
    return named != said.startswith("other than")


def check(sentence: str, rows: list[Run]) -> str:
    """Hold a sentence against all runs, one by one; return which kind of sentence it was."""
    stable = [row for row in rows if row[3] == STABLE]
    failed = [row for row in rows if row[3] != STABLE]
    if found := re.fullmatch(r"(?:All \d+ runs are|The run is) stable\.", sentence):
        assert not failed
        return "all"
    if found := re.fullmatch(r"No run is stable; (\d+) of (\d+) are (\w+)\.", sentence):
        assert not stable
        assert int(found[2]) == len(rows)
        return "none"
    if found := re.fullmatch(
        r"Only (.*?) (is stable|fails)(?:; (.*) do(?:es)? not matter)?\.", sentence
    ):
        own = stable if found[2] == "is stable" else failed
        parts = found[1].split(" with ")
        assert [row for row in rows if all(meets(each, row) for each in parts)] == own
        assert not {each[0] for each in parts} & set(re.findall(r"\b[abc]\b", found[3] or ""))
        return "exact"
    if found := re.fullmatch(
        r"Every (stable run|failure) has (.*) \((\d+) of (\d+) such runs\)\.",
        sentence,
    ):
        own = stable if found[1] == "stable run" else failed
        inside = [row for row in rows if all(meets(e, row) for e in re.split(r" and ", found[2]))]
        assert all(row in inside for row in own)
        assert (int(found[3]), int(found[4])) == (len(own), len(inside))
        return "part"
    return check_shares(sentence, rows, stable, failed)


def check_shares(sentence: str, rows: list[Run], stable: list[Run], failed: list[Run]) -> str:
    """Hold a sentence against all runs that gives a share of them, or of an outcome."""
    if found := re.fullmatch(
        r"Every run (.*) (is stable|fails): (\d+) of (\d+) (?:stable runs|failures)\.", sentence
    ):
        own = stable if found[2] == "is stable" else failed
        parts = [each.removeprefix("with ") for each in re.split(r", or (?=with )", found[1])]
        named = [row for row in rows if any(meets(each, row) for each in parts)]
        assert all(row in own for row in named)
        assert (int(found[3]), int(found[4])) == (len(named), len(own))
        return "all of"
    if found := re.fullmatch(
        r"([\d.]+ %) of runs (are stable|fail) with (. \w+), ([\d.]+ %) with (\w+)\.", sentence
    ):
        axis_name = found[3][0]
        for share, condition in ((found[1], found[3]), (found[4], f"{axis_name} {found[5]}")):
            inside = [row for row in rows if meets(condition, row)]
            own = [row for row in inside if (row[3] == STABLE) == (found[2] == "are stable")]
            assert exact_share(len(own), len(inside)) == share
        return "most"
    by_chance = "; no value of an axis has more of them than chance gives it"
    found = re.fullmatch(rf"(\d+) of (\d+) runs (are stable|fail)(?:{by_chance})?\.", sentence)
    assert found, sentence
    own = stable if found[3] == "are stable" else failed
    assert (int(found[1]), int(found[2])) == (len(own), len(rows))
    return "count"


@pytest.mark.long
@given(runs_of, st.data())
def test_the_sentence_is_true_of_any_runs(
    given_rows: list[tuple[int, int, int]], data: st.DataObject
) -> None:
    size = len(given_rows)
    codes = data.draw(st.lists(st.integers(0, 2), min_size=size, max_size=size))
    rows = [(*row, code) for row, code in zip(given_rows, codes, strict=True)]
    check(write_finding(swept(rows), run_labels(codes)), rows)


def test_each_kind_of_sentence_is_said_of_what_calls_for_it() -> None:
    """Planted in the product of 5, 5 and 2 values; of `all of` and `most`, a stable 4."""
    grid = [(a, b, c) for a in range(5) for b in range(5) for c in range(2)]
    planted = {
        "all": lambda _: True,
        "none": lambda _: False,
        "exact": lambda row: row[0] <= 2 and row[1] == 3,
        "part": lambda row: row[0] <= 2 and row[1] == 3 and row != (0, 3, 0),
        "all of": lambda row: row[0] == 4 or row[1] == row[2],
        "most": lambda row: (row[0] == 4 and row[1] < 4) or row[1] == row[2],
    }
    for kind, is_stable in planted.items():
        rows = [(*row, STABLE if is_stable(row) else 0) for row in grid]
        sentence = write_finding(swept(rows), run_labels([row[3] for row in rows]))
        assert check(sentence, rows) == kind
        if kind == "exact":
            assert sentence == "Only a 2 or less with b grey is stable; c does not matter."


def test_no_axis_is_named_for_a_difference_by_chance() -> None:
    """18 and 12 of 32 runs are as unequal by chance once in ten sweeps, 24 and 8 hardly ever."""
    grid = [(a, b, c) for a in range(2) for b in range(2) for c in range(2)]
    for failures, found in (((18, 12), "30 of 64 runs fail; no value"), ((24, 8), "75 % of runs")):
        rows, codes = list[Run](), list[int]()
        for a, b, c in grid:
            # Four settings share the failures of each value of `a`, evenly over `b` and `c`.
            most = failures[a] // 4 + (failures[a] % 4 == 2 and b == c)
            rows += [(a, b, c, 0)] * 8
            codes += [0] * most + [STABLE] * (8 - most)
        assert write_finding(swept(rows), run_labels(codes)).startswith(found)


def test_shares_of_draws_have_their_interval() -> None:
    """Of 5 x 5 x 2, most fail: of runs with a = 4, 8 of 10 are stable, with a = 0 2 of 10."""
    grid = [(a, b, c) for a in range(5) for b in range(5) for c in range(2)]
    stable = [(a == 4 and b < 4) or b == c for a, b, c in grid]
    labels = run_labels([STABLE if each else 0 for each in stable])
    axes = swept([(*row, 0) for row in grid])
    assert write_finding(axes, labels, share_with_interval) == (
        f"{share_with_interval(8, 10)} of runs are stable with a 4, "
        f"{share_with_interval(2, 10)} with 0."
    )
    inside = [a <= 2 and b == 3 and (a, b, c) != (0, 3, 0) for a, b, c in grid]
    part = run_labels([STABLE if each else 0 for each in inside])
    said = write_finding(axes, part, share_with_interval)
    assert f"(5 of 6 such runs, {share_with_interval(5, 6)})" in said


def test_the_headline_counts_all_runs() -> None:
    assert write_headline(run_labels([0, 1, 1, 2, 2, 2])) == (
        "3 of 6 runs are stable; 2 chatter, 1 diverged"
    )


def test_every_label_has_a_letter_and_a_colour_of_its_own() -> None:
    marked = [label for label in LABELS.values() if not label.is_good]
    assert all(label.letter and label.colour for label in marked)
    assert len({label.letter for label in marked}) == len(marked)
    assert len({label.colour for label in LABELS.values()}) == len(LABELS)


@pytest.mark.parametrize(
    ("failing", "said"),
    [
        ({"2", "5"}, "a time step of 2 ms or more"),
        ({"0.5", "1"}, "a time step of 1 ms or less"),
        ({"0.5"}, "a time step of 0.5 ms"),
        ({"1", "5"}, "a time step of 1 ms or 5 ms"),
    ],
)
def test_an_amount_has_its_unit(failing: set[str], said: str) -> None:
    ticks = ("0.5", "1", "2", "5")
    made = axis("time_step", [0, 1, 2, 3], 4)
    steps = GridAxis("time_step", "ms", "knob", ticks, made.codes, None)
    labels = run_labels([0 if tick in failing else STABLE for tick in ticks])
    assert said in write_finding((steps,), labels)


def test_excluded_amounts_have_their_unit() -> None:
    """Of 5 x 2 runs, four fail: those of one color, except one step."""
    codes = [step for step in range(5) for _ in range(2)]
    made = axis("time_step", codes, 5)
    steps = GridAxis("time_step", "ms", "knob", ("0.5", "1", "2", "5", "10"), made.codes, None)
    colors = axis("color", [0, 1] * 5, 2)
    failing = [place % 2 == 1 and step != 2 for place, step in enumerate(codes)]
    said = write_finding((steps, colors), run_labels([0 if each else STABLE for each in failing]))
    assert said.startswith("Only time_step other than 2 ms with color ")
