"""The page of a search for settings: the front as a figure, and the report as text."""

from html import escape

from contactlab.charts import Spec, apply_theme, static_svg
from contactlab.printable import visible
from contactlab.rendering.document import Document
from contactlab.rendering.html import render_html
from contactlab.resources import PAGE_STYLE

_STYLE = """
p, dd { overflow-wrap: anywhere; }
.front svg { display: block; max-width: 100%; height: auto; }
.front .narrow { display: none; }
@media screen and (max-width: 700px) {
  .front .wide { display: none; }
  .front .narrow { display: block; }
}
"""


def build_front_page(title: str, document: Document, wide: Spec, narrow: Spec) -> str:
    """Return one HTML page that needs no other file, with a figure for wide and narrow windows."""
    style = PAGE_STYLE.read_text(encoding="utf-8") + _STYLE
    name = f"Numerical error over time of {title}"
    figures = "".join(
        f'<div class="{width}">{static_svg(apply_theme(spec), f"{name}, {width}")}</div>'
        for width, spec in (("wide", wide), ("narrow", narrow))
    )
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="color-scheme" content="light dark">
<title>{escape(visible(title))}</title>
<style>{style}</style>
</head>
<body>
<h1>{escape(visible(title))}</h1>
<figure class="front" style="margin: 1rem 0">{figures}</figure>
{render_html(document)}
</body>
</html>
"""
