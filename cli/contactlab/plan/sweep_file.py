"""From a sweep file and the options of the command line to a plan, or to all mistakes at once."""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from contactlab.errors import SceneError, SweepFileError
from contactlab.plan.axis_values import read_blocks
from contactlab.plan.conditions import read_condition
from contactlab.plan.diagnostics import Diagnostic, Place, SourceText, SweepMistakesError
from contactlab.plan.grid import MOST_RUNS, Block, Grid, Match, Plan, RowValues, SweptAxis
from contactlab.plan.included_rows import read_rows
from contactlab.plan.names import SweepContext, check_names
from contactlab.plan.overrides import Filter, Overrides, apply_settings, check_values, read_filters
from contactlab.plan.validation import Draft, add_validation_errors, read_draft
from contactlab.plan.yaml_document import Document, data_document, read_document
from contactlab.schema import Condition, Expectation, Role, Sweep, Vocabulary, axis_role, switches

_NONE = Overrides()


@dataclass(frozen=True)
class SweepFile:
    """A sweep file that was read without mistakes.

    Attributes:
        path: where it lies; None if it was given as text or data.
        text: as written; JSON if it was given as data.
        sweep: what it says, options of the command line included.
        plan: the runs it asks for.
    """

    path: Path | None
    text: str
    sweep: Sweep
    plan: Plan


def read_sweep(
    source: Path | str | Mapping[str, object],
    vocabulary: Callable[[str], Vocabulary],
    overrides: Overrides = _NONE,
) -> SweepFile:
    """Read and check a sweep file, with the options of the command line.

    Args:
        source: its path, its text, or what it says as data that JSON can hold.
        vocabulary: gives the names that a scene offers; may raise SceneError.
        overrides: options of the command line.

    Raises:
        SweepFileError: the file cannot be read, or (as SweepMistakesError, with all of them as
            data) it or the options hold mistakes.
    """
    path = source if isinstance(source, Path) else None
    if isinstance(source, Mapping):
        text = json.dumps(source, indent=1)
        document = data_document(json.loads(text), "sweep")
    else:
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
        context = SweepContext(draft, vocabulary(str(document.mapping()["scene"])))
    except SceneError as error:
        document.add("unknown-scene", ("scene",), *_first_line(error))
        return None
    check_names(context)
    parts = read_sections(context, folder)
    filters = read_filters(context, overrides.only, parts.names)
    if document.has_errors:
        return None
    return make_plan(context, parts, filters, overrides.limit)


def _first_line(error: SceneError) -> tuple[str, str]:
    first, _, rest = str(error).partition("\n")
    return first, rest.replace("\n", "; ")


@dataclass(frozen=True)
class SweepSections:
    """The sections of a file that make its runs.

    Attributes:
        names: every axis that a run may carry, effects included.
        blocks: factors of the product; None where the file only lists rows.
        added: rows to include.
        excludes: conditions on rows to leave out.
        expected: conditions of `expect`, with what they ask for.
        base: settings of every run.
    """

    names: tuple[str, ...]
    blocks: tuple[Block, ...] | None
    added: tuple[RowValues, ...]
    excludes: tuple[Match, ...]
    expected: tuple[tuple[Match, Expectation], ...]
    base: RowValues

    def values(self) -> dict[str, dict[object, None]]:
        """Return the values that each axis takes anywhere, each once, in order."""
        found: dict[str, dict[object, None]] = {}
        for block in self.blocks or ():
            for name, column in zip(block.names, zip(*block.rows, strict=True), strict=False):
                found[name] = dict.fromkeys(column)
        for row in (self.base, *self.added):
            for name, value in row.items():
                found.setdefault(name, {})[value] = None
        return found


def read_sections(context: SweepContext, folder: Path) -> SweepSections:
    """Read the sections of a file; add their mistakes to the document.

    Args:
        context: the file and its names.
        folder: what the path of a table of rows is relative to.
    """
    sweep = context.sweep
    blocks, added = read_blocks(context), read_rows(context, folder)
    base = {
        name: context.canonical(name, value, context.document.value(("effects", name)))
        for name, value in switches(sweep.effects).items()
    }
    product = tuple(dict.fromkeys([*(name for name, _ in context.swept()), *base]))
    names = tuple(dict.fromkeys([*product, *(name for row in added for name in row)]))
    wheres = (each.where for each in sweep.expect)
    expected = _matches(context, "expect", wheres, names, "where")
    excludes = _matches(context, "exclude", sweep.exclude, product)
    pairs = tuple(zip(expected, sweep.expect, strict=True))
    return SweepSections(names, blocks, added, excludes, pairs, base)


def _matches(
    context: SweepContext,
    key: str,
    conditions: Iterable[Condition],
    names: tuple[str, ...],
    *below: str,
) -> tuple[Match, ...]:
    return tuple(
        read_condition(context, condition, context.draft.path(key, index, *below), names)
        for index, condition in enumerate(conditions)
    )


def make_plan(
    context: SweepContext, parts: SweepSections, filters: Sequence[Filter], limit: int | None
) -> Plan | None:
    """Return the plan of a file without mistakes, or None if planning finds some.

    Raises:
        SweepMistakesError: an expression cannot be computed for some row.
    """
    document, sweep = context.document, context.sweep
    values = parts.values()
    for match, _ in parts.expected:
        _warn_unmet(document, match, values)
    check_values(document, filters, values)
    if document.has_errors:
        return None
    left = parts
    for each in filters:
        left = _filtered(left, each)
    grid = Grid(left.base, left.blocks, left.excludes, left.added)
    runs = _count(document, grid, len(sweep.seed_values), limit, warn=not filters)
    if runs is None:
        return None
    warnings = tuple(each for each in document.found if each.severity == "warning")
    return Plan(sweep, _axes(sweep, left), runs, warnings, grid, parts.expected)


def _filtered(parts: SweepSections, each: Filter) -> SweepSections:
    rows = (row for row in parts.added if (parts.base | row).get(each.name) in each.values)
    blocks = parts.blocks
    if blocks is not None:
        in_block = any(each.name in block.names for block in blocks)
        if in_block:
            blocks = tuple(_filtered_block(block, each) for block in blocks)
        elif parts.base.get(each.name) not in each.values:
            blocks = None
    return replace(parts, blocks=blocks, added=tuple(rows))


def _filtered_block(block: Block, each: Filter) -> Block:
    if each.name not in block.names:
        return block
    index = block.names.index(each.name)
    return Block(block.names, tuple(row for row in block.rows if row[index] in each.values))


def _count(
    document: Document, grid: Grid, seeds: int, limit: int | None, *, warn: bool
) -> int | None:
    """Return the number of runs, or None if there are none or too many."""
    if limit is not None and limit < 1:
        place = Place(SourceText("command line", (f"--limit {limit}",), numbered=False), 1, 9, 9)
        document.add("bad-option", place, "the limit is at least 1 run")
        return None
    most = math.inf if limit is None else limit
    if grid.excludes and grid.product_size > MOST_RUNS:
        return _add_too_many(document, grid.product_size, "rows before `exclude`")
    rows, unmet = grid.count(most / seeds)
    runs = int(min(rows * seeds, most))
    if runs > MOST_RUNS:
        return _add_too_many(document, runs, "runs")
    for match in unmet if warn else ():
        document.add("unmatched-exclude", match.place, "excludes no run", severity="warning")
    if rows == 0:
        document.add("no-runs", document.key(("exclude",)), "no runs are left")
    return runs or None


def _add_too_many(document: Document, count: int, what: str) -> None:
    message = f"{count:,} {what}; a sweep takes at most {MOST_RUNS:,}"
    document.add("too-many-runs", document.key(("axes",)), message, "use `sample` or fewer values")


def _warn_unmet(
    document: Document, match: Match, values: Mapping[str, Mapping[object, None]]
) -> None:
    for name, value in match.settings:
        if value not in values.get(name, ()):
            message = f"no run has {name} = {value}, so nothing is expected here"
            document.add("unmatched-expect", match.place, message, severity="warning")


def _axes(sweep: Sweep, parts: SweepSections) -> tuple[SweptAxis, ...]:
    roles: dict[str, Role] = {}
    for axes in (sweep.axes, *sweep.zip):
        roles |= {name: axis_role(axis) for name, axis in axes.items()}
    return tuple(
        SweptAxis(name, roles.get(name, "knob"), tuple(values))
        for name, values in parts.values().items()
        if name not in parts.base
    )


_Kind = TypeVar("_Kind", bound=BaseModel)


def read_yaml_as(path: Path, kind: type[_Kind]) -> _Kind:
    """Read a YAML file as a model.

    Raises:
        SweepFileError: it cannot be read, or (as SweepMistakesError, with all of them as data) it
            holds mistakes.
    """
    document = read_document(read_text(path), str(path))
    if not document.has_errors:
        try:
            return kind.model_validate(document.data)
        except ValidationError as error:
            add_validation_errors(document, error, kind)
    raise SweepMistakesError(document.found)
