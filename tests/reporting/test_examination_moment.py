"""The film of an examination shows the moment of its verdict."""

from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pytest
from tests.studies.test_examination import LABEL, examined

from contactlab.page.examination_view import choose_moment
from contactlab.schema.verdict import VerdictWord
from contactlab.studies.examine.conclusion import conclude

STORE: Any = SimpleNamespace(table=pa.table({"seed": [0, 1], "run_id": ["first", "second"]}))


@pytest.mark.parametrize(
    ("word", "bodies", "seed", "start"),
    [
        ("depends", ("mug", "hand"), 1, "chatter: mug, 0.35 s, seed 1"),
        ("depends", (), 1, "the worst moment: mug, 0.30 s, seed 0"),  # a label of the whole run
        ("depends", ("mug",), 7, "the worst moment: mug, 0.30 s, seed 0"),  # that has no run
        ("inaccurate", ("mug",), 1, "the worst moment: mug, 0.30 s, seed 0"),
    ],
)
def test_a_failing_label_is_filmed_where_it_begins(
    word: VerdictWord, bodies: tuple[str, ...], seed: int, start: str
) -> None:
    found = {"label": "chatter", "bodies": bodies, "seed": seed, "time": 0.35}
    report = conclude(examined(word, labels=(LABEL.model_copy(update=found),)))
    assert report.budget
    moment = choose_moment(STORE, report, report.budget)
    assert moment
    assert moment.words == start
    assert moment.run == ("second" if "seed 1" in start else "first")
    assert moment.end == pytest.approx(moment.begin + report.budget.phases[0].window)
