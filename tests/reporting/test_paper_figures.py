"""Figures for papers: exactly as wide as asked for, and a list of what a store can show."""

import io
import re
from collections.abc import Callable
from typing import Any

import pikepdf
import pytest
from PIL import Image

from contactlab.errors import OutputError
from contactlab.page.paper_figures import FIGURES, figure_files, figure_list
from contactlab.page.paper_size import parse_width
from contactlab.reporting.report import read_report_data

Swept = Callable[[str], Any]
POINT = 25.4 / 72


@pytest.mark.long
@pytest.mark.parametrize("width", ["85mm", "17cm"])
def test_figures_are_as_wide_as_asked_for(swept: Swept, width: str) -> None:
    """A pixel of a PNG is a 300th of an inch; its width is rounded to whole pixels."""
    files, _ = figure_files(read_report_data(swept("bounce")), ("png", "svg", "pdf"), width)
    wanted = parse_width(width)
    assert {name.partition(".")[0] for name in files} >= {"labels", "bounces"}
    for name, content in files.items():
        if name.endswith(".svg"):
            assert f'width="{wanted:g}mm"' in content.decode()
        elif name.endswith(".png"):
            with Image.open(io.BytesIO(content)) as image:
                assert image.size[0] == pytest.approx(wanted / 25.4 * 300, abs=2)
        else:
            with pikepdf.open(io.BytesIO(content)) as opened:
                box = [float(each) for each in opened.pages[0].mediabox.as_list()]
            # The renderer rounds to whole points before they are scaled.
            assert (box[2] - box[0]) * POINT == pytest.approx(wanted, abs=POINT)


@pytest.mark.long
def test_a_pdf_holds_every_font_that_it_uses(swept: Swept) -> None:
    files, _ = figure_files(read_report_data(swept("bounce")), ("pdf",), "85mm")
    for content in files.values():
        with pikepdf.open(io.BytesIO(content)) as opened:
            told = [each for each in opened.objects if isinstance(each, pikepdf.Dictionary)]
            fonts = [each for each in told if each.get("/Subtype") == "/CIDFontType2"]
            assert fonts
            assert all("/FontFile2" in each["/FontDescriptor"] for each in fonts)


@pytest.mark.long
def test_an_svg_needs_no_font(swept: Swept) -> None:
    """All that it says is drawn, at its width on paper as on a page."""
    for width in (None, "85mm"):
        files, _ = figure_files(read_report_data(swept("bounce")), ("svg",), width)
        for content in files.values():
            assert b"<text" not in content
            assert b"font-family" not in content
            assert b"aria-label=" in content


@pytest.mark.long
def test_text_on_paper_is_near_eight_points(swept: Swept) -> None:
    """Narrow figures keep the size of their text, where pictures of a page would shrink it."""
    files, _ = figure_files(read_report_data(swept("bounce")), ("svg",), "85mm")
    svg = files["labels.svg"].decode()
    box = re.search(r'viewBox="0 0 ([\d.]+)', svg)
    assert box is not None
    points = 85 / POINT / float(box[1]) * 11
    assert 6 <= points <= 10


@pytest.mark.long
def test_panels_that_share_labels_have_their_own_in_a_column(swept: Swept) -> None:
    """Beside each other only the first has them; below each other each has."""
    data = read_report_data(swept("tradeoff"))
    shown = {
        width: figure_files(data, ("svg",), width)[0]["effects.svg"].decode()
        for width in (None, "85mm")
    }
    once, twice = (sorted(re.findall(r'"([^"]* → [^"]*)"', text)) for text in shown.values())
    assert once
    assert twice == sorted(once * 2)


@pytest.mark.parametrize("width", ["85", "mm", "1mm", "-85mm", "85.5.5mm", "nan mm", "9m"])
def test_other_widths_are_refused(width: str) -> None:
    with pytest.raises(OutputError, match=r"write 40mm to 400mm, as in 85mm"):
        parse_width(width)


@pytest.mark.long
def test_the_list_says_what_would_be_written(swept: Swept) -> None:
    data = read_report_data(swept("bounce"))
    files, missing = figure_files(data, ("svg",))
    listed = dict(figure_list(data))
    assert [*listed] == [*FIGURES]
    for name, said in listed.items():
        assert said == (f"none: {missing[name]}" if name in missing else FIGURES[name])
    assert {f"{name}.svg" for name in listed.keys() - missing.keys()} == files.keys()
