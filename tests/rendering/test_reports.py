"""Each report says the same facts as text, Markdown and HTML, and fits any width."""

import re
from html import unescape

import pytest
from tests.rendering.sample_reports import REPORTS

from contactlab.parts import register_parts
from contactlab.registry import own_parts
from contactlab.rendering.html import render_html
from contactlab.rendering.markdown import render_markdown
from contactlab.rendering.text import render_text
from contactlab.schema.report_model import DescribedReport

register_parts()
WIDTHS = (60, 80, 132)


def words_of(text: str) -> set[str]:
    return set(re.findall(r"[A-Za-z0-9]+(?:\.[0-9]+)?", text))


@pytest.mark.parametrize("name", REPORTS)
def test_every_format_has_the_same_facts(name: str) -> None:
    document = REPORTS[name].describe()
    said = words_of(render_text(document, 200))
    markdown = re.sub(r"<!--.*?-->|\\", "", render_markdown(document))
    assert words_of(unescape(markdown)) == said
    assert words_of(unescape(re.sub(r"<[^>]*>", " ", render_html(document)))) == said
    for width in WIDTHS:
        assert words_of(render_text(document, width)) >= said


@pytest.mark.parametrize("name", REPORTS)
@pytest.mark.parametrize("width", WIDTHS)
def test_a_report_fits_its_width(name: str, width: int) -> None:
    for line in render_text(REPORTS[name].describe(), width).split("\n"):
        assert len(line) <= width or re.search(r"\S{30}|[a-z]+: \S", line)


@pytest.mark.parametrize("name", REPORTS)
def test_numbers_of_a_report_are_in_its_json_without_nan(name: str) -> None:
    report = REPORTS[name]
    written = getattr(report, "model_dump_json")()  # noqa: B009 - of pydantic
    assert "NaN" not in written
    assert "Infinity" not in written


@pytest.mark.parametrize("name", REPORTS)
def test_a_notebook_shows_a_report(name: str) -> None:
    report = REPORTS[name]
    assert getattr(report, "_repr_html_")() == render_html(report.describe())  # noqa: B009
    assert getattr(report, "_repr_markdown_")() == render_markdown(report.describe())  # noqa: B009


def test_each_report_class_has_one_description() -> None:
    described = {kind.__name__ for kind in _subclasses(DescribedReport)} - {"ReportModel"}
    assert set(own_parts("description")) >= described


def _subclasses(kind: type) -> set[type]:
    own = kind.__subclasses__()
    return {*own, *(further for one in own for further in _subclasses(one))}
