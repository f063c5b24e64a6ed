"""The page: a store in one HTML file that needs nothing else, with its tables."""

from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from contactlab.page.page_view import PACKAGE, page_view
from contactlab.pareto.recommendation import setting_text, settings_text
from contactlab.printable import visible
from contactlab.rendering.amounts import format_percent
from contactlab.reporting.report import PageRequest
from contactlab.reporting.report_columns import number_with_unit, with_unit
from contactlab.store.finished_store import Store


def html_page(store: Store, request: PageRequest) -> tuple[str, tuple[str, ...]]:
    """Return the page of a store, and notes on omitted data."""
    environment = Environment(
        loader=PackageLoader(PACKAGE),
        autoescape=True,
        # Markup is text of our own; all other text may be data.
        finalize=lambda value: visible(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(_FILTERS)
    view = page_view(store, request)
    return environment.get_template("page.html").render(view=view), view.head.notes


def _format_number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


_FILTERS: Mapping[str, Any] = {
    "number": _format_number,
    "number_with_unit": number_with_unit,
    "with_unit": with_unit,
    "setting": setting_text,
    "settings": settings_text,
    "percent": format_percent,
}
