"""Figures of a given width on paper: charts with a new layout, so that text stays readable."""

import io
import re
from dataclasses import dataclass
from typing import Any

import pikepdf

from contactlab.charts import Spec, as_pdf, as_png, as_svg
from contactlab.errors import OutputError
from contactlab.page.outlined_text import outline_text


@dataclass(frozen=True)
class _PaperSize:
    """Sizes of figures on paper."""

    mm_per_point: float = 25.4 / 72
    widths_mm: tuple[float, float] = (40.0, 400.0)
    # Text of 11 pixels is printed in 8 points.
    points_per_pixel: float = 8 / 11
    dots_per_inch: int = 300
    # A plot keeps at least this share of its size on a page.
    least_plot_share: float = 0.5
    # A legend next to a narrower plot has no room; it goes below.
    least_legend_pixels: float = 520.0


_PAPER = _PaperSize()

_SIZE = re.compile(r'width="([\d.]+)" height="([\d.]+)"')


def parse_width(text: str) -> float:
    """Return a width [mm] of `85mm`, `8.5cm` or `3.35in`; an OutputError says how to write one."""
    matched = re.fullmatch(r"([\d.]+) ?(mm|cm|in)", text.strip())
    low, high = _PAPER.widths_mm
    try:
        number, unit = float(matched[1]) if matched else 0.0, matched[2] if matched else "mm"
    except ValueError:
        number, unit = 0.0, "mm"
    width = number * {"mm": 1.0, "cm": 10.0, "in": 25.4}[unit]
    if not low <= width <= high:
        raise OutputError(f"--width {text}: write {low:g}mm to {high:g}mm, as in 85mm")
    return width


def render_at(spec: Spec, form: str, width: float | None) -> bytes:
    """Return a figure as a file of one of the formats, exactly of any given width [mm]."""
    if width is None:
        if form == "svg":
            return outline_text(as_svg(spec)).encode()
        return as_png(spec) if form == "png" else _render_pdf(spec)
    pixels = width / _PAPER.mm_per_point / _PAPER.points_per_pixel
    spec = laid_out(spec, pixels)
    across, high = _picture_size(spec)
    if form == "svg":
        size = f'width="{width:g}mm" height="{width * high / across:.4g}mm"'
        return _SIZE.sub(size, outline_text(as_svg(spec)), count=1).encode()
    scale = width / _PAPER.mm_per_point / across
    if form == "png":
        return as_png(spec, scale * _PAPER.dots_per_inch / 72)
    return _render_pdf(spec, scale)


def _render_pdf(spec: Spec, scale: float = 1.0) -> bytes:
    """Return a specification as PDF at a scale, its objects in a fixed order."""
    buffer = io.BytesIO()
    with pikepdf.open(io.BytesIO(as_pdf(spec))) as opened:
        for page in opened.pages if scale != 1 else ():
            page.mediabox = pikepdf.Array([float(side) * scale for side in page.mediabox.as_list()])
            page.contents_add(f"q {scale:.9f} 0 0 {scale:.9f} 0 0 cm".encode(), prepend=True)
            page.contents_add(b"Q")
        opened.save(buffer, deterministic_id=True)
    return buffer.getvalue()


def laid_out(spec: Spec, pixels: float) -> Spec:
    """Return a specification with plots of a width that makes the whole `pixels` wide.

    The parts next to a plot keep their size, so a plot that would vanish keeps some of its width.
    The title is left out: on paper there is a caption.
    """
    spec = {key: value for key, value in spec.items() if key != "title"}
    if pixels < _PAPER.least_legend_pixels:
        config = spec.get("config", {})
        below = {**config.get("legend", {}), "orient": "bottom", "columns": 2, "labelLimit": pixels}
        spec = _stack_plots({**spec, "config": {**config, "legend": below}})
    whole, half = (_picture_size(_scale_plots(spec, factor))[0] for factor in (1.0, 0.5))
    plots = 2 * (whole - half)
    factor = 1 + (pixels - whole) / plots if plots > 0 else 1.0
    return _scale_plots(spec, max(factor, _PAPER.least_plot_share))


def _stack_plots(spec: Spec) -> Spec:
    """Return plots that share tick labels below each other, each with its own."""
    plots = spec.get("hconcat", [])
    own = [_show_labels(plot) for plot in plots]
    if own == plots:
        return spec
    rest = {key: value for key, value in spec.items() if key != "hconcat"}
    return {**rest, "vconcat": own}


def _show_labels(part: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(part, dict):
        own = {key: value for key, value in part.items() if (key, value) != ("labels", False)}
        return {key: _show_labels(value) for key, value in own.items()}
    return [_show_labels(item) for item in part] if isinstance(part, list) else part


def _scale_plots(part: Any, factor: float) -> Any:  # noqa: ANN401 - JSON
    """Return a specification with other widths of its plots, and gaps between them."""
    if isinstance(part, dict):
        return {
            key: value * factor
            if key == "width" and isinstance(value, int | float) and ("height" in part)
            else value
            if key in {"data", "datasets", "config", "encoding"}
            else _scale_plots(value, factor)
            for key, value in part.items()
        }
    return [_scale_plots(item, factor) for item in part] if isinstance(part, list) else part


def _picture_size(spec: Spec) -> tuple[float, float]:
    """Return the width and the height of a specification's picture [pixels]."""
    match = _SIZE.search(as_svg(spec))
    assert match is not None, "a picture has a size"
    return float(match[1]), float(match[2])
