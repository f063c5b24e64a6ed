"""Counted steps: nested work is one share, and a lost Ctrl-C is noticed at the next step."""

from collections.abc import Sequence

import pytest

from contactlab.step_progress import (
    StepCount,
    count_steps,
    finished_share,
    interrupt_steps,
    listening_to_steps,
    step_names,
)


def test_nested_work_is_one_share() -> None:
    shares = list[float]()

    def listen(nested: Sequence[StepCount]) -> None:
        shares.append(finished_share(nested))

    with listening_to_steps(listen):
        for outer in count_steps(range(2), "stores", 2):
            for _ in count_steps(range(4), "traces", 4):
                assert 0 <= shares[-1] - outer / 2 < 1 / 2
    assert shares == sorted(shares)
    assert sorted(set(shares)) == [step / 8 for step in range(9)]


def test_more_steps_than_expected_are_all_of_them() -> None:
    texts = list[str]()
    with listening_to_steps(lambda nested: texts.extend(each.text for each in nested)):
        list(count_steps(range(5), "trials", 3))
        with step_names(1) as begin_step:
            begin_step("searching")
            begin_step("verifying")
    assert texts[-4:] == ["trials 3 of 3", "", "searching", "verifying"]


def test_nothing_is_reported_without_a_listener() -> None:
    assert list(count_steps("abc", "letters", 3)) == ["a", "b", "c"]
    interrupt_steps()


def test_a_lost_interruption_ends_the_next_step() -> None:
    seen = list[int]()

    def count() -> None:
        for step in count_steps(range(9), "steps", 9):
            seen.append(step)
            if step == 3:
                interrupt_steps()

    with listening_to_steps(lambda _: None), pytest.raises(KeyboardInterrupt):
        count()
    assert seen == [0, 1, 2, 3]


def test_a_lost_interruption_ends_new_work_at_its_start() -> None:
    with listening_to_steps(lambda _: None):
        interrupt_steps()
        with pytest.raises(KeyboardInterrupt):
            list(count_steps("abc", "letters", 3))


def test_counts_that_are_read_in_turns_end_in_any_order() -> None:
    """Two films side by side: the first generator ends before the second, with equal counts."""
    seen = list[list[str]]()
    with listening_to_steps(lambda nested: seen.append([each.text for each in nested])):
        pairs = zip(count_steps("ab", "left", 2), count_steps("cd", "right", 2), strict=True)
        assert list(pairs) == [("a", "c"), ("b", "d")]
        assert list(count_steps("e", "next", 1)) == ["e"]
    assert seen[-1] == ["next 1 of 1"]
