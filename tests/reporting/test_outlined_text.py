"""Text as outlines: the same picture, without text."""

import io
import re

import numpy as np
import pytest
import vl_convert
from PIL import Image

from contactlab.charts import as_svg
from contactlab.page.outlined_text import outline_text

FONT = 'font-family="sans-serif" font-size="24px"'
TEXT = f'<text transform="translate({{x}},30)" {FONT} {{more}}>{{said}}</text>'
PICTURE = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="300" height="50">'
    '<rect width="300" height="50" fill="white"/>{}</svg>'
)


def ink(svg: str) -> np.ndarray:
    """Return (h, w) how dark a picture is, of which a pixel is a half of one."""
    with Image.open(io.BytesIO(vl_convert.svg_to_png(svg, scale=2))) as image:
        return 1 - np.asarray(image.convert("L"), dtype=float) / 255


@pytest.mark.parametrize("said", ["8", "mass", "μ → °", "Åé ½", "0.5 [m/s²]", "a &lt; b"])
@pytest.mark.parametrize(
    "more", ["", 'text-anchor="middle"', 'text-anchor="end" font-weight="bold"']
)
def test_outlines_look_like_the_text(said: str, more: str) -> None:
    """Coordinates are rounded by .005 at either edge of strokes that are 2 wide or more: .5 %."""
    svg = PICTURE.format(TEXT.format(x=150, more=more, said=said))
    drawn = outline_text(svg)
    assert "<text" not in drawn
    assert f'aria-label="{said}"' in drawn
    wanted = ink(svg)
    assert wanted.sum() > 20
    assert np.abs(ink(drawn) - wanted).sum() < 0.005 * wanted.sum()


@pytest.mark.long
def test_lines_of_a_title_are_below_each_other() -> None:
    spec = {"data": {"values": [{}]}, "mark": "point", "title": ["One line", "and another"]}
    svg = as_svg(spec)
    drawn = outline_text(svg)
    assert "<text" not in drawn
    wanted = ink(svg)
    assert np.abs(ink(drawn) - wanted).sum() < 0.1 * wanted.sum()


def test_what_has_no_outlines_stays_text() -> None:
    """The reader's fonts may have the character; other texts are drawn."""
    svg = PICTURE.format(
        "".join(TEXT.format(x=9, more="", said=each) for each in ("\U0010fffd", "b"))
    )
    drawn = outline_text(svg)
    assert re.findall("<text[^>]*>(.*?)</text>", drawn) == ["\U0010fffd"]
    assert 'aria-label="b"' in drawn


def test_a_picture_without_text_stays() -> None:
    assert "path" not in outline_text(PICTURE.format(""))
