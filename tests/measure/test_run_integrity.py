"""The reason of a stable run carries the overlap that its labels accept, and notes."""

from contactlab.measure.run_integrity import STABLE, find_accepted, find_notes, stable_reason


def test_an_accepted_overlap_is_in_the_reason_and_comes_back() -> None:
    overlap = "a - b is deeper than its middle, for 4 ms, and turns back"
    assert find_accepted(stable_reason(overlap)) == overlap
    assert find_accepted(stable_reason(None)) == ""
    assert stable_reason(None) == STABLE.meaning
    assert find_accepted("a - b rests 3 mm deep. Accepted: no") == ""


def test_notes_follow_the_overlap_and_come_back() -> None:
    overlap, notes = "a - b is deeper than 4.5 mm", ["c falls at the end", "d is off by 1.5 mm"]
    for accepted in (None, overlap):
        reason = stable_reason(accepted, notes)
        assert find_notes(reason) == notes
        assert find_accepted(reason) == (accepted or "")
    assert find_notes(stable_reason(overlap)) == []
    assert find_notes("a - b rests 3 mm deep. Note: no.") == []
