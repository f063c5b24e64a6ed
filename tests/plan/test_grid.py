"""A grid counts the rows that it yields, without making them."""

from hypothesis import given
from hypothesis import strategies as st

from contactlab.plan.diagnostics import Place, SourceText
from contactlab.plan.grid import Block, Grid, Match, RowValues

NOWHERE = Place(SourceText("nowhere", ("",)), 1, 1)
VALUES = st.integers(0, 3)
CONDITIONS = st.lists(st.dictionaries(st.sampled_from("ab"), VALUES, min_size=1), max_size=3)


@given(
    first=st.sets(VALUES, min_size=1),
    second=st.sets(VALUES, min_size=1),
    conditions=CONDITIONS,
    added=st.lists(st.fixed_dictionaries({"a": VALUES}), max_size=3),
    most=st.integers(1, 20),
)
def test_as_many_rows_as_it_yields(
    first: set[int],
    second: set[int],
    conditions: list[dict[str, int]],
    added: list[RowValues],
    most: int,
) -> None:
    """Whatever is left out or added; conditions that nothing meets are named."""
    excludes = tuple(Match(tuple(each.items()), None, NOWHERE) for each in conditions)
    blocks = tuple(
        Block((name,), tuple((value,) for value in values))
        for name, values in (("a", first), ("b", second))
    )
    grid = Grid({}, blocks, excludes, tuple(added)).with_baseline(["a"])
    rows = list(grid.iterate_rows())
    count, unmet = grid.count_rows()
    assert count == len(rows)
    product = [{"a": a, "b": b} for a in first for b in second]
    left = [row for row in product if not any(each.items() <= row.items() for each in conditions)]
    assert sorted(map(repr, rows[: len(left)])) == sorted(map(repr, left))
    met = [any(each.items() <= row.items() for row in product) for each in conditions]
    assert [each.settings for each in unmet] == [
        tuple(each.items()) for each, is_met in zip(conditions, met, strict=True) if not is_met
    ]
    assert min(grid.count_rows(most)[0], most) == min(len(rows), most)
