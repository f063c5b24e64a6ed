"""From a sweep file and the options of the command line to a plan, or to all mistakes at once."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import SceneError, SweepFileError
from contactlab.plan.diagnostic import Diagnostic, SweepMistakesError
from contactlab.plan.document import Document, read_document
from contactlab.plan.draft import Draft, read_draft
from contactlab.plan.making import made_plan
from contactlab.plan.names import Context, check_names
from contactlab.plan.override import Overrides, apply_settings, read_filters
from contactlab.plan.parts import read_parts
from contactlab.plan.plan import Plan
from contactlab.schema import Sweep, Vocabulary

_NONE = Overrides()


@dataclass(frozen=True)
class SweepFile:
    """A sweep file that was read without mistakes.

    Attributes:
        path: where it lies; None if it was given as text.
        text: as written.
        sweep: what it says, options of the command line included.
        plan: the runs it asks for.
    """

    path: Path | None
    text: str
    sweep: Sweep
    plan: Plan


def read_sweep(
    source: Path | str,
    vocabulary: Callable[[str], Vocabulary],
    overrides: Overrides = _NONE,
) -> SweepFile:
    """Read a sweep file.

    Args:
        source: its path, or its text.
        vocabulary: gives the names that a scene offers; may raise SceneError.
        overrides: options of the command line.

    Raises:
        SweepFileError: the file cannot be read, or (as SweepMistakesError, with all of them as
            data) it or the options hold mistakes.
    """
    path = source if isinstance(source, Path) else None
    text = read_text(path) if path else str(source)
    document = read_document(text, str(path) if path else "sweep")
    if document.found and document.data is None:
        raise SweepMistakesError(document.found)
    if isinstance(document.data, dict):
        apply_settings(document, overrides.assign)
    draft = read_draft(document)
    plan = _checked(draft, vocabulary, overrides, path.parent if path else Path())
    if plan is None or document.has_errors:
        raise SweepMistakesError(_sorted(document))
    return SweepFile(path, text, draft.sweep, plan)


def read_text(path: Path) -> str:
    """Return a file's text.

    Raises:
        SweepFileError: it cannot be read, or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise SweepFileError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SweepFileError(f"cannot read {path}: it is not UTF-8 text") from error


def _sorted(document: Document) -> list[Diagnostic]:
    """Return all mistakes, those of the file first, each source's in the order of their places."""

    def position(each: Diagnostic) -> tuple[bool, str, str, int, int]:
        source, place = each.place.source, each.place
        argument = "" if source.numbered else place.text
        return source is not document.source, source.name, argument, place.line, place.column

    return sorted(document.found, key=position)


def _checked(
    draft: Draft,
    vocabulary: Callable[[str], Vocabulary],
    overrides: Overrides,
    folder: Path,
) -> Plan | None:
    """Check the names and values of a draft; returns its plan if there are no mistakes."""
    if not draft.has_scene:
        return None
    document = draft.document
    try:
        context = Context(draft, vocabulary(str(document.mapping()["scene"])))
    except SceneError as error:
        document.add("unknown-scene", ("scene",), *_first_line(error))
        return None
    check_names(context)
    parts = read_parts(context, folder)
    filters = read_filters(context, overrides.only, parts.names)
    if document.has_errors:
        return None
    return made_plan(context, parts, filters, overrides.limit)


def _first_line(error: SceneError) -> tuple[str, str]:
    first, _, rest = str(error).partition("\n")
    return first, rest.replace("\n", "; ")
