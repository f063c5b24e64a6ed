"""Charts: their layers, one theme for paper and page, and how they become pictures."""

import re
from collections.abc import Callable, Container, Iterable, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from types import ModuleType
from typing import Any

import altair as alt
import vl_convert

from contactlab.errors import OutputError
from contactlab.palette import COLOURS, INK, OTHERS_COLOUR, STABLE_COLOUR, on_dark
from contactlab.printable import visible
from contactlab.resources import address_space_limit, open_user_cache, read_style, short_hash

Rows = list[dict[str, Any]]
Spec = dict[str, Any]

# A picture loads nothing, from nowhere.
_ALLOWED_URLS: list[str] = []
_SCALE = 3.0
_EXPOSED = "window.vegaEmbed = vegaEmbed;"  # which pages call
SUFFIXES = (".png", ".svg")
_ID = re.compile(r'\bid="([^"]+)"')
_COLOUR = re.compile("#[0-9a-f]{6}")
_PAPER, _FAINT, _GRID, _EDGE = "white", "#555555", "#eeeeee", "#999999"
_TEXT = {"labelColor": INK, "titleColor": INK}
_THEME: Spec = {
    # A chart has one name, and a table next to it; a name for every mark would double its size.
    "aria": False,
    "background": _PAPER,
    "font": "system-ui, -apple-system, 'Segoe UI', sans-serif",
    # Text is measured in one font, and a reader's may be wider.
    "padding": {"left": 5, "top": 5, "right": 48, "bottom": 5},
    "axis": {
        **_TEXT,
        "tickColor": _EDGE,
        "domainColor": _EDGE,
        "gridColor": _GRID,
        "labelFontSize": 11,
        "titleFontSize": 12,
        "titleFontWeight": "normal",
    },
    "legend": {**_TEXT, "labelLimit": 360, "titleFontWeight": "normal"},
    "header": _TEXT,
    "title": {"color": INK, "subtitleColor": _FAINT, "anchor": "start"},
    "view": {"stroke": _EDGE},
}
# Colors on paper, and the variables of the page's style sheet that stand for them.
_PAGE_COLOURS = {
    _PAPER: "var(--page,#fff)",
    INK: "var(--ink,#222)",
    _GRID: "var(--grid,#eee)",
    "#f2f2f2": "var(--band,#f2f2f2)",
    STABLE_COLOUR: "var(--calm,#dbe5de)",
    "#777777": "var(--faint,#666)",
    _FAINT: "var(--faint,#666)",
    _EDGE: "var(--edge,#999)",
    OTHERS_COLOUR: "var(--rest,#c4c4c4)",
    **{colour: f"var(--hue-{place},{colour})" for place, colour in enumerate(COLOURS)},
}


def layer_of(name: str, rows: Rows) -> alt.Chart:
    """Return an unmarked layer over named rows."""
    return alt.Chart(alt.InlineData(values=rows, name=name))


def halo_layers(layer: alt.Chart, **style: Any) -> list[alt.Chart]:  # noqa: ANN401 - as Altair takes it
    """Return text drawn twice: first a halo, which makes it readable on any colour."""
    plain: Spec = {"color": INK, **style}
    halo: Spec = {"stroke": "white", "strokeWidth": 3, "strokeJoin": "round"}
    return [layer.mark_text(**plain, **halo), layer.mark_text(**plain)]


def word_colours(field: str, words: Sequence[str], colours: Sequence[str]) -> alt.Color:
    """Return the color of each word that a field may hold."""
    return alt.Color(f"{field}:N").scale(domain=list(words), range=list(colours))


def apply_theme(spec: Spec) -> Spec:
    """Return a specification in the theme that all charts share."""
    own_config = spec.get("config", {})
    own = {part: _THEME[part] | own_config.get(part, {}) for part in ("axis", "legend", "view")}
    return {**spec, "config": own_config | _THEME | own}


def with_page_colours(spec: Spec) -> Spec:
    """Return a specification with colors of the page's style sheet, light or dark."""
    return _with_texts(spec, _page_colour, {"values", "datasets"})


def with_dark_colours(spec: Spec) -> Spec:
    """Return a specification in the colors of a dark page."""
    return _with_texts(spec, _dark_colour, {"values", "datasets"})


def adaptive_svg(spec: Spec) -> str:
    """Return a specification as SVG that is dark if its reader prefers a dark page.

    Programs that know no such preference draw it light.
    """
    svg = as_svg(spec)
    rules = "".join(
        f'[{part}="{colour}"]{{{part}:{_dark_colour(colour)}}}'
        for colour in dict.fromkeys([*_COLOUR.findall(svg), _PAPER])
        for part in ("fill", "stroke")
        if f'{part}="{colour}"' in svg
    )
    style = f"<style>@media (prefers-color-scheme:dark){{{rules}}}</style>"
    return re.sub(r"(<svg [^>]*>)", lambda match: match[1] + style, svg, count=1)


def _dark_colour(text: str) -> str:
    page = re.fullmatch(r"var\(--([\w-]+),[^)]*\)", _page_colour(text))
    if page is None:
        return text
    return _dark_page().get(page[1]) or (on_dark(text) if _COLOUR.fullmatch(text) else text)


@cache
def _dark_page() -> dict[str, str]:
    style = read_style("page")
    _, _, dark = style.partition("prefers-color-scheme: dark")
    block, _, _ = dark.partition("}")
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]+)", block))


def _page_colour(text: str) -> str:
    if text in _PAGE_COLOURS:
        return _PAGE_COLOURS[text]
    return f"var(--on-{text[1:]},{text})" if _COLOUR.fullmatch(text) else text


def colours_on_dark(colours: Iterable[str]) -> str:
    """Return the style sheet of colors that have no variable of their own, for a dark page."""
    own = [colour for colour in dict.fromkeys(colours) if _COLOUR.fullmatch(colour)]
    lines = " ".join(f"--on-{each[1:]}: {on_dark(each)};" for each in own)
    return f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {lines} }} }}\n"


def _with_texts(part: Any, changed: Callable[[str], str], kept_keys: Container[str] = ()) -> Any:  # noqa: ANN401 - JSON
    """Return a part of a specification with changed texts, except below some keys."""
    if isinstance(part, dict):
        return {
            key: value if key in kept_keys else _with_texts(value, changed, kept_keys)
            for key, value in part.items()
        }
    if isinstance(part, list):
        return [_with_texts(item, changed, kept_keys) for item in part]
    return changed(part) if isinstance(part, str) else part


def make_visible(spec: Spec) -> Spec:
    """Return a specification with texts for XML: the renderer ends the process otherwise."""
    return _with_texts(spec, visible)


def _open_renderer() -> ModuleType:
    # Its JavaScript engine reserves more than 64 GiB of addresses but uses few. It ends the process
    # by a signal if the system refuses them.
    least, limit = 72 << 30, address_space_limit()
    if limit < least:
        raise OutputError(
            f"charts need {least >> 30} GiB of address space, and the limit is "
            f"{limit / (1 << 30):.3g} GiB; raise it (ulimit -v unlimited)"
        )
    return vl_convert


def as_svg(spec: Spec, prefix: str = "") -> str:
    """Return a specification as SVG; a prefix of its ids lets several fit on one page."""
    svg = _open_renderer().vegalite_to_svg(make_visible(spec), allowed_base_urls=_ALLOWED_URLS)
    # Its ids count from 0: the renderer goes on from the picture before.
    numbers = {name: place for place, name in enumerate(dict.fromkeys(_ID.findall(svg)))}
    if not numbers:
        return svg
    ids = re.compile("|".join(rf"(?<=[#\"]){re.escape(name)}(?=[\")])" for name in numbers))
    return ids.sub(lambda match: f"part-{prefix}{numbers[match[0]]}", svg)


def static_svg(spec: Spec | None, name: str) -> str:
    """Return a chart as part of a page, with a name for screen readers; empty without a chart."""
    if spec is None:
        return ""
    prefix = re.sub(r"\W+", "-", name.lower())
    escaped = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    svg = as_svg(with_page_colours(spec), f"{prefix}-")
    return re.sub(r"<svg ", f'<svg role="img" aria-label="{escaped}" ', svg, count=1)


def check_figure(path: Path, page: str = "") -> None:
    """Check that a figure can be written, before anything is run; an OutputError says why not.

    `page` is another suffix that may be written, such as `.html`.
    """
    allowed = (*SUFFIXES, page) if page else SUFFIXES
    if path.suffix not in allowed:
        raise OutputError(f"{path}: write a name that ends in {' or '.join(allowed)}")
    if not path.parent.is_dir():
        raise OutputError(f"cannot write {path}: no folder {path.parent}")
    try:
        TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error


def save_figure(chart: alt.TopLevelMixin, path: Path, *, dark: bool | None = False) -> None:
    """Write a chart as a .png or .svg file; an OutputError if it cannot be written.

    It is light or dark; if `dark` is None, an SVG is as its reader prefers.
    """
    try:
        spec = apply_theme(chart.to_dict())
        if dark:
            spec = with_dark_colours(spec)
        if path.suffix == ".png":
            path.write_bytes(as_png(spec))
        else:
            path.write_bytes((adaptive_svg if dark is None else as_svg)(spec).encode())
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error


def as_png(spec: Spec, scale: float = _SCALE) -> bytes:
    """Return a specification as PNG, with `scale` dots per pixel."""
    return _open_renderer().vegalite_to_png(
        make_visible(spec), scale=scale, allowed_base_urls=_ALLOWED_URLS
    )


def as_pdf(spec: Spec) -> bytes:
    """Return a specification as PDF, with its objects in no fixed order."""
    return _open_renderer().vegalite_to_pdf(make_visible(spec), allowed_base_urls=_ALLOWED_URLS)


@cache
def vega_bundle() -> str:
    """Return the JavaScript that draws specifications in a browser.

    It is bundled once for each version of vl-convert and kept in the user's cache.
    """
    try:
        folder = open_user_cache()
        if folder is None:
            return _bundle_vega()
        release = version("vl-convert-python")
        target = folder / f"vega-{release}-{short_hash([release, _EXPOSED])}.js"
        if not target.exists():
            # Two processes may bundle it at once; each replaces the file as a whole.
            with TemporaryDirectory(dir=folder) as temporary:
                file = Path(temporary) / target.name
                file.write_bytes(_bundle_vega().encode())
                file.replace(target)
        return target.read_bytes().decode()
    except OSError:
        return _bundle_vega()


def _bundle_vega() -> str:
    return _open_renderer().javascript_bundle(_EXPOSED)
