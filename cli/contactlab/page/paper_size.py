"""Figures of a given width on paper: charts laid out anew, so that text stays readable."""

import io
import re
from typing import Any

import pikepdf

from contactlab.charts import Spec, as_pdf, as_png, as_svg
from contactlab.errors import OutputError
from contactlab.page.outlined_text import outlined

_MM_PER_POINT = 25.4 / 72
_WIDTHS = (40.0, 400.0)  # of figures [mm]
# Text of 11 pixels is printed in 8 points.
_POINTS_PER_PIXEL = 8 / 11
_DOTS_PER_INCH = 300
# A plot is at least so much of what it is on a page.
_LEAST_PLOT_SHARE = 0.5
# Beside a narrower plot there is no room for a legend [pixels].
_LEGEND_BESIDE = 520.0
_SIZE = re.compile(r'width="([\d.]+)" height="([\d.]+)"')


def parse_width(text: str) -> float:
    """Return a width [mm] of `85mm`, `8.5cm` or `3.35in`; an OutputError says how to write one."""
    matched = re.fullmatch(r"([\d.]+) ?(mm|cm|in)", text.strip())
    low, high = _WIDTHS
    try:
        number, unit = float(matched[1]) if matched else 0.0, matched[2] if matched else "mm"
    except ValueError:
        number, unit = 0.0, "mm"
    width = number * {"mm": 1.0, "cm": 10.0, "in": 25.4}[unit]
    if not low <= width <= high:
        raise OutputError(f"--width {text}: write {low:g}mm to {high:g}mm, as in 85mm")
    return width


def render_at(spec: Spec, form: str, width: float | None) -> bytes:
    """Return a figure as a file of one of the formats, exactly so wide [mm] if a width is given."""
    if width is None:
        if form == "svg":
            return outlined(as_svg(spec)).encode()
        return as_png(spec) if form == "png" else _pdf(spec)
    pixels = width / _MM_PER_POINT / _POINTS_PER_PIXEL
    spec = laid_out(spec, pixels)
    across, high = _extent(spec)
    if form == "svg":
        size = f'width="{width:g}mm" height="{width * high / across:.4g}mm"'
        return _SIZE.sub(size, outlined(as_svg(spec)), count=1).encode()
    scale = width / _MM_PER_POINT / across
    if form == "png":
        return as_png(spec, scale * _DOTS_PER_INCH / 72)
    return _pdf(spec, scale)


def _pdf(spec: Spec, scale: float = 1.0) -> bytes:
    """Return a specification as PDF at a scale, its objects in a fixed order."""
    written = io.BytesIO()
    with pikepdf.open(io.BytesIO(as_pdf(spec))) as opened:
        for page in opened.pages if scale != 1 else ():
            page.mediabox = pikepdf.Array([float(side) * scale for side in page.mediabox.as_list()])
            page.contents_add(f"q {scale:.9f} 0 0 {scale:.9f} 0 0 cm".encode(), prepend=True)
            page.contents_add(b"Q")
        opened.save(written, deterministic_id=True)
    return written.getvalue()


def laid_out(spec: Spec, pixels: float) -> Spec:
    """Return a specification whose plots are as wide as makes the whole so wide [pixels].

    What is beside a plot keeps its size, so that one that would vanish keeps some of its width. Its
    title is left out: on paper there is a caption.
    """
    spec = {key: value for key, value in spec.items() if key != "title"}
    if pixels < _LEGEND_BESIDE:
        config = spec.get("config", {})
        below = {**config.get("legend", {}), "orient": "bottom", "columns": 2, "labelLimit": pixels}
        spec = _stacked({**spec, "config": {**config, "legend": below}})
    whole, half = (_extent(_scaled(spec, factor))[0] for factor in (1.0, 0.5))
    plots = 2 * (whole - half)
    factor = 1 + (pixels - whole) / plots if plots > 0 else 1.0
    return _scaled(spec, max(factor, _LEAST_PLOT_SHARE))


def _stacked(spec: Spec) -> Spec:
    """Return plots that share tick labels below each other, each with its own."""
    plots = spec.get("hconcat", [])
    own = [_labelled(plot) for plot in plots]
    if own == plots:
        return spec
    rest = {key: value for key, value in spec.items() if key != "hconcat"}
    return {**rest, "vconcat": own}


def _labelled(part: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(part, dict):
        own = {key: value for key, value in part.items() if (key, value) != ("labels", False)}
        return {key: _labelled(value) for key, value in own.items()}
    return [_labelled(item) for item in part] if isinstance(part, list) else part


def _scaled(part: Any, factor: float) -> Any:  # noqa: ANN401 - JSON
    """Return a specification with other widths of its plots, and gaps between them."""
    if isinstance(part, dict):
        return {
            key: value * factor
            if key == "width" and isinstance(value, int | float) and ("height" in part)
            else value
            if key in {"data", "datasets", "config", "encoding"}
            else _scaled(value, factor)
            for key, value in part.items()
        }
    return [_scaled(item, factor) for item in part] if isinstance(part, list) else part


def _extent(spec: Spec) -> tuple[float, float]:
    """Return how wide and how high a picture of a specification is [pixels]."""
    found = _SIZE.search(as_svg(spec))
    assert found is not None, "a picture has a size"
    return float(found[1]), float(found[2])
