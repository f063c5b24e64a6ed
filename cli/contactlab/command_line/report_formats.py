"""Prints reports in any format, from the one document that describes each."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from contactlab.command_line.declaration import Arguments, Show
from contactlab.command_line.terminal import echo, print_document, print_report_json
from contactlab.rendering.document import Document
from contactlab.rendering.markdown import render_markdown


class DescribedResult(Protocol):
    """A result that a document describes."""

    def describe(self, **options: Any) -> Document:  # noqa: ANN401 - of its own function
        """Return its document."""
        ...


FolderOf = Callable[[Arguments], Path]
"""Returns the folder of a command's results, from its parameters."""


def print_text(folder: FolderOf | None = None, **options: object) -> Show:
    """Return a printer of text as wide as the terminal."""

    def show(result: DescribedResult, arguments: Arguments) -> None:
        print_document(result.describe(**_place_folder(folder, arguments), **options))

    return show


def print_markdown(folder: FolderOf | None = None, name: str = "", **options: object) -> Show:
    """Return a printer of Markdown; `name` is a field that its document names, if it has one."""

    def show(result: DescribedResult, arguments: Arguments) -> None:
        # A report of several models names each of them.
        name_option = {name: str(getattr(result, name, ""))} if name else {}
        document = result.describe(**_place_folder(folder, arguments), **name_option, **options)
        echo(render_markdown(document))

    return show


def report_formats(folder: FolderOf | None = None) -> Mapping[str, Show]:
    """Return the printers of a report, by format; its document may name its folder."""
    return {
        "text": print_text(folder),
        "json": print_report_json,
        "markdown": print_markdown(folder),
    }


def formats_by_type(formats: Mapping[str, Mapping[str, Show]]) -> Mapping[str, Show]:
    """Return the printers of a command that returns results of several types, by format.

    Args:
        formats: printers by format, for the name of each type. The first type has all formats;
            another one is printed as text in those that it lacks.
    """

    def print_result(form: str, result: object, arguments: Arguments) -> None:
        own = formats[type(result).__name__]
        own.get(form, own["text"])(result, arguments)

    return {form: partial(print_result, form) for form in next(iter(formats.values()))}


def _place_folder(folder: FolderOf | None, arguments: Arguments) -> Mapping[str, Path]:
    return {"folder": folder(arguments)} if folder else {}
