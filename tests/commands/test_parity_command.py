"""The command `parity`: what it is asked for by its options."""

from typing import Any

import pytest


@pytest.mark.parametrize(
    "options",
    [[], ["grasp"], ["--from", "there", "grasp"], ["grasp", "--against", "warp", "--bundle", "b"]],
)
def test_options_that_do_not_go_together_are_told(contactlab: Any, options: list[str]) -> None:
    told = contactlab("parity", *options)
    assert told.code == 2
    assert "--from FOLDER alone" in told.err


def test_a_bundle_is_written_and_waits_for_its_results(contactlab: Any) -> None:
    written = contactlab(
        "parity", "slide", "--limit", "1", "--set", "duration=0.02", "--bundle", "b"
    )
    assert (written.code, written.out) == (0, "1 run in b, for its check_newton.py\n")
    told = contactlab("parity", "--from", "b")
    assert (told.code, "has no results yet" in told.err) == (3, True)
