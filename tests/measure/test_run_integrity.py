"""The reason of a stable run carries the overlap that its labels accept."""

from contactlab.measure.run_integrity import STABLE, find_accepted, stable_reason


def test_an_accepted_overlap_is_in_the_reason_and_comes_back() -> None:
    overlap = "a - b is deeper than its middle, for 4 ms, and turns back"
    assert find_accepted(stable_reason(overlap)) == overlap
    assert find_accepted(stable_reason(None)) == ""
    assert stable_reason(None) == STABLE.meaning
    assert find_accepted("a - b rests 3 mm deep. Accepted: no") == ""
