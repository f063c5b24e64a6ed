"""From a specification to a picture."""

import io
import re
from importlib.util import find_spec
from typing import Any

from contactlab.errors import OutputError

_LIBRARIES = ("altair", "jinja2", "pikepdf", "vl_convert")
# A picture names no address, not even one that nothing is fetched from.
_NOWHERE: list[str] = []
FORMATS = ("png", "svg", "pdf")
_SCALE = 3.0
_ID = re.compile(r'\bid="([^"]+)"')
_PART = "part-"


def check_libraries() -> None:
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


def rendered(spec: dict[str, Any], form: str) -> bytes:
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


def inline(svg: str, name: str) -> str:
    """Return an SVG as part of a page, with a name for those who do not see it."""
    escaped = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return re.sub(r"<svg ", f'<svg role="img" aria-label="{escaped}" ', svg, count=1)


def bundle() -> str:
    """Return the code that draws specifications in a browser."""
    import vl_convert  # noqa: PLC0415 - needs the extra

    return vl_convert.javascript_bundle("window.vegaEmbed = vegaEmbed;")
