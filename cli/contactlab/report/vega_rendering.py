"""The same chart on paper, and on a page that may be light or dark."""

import io
import re
from importlib.util import find_spec
from typing import Any

from contactlab.errors import OutputError
from contactlab.tradeoff import COLOURS

PAPER = "white"
# What charts are drawn in, and what stands for it on a page; its style sheet sets the variables.
_ON_PAGE = {
    "white": "var(--page,#fff)",
    "#222222": "var(--ink,#222)",
    "#eeeeee": "var(--grid,#eee)",
    "#f2f2f2": "var(--band,#f2f2f2)",
    "#dbe5de": "var(--calm,#dbe5de)",
    "#777777": "var(--faint,#666)",
    "#555555": "var(--faint,#666)",
    "#999999": "var(--edge,#999)",
    "#c4c4c4": "var(--rest,#c4c4c4)",
    **{colour: f"var(--hue-{place},{colour})" for place, colour in enumerate(COLOURS)},
}
FONT = "system-ui, -apple-system, 'Segoe UI', sans-serif"
_TEXT = "#222222"
_FAINT = "#555555"


def themed(spec: dict[str, Any]) -> dict[str, Any]:
    """Return a specification with the look that all charts share."""
    given = spec.get("config", {})
    words = {"labelColor": _TEXT, "titleColor": _TEXT}
    axis = {
        **words,
        "tickColor": "#999999",
        "domainColor": "#999999",
        "gridColor": "#eeeeee",
        "labelFontSize": 11,
        "titleFontSize": 12,
        "titleFontWeight": "normal",
        **given.get("axis", {}),
    }
    config = {
        **given,
        # A chart has one name, and a table beside it; a name for every mark would double its size.
        "aria": False,
        "background": PAPER,
        "font": FONT,
        # Words are measured in one font, and a reader's may be wider.
        "padding": {"left": 5, "top": 5, "right": 48, "bottom": 5},
        "axis": axis,
        "legend": {**words, "labelLimit": 360, "titleFontWeight": "normal"}
        | given.get("legend", {}),
        "title": {"color": _TEXT, "subtitleColor": _FAINT, "anchor": "start"},
        "view": {"stroke": "#999999", **given.get("view", {})},
    }
    return {**spec, "config": config}


def with_page_colours(spec: dict[str, Any]) -> dict[str, Any]:
    """Return a specification whose colours follow the page's style sheet."""
    return _recoloured(spec)


def _recoloured(part: Any) -> Any:  # noqa: ANN401 - anything that JSON holds
    if isinstance(part, dict):
        return {
            key: value if key in {"values", "datasets"} else _recoloured(value)
            for key, value in part.items()
        }
    if isinstance(part, list):
        return [_recoloured(each) for each in part]
    return _ON_PAGE.get(part, part) if isinstance(part, str) else part


_LIBRARIES = ("altair", "jinja2", "pikepdf", "vl_convert")
# A picture names no address, not even one that nothing is fetched from.
_NOWHERE: list[str] = []
FORMATS = ("png", "svg", "pdf")
_SCALE = 3.0
_ID = re.compile(r'\bid="([^"]+)"')
_PART = "part-"


def check_chart_libraries() -> None:
    """Check that charts can be drawn.

    Raises:
        OutputError: a library is missing.
    """
    if not all(find_spec(library) for library in _LIBRARIES):
        raise OutputError(
            "reports need Altair, Jinja, pikepdf and vl-convert; install them with "
            "`pip install 'contactlab[figures]'`"
        )


def as_svg(spec: dict[str, Any], prefix: str = "") -> str:
    """Return a specification as SVG.

    Args:
        spec: a Vega-Lite specification.
        prefix: what ids begin with, so that several pictures can be on one page.
    """
    import vl_convert  # noqa: PLC0415 - needs the extra

    return _numbered(vl_convert.vegalite_to_svg(spec, allowed_base_urls=_NOWHERE), prefix)


def _numbered(svg: str, prefix: str) -> str:
    """Return an SVG whose ids count from 0; as drawn they go on from the picture before."""
    places: dict[str, str] = {}
    for name in _ID.findall(svg):
        places.setdefault(name, f"{prefix}{len(places)}")
    if not places:
        return svg
    known = re.compile("|".join(rf"(?<=[#\"]){re.escape(name)}(?=[\")])" for name in places))
    return known.sub(lambda found: f"{_PART}{places[found[0]]}", svg)


def render_chart(spec: dict[str, Any], form: str) -> bytes:
    """Return a specification as a file of one of the formats."""
    import vl_convert  # noqa: PLC0415 - needs the extra

    if form == "svg":
        return as_svg(spec).encode()
    if form == "png":
        return vl_convert.vegalite_to_png(spec, scale=_SCALE, allowed_base_urls=_NOWHERE)
    return _in_order(vl_convert.vegalite_to_pdf(spec, allowed_base_urls=_NOWHERE))


def _in_order(pdf: bytes) -> bytes:
    """Return a PDF with its objects and their entries in one order; as drawn it is by chance."""
    import pikepdf  # noqa: PLC0415 - needs the extra

    written = io.BytesIO()
    with pikepdf.open(io.BytesIO(pdf)) as opened:
        opened.save(written, deterministic_id=True)
    return written.getvalue()


def inline_svg(svg: str, name: str) -> str:
    """Return an SVG as part of a page, with a name for those who do not see it."""
    escaped = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return re.sub(r"<svg ", f'<svg role="img" aria-label="{escaped}" ', svg, count=1)


def vega_bundle() -> str:
    """Return the code that draws specifications in a browser."""
    import vl_convert  # noqa: PLC0415 - needs the extra

    return vl_convert.javascript_bundle("window.vegaEmbed = vegaEmbed;")
