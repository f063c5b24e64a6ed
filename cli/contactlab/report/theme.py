"""The same chart on paper, and on a page that may be light or dark."""

from typing import Any

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
_INK = "#222222"
_FAINT = "#555555"


def configured(spec: dict[str, Any]) -> dict[str, Any]:
    """Return a specification with the look that all charts share."""
    given = spec.get("config", {})
    words = {"labelColor": _INK, "titleColor": _INK}
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
        "title": {"color": _INK, "subtitleColor": _FAINT, "anchor": "start"},
        "view": {"stroke": "#999999", **given.get("view", {})},
    }
    return {**spec, "config": config}


def on_page(spec: dict[str, Any]) -> dict[str, Any]:
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
