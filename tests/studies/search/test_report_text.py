"""Sentences of a tune report."""

import pytest
from tests.studies.search.test_search_chart import build_point, build_report

from contactlab.schema.tune_report import TuneReport
from contactlab.studies.search.report_text import counts_as_equal, sentence_of


def report_of(own: float, recommended: float, limit: float) -> TuneReport:
    points = [build_point(4, 1.0, own), build_point(5, 0.5, recommended)]
    report = build_report(points)
    return report.model_copy(
        update={
            "target": report.target.model_copy(update={"limit": limit}),
            "current": points[0].candidate,
            "recommended": points[1].candidate,
            "verified": True,
            "far_pairs": None,
            "simplified_hulls": None,
            "equal_error": None,
            "closest": None,
            "removed_sensors": (),
        }
    )


@pytest.mark.parametrize(
    ("own", "limit", "words"),
    [(1e-5, 1e-3, "0.001 % as written (equal below 0.1 %)"), (0.01, 0.01, "not 1 %")],
)
def test_a_larger_error_that_counts_as_equal_says_why(own: float, limit: float, words: str) -> None:
    """Without the limit, .004 % would seem to break a promise of no more than .001 %."""
    report = report_of(own, 4 * own, limit)
    assert counts_as_equal(report) == (own < limit)
    assert words in sentence_of(report)
