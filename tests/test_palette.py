"""One colour has one meaning, in every picture."""

import re

import pytest

from contactlab.palette import COLOURS, LETTERS, MODE_COLOURS, SHAPES, mode_colour


@pytest.mark.parametrize("mode", MODE_COLOURS)
def test_a_mode_has_the_same_colour_on_the_page_and_in_a_film(mode: int) -> None:
    """Of 256 levels, the nearest: half of one off at most."""
    text = mode_colour(mode)
    assert re.fullmatch("#[0-9a-f]{6}", text)
    levels = [int(text[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    assert levels == pytest.approx(MODE_COLOURS[mode][:3], abs=0.5 / 255 + 1e-12)


def test_whatever_is_told_apart_by_colour_is_by_shape_and_letter_too() -> None:
    assert len({*COLOURS}) == len(COLOURS) == len(SHAPES) == len({*LETTERS})
    assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in COLOURS)
    assert len({mode_colour(mode) for mode in MODE_COLOURS}) == len(MODE_COLOURS)
