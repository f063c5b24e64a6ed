"""Fills the templates of pages, which share one head."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jinja2
from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, StrictUndefined

from contactlab.resources import open_user_cache


def _keep_value(value: object) -> object:
    return value


def open_templates(
    *folders: Path, finalize: Callable[[object], object] = _keep_value
) -> Environment:
    """Return the templates of pages, those of other folders first.

    `finalize` changes values before they are written. Each page needs one, since compiled templates
    are kept, and a template that was compiled without one never calls it.
    """
    # Jinja takes longer to compile the templates than to fill them.
    try:
        folder = open_user_cache()
    except OSError:  # a machine without a home that can be written to
        folder = None
    cache = None
    if folder is not None and os.access(folder, os.W_OK):
        cache = FileSystemBytecodeCache(str(folder), f"page-{jinja2.__version__}-%s.bin")
    return Environment(
        loader=FileSystemLoader([*folders, Path(__file__).parent / "templates"]),
        autoescape=True,
        finalize=finalize,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=cache,
    )


def fill_template(name: str, *folders: Path, **values: Any) -> str:  # noqa: ANN401 - of any type
    """Return a page from its template; values are `title`, `style` and those it names."""
    return open_templates(*folders).get_template(name).render(values)
