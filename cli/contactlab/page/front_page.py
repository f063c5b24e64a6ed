"""The page of a search for settings: the front as a figure, and the report as text."""

from collections.abc import Mapping

from contactlab.charts import Spec, apply_theme, static_svg
from contactlab.page.page_template import fill_template
from contactlab.printable import visible
from contactlab.rendering.document import Document
from contactlab.rendering.html import render_html
from contactlab.resources import read_style


def build_front_page(title: str, document: Document, figures: Mapping[str, Spec]) -> str:
    """Return one HTML page that needs no other file, with a figure for each width of a window."""
    return fill_template(
        "front.html",
        title=visible(title),
        style=read_style("page"),
        figures={
            width: static_svg(apply_theme(spec), f"{title}, {width}")
            for width, spec in figures.items()
        },
        body=render_html(document),
    )
