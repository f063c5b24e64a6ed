"""From a sweep file and the options of the command line to a plan, or to all mistakes at once."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

from pydantic import BaseModel, ValidationError

from contactlab.errors import SceneError
from contactlab.plan.diagnostics import Diagnostic, Place, SourceText, SweepMistakesError
from contactlab.plan.grid import MOST_RUNS, Grid, Plan, SweptAxis
from contactlab.plan.included_rows import read_rows
from contactlab.plan.kept_traces import with_default_traces
from contactlab.plan.names import check_drive, check_names, read_condition
from contactlab.plan.overrides import Filter, Overrides, apply_settings, check_values, read_filters
from contactlab.plan.refined_axes import check_refine, write_out_refined
from contactlab.plan.rows import SweepContext, read_blocks, write_out_units
from contactlab.plan.sampled_shares import check_until
from contactlab.plan.search import check_choices, check_search, write_out_searched
from contactlab.plan.validation import Draft, add_validation_errors, read_draft
from contactlab.plan.yaml_document import Document, open_document, read_document, read_text
from contactlab.schema.evidence import ERRORS, Accuracy
from contactlab.schema.sweep_schema import Sweep, effect_switches, scene_reference
from contactlab.schema.vocabulary import Vocabulary

_NONE = Overrides()


@dataclass(frozen=True)
class SweepFile:
    """A sweep file that was read without mistakes, and its content with all options.

    It has no path if it was given as text or data. The text of data is JSON.
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
    """Read and check a sweep file, as a path, text or JSON data, with options of the command line.

    The vocabulary has the names of a scene, unless it raises SceneError. A SweepFileError says that
    the file cannot be read or, as SweepMistakesError, has all mistakes as data.
    """
    path, document = source if isinstance(source, Path) else None, open_document(source)
    if document.mistakes and document.data is None:
        raise SweepMistakesError(document.mistakes)
    if isinstance(document.data, dict):
        apply_settings(document, overrides.assign)
        write_out_refined(document)
        write_out_searched(document)
        of_axis = partial(_unit_of, document, vocabulary)
        write_out_units(document, of_axis, partial(_unit_of_metric, document, vocabulary))
    draft = read_draft(document)
    plan = _check_draft(draft, vocabulary, overrides, path.parent if path else Path())
    if plan is None or document.has_errors:
        raise SweepMistakesError(_sort_mistakes(document))
    return SweepFile(path, document.text, draft.sweep, plan)


def _unit_of(document: Document, vocabulary: Callable[[str], Vocabulary], axis: str) -> str:
    names = _read_vocabulary(document, vocabulary)
    spec = names.find(axis) if names else None
    return spec.unit if spec else ""


def _unit_of_metric(document: Document, vocabulary: Callable[[str], Vocabulary], name: str) -> str:
    if name in ERRORS:
        return cast("dict[str, str]", Accuracy.model_fields[name].json_schema_extra)["unit"]
    names = _read_vocabulary(document, vocabulary)
    return names.units.get(name, "") if names else ""


def _read_vocabulary(
    document: Document, vocabulary: Callable[[str], Vocabulary]
) -> Vocabulary | None:
    scene = scene_reference(document.value_at(("scene",)))
    with suppress(SceneError):
        return vocabulary(scene) if isinstance(scene, str) else None
    return None


def _sort_mistakes(document: Document) -> list[Diagnostic]:
    # Those of the file come first, then by source, in the order of their places.
    def position(place: Place) -> tuple[bool, str, str, int, int]:
        source, argument = place.source, "" if place.source.numbered else place.text
        return source is not document.source, source.name, argument, place.line, place.column

    return sorted(document.mistakes, key=lambda mistake: position(mistake.place))


def _check_draft(
    draft: Draft, vocabulary: Callable[[str], Vocabulary], overrides: Overrides, folder: Path
) -> Plan | None:
    """Return the plan of a draft, or None after adding its mistakes to the document.

    A SweepMistakesError says that an expression cannot be computed for some row.
    """
    document, scene = draft.document, draft.scene
    if not isinstance(scene, str):
        return None
    try:
        names = vocabulary(scene)
        context = SweepContext(document, draft.sweep, scene, draft.kept_positions, names)
    except SceneError as error:
        first, *rest = map(str.strip, str(error).splitlines())
        document.add_mistake("unknown-scene", ("scene",), first, "; ".join(rest))
        return None
    check_drive(context)
    check_names(context)
    check_refine(context)
    check_until(context)
    check_search(context)
    check_choices(context)
    blocks, added = read_blocks(context), read_rows(context, folder)
    base = {
        name: context.canonical_value(name, value, document.value_place(("effects", name)))
        for name, value in effect_switches(draft.sweep.effects).items()
    }
    excludes = tuple(
        read_condition(
            context, condition, context.entry_path("exclude", index), _product_axes(context)
        )
        for index, condition in enumerate(draft.sweep.exclude)
    )
    grid = Grid(base, blocks, excludes, added)
    carried = tuple(dict.fromkeys([*_product_axes(context), *itertools.chain(*grid.included_rows)]))
    expected = tuple(
        (
            read_condition(
                context, expectation.where, draft.entry_path("expect", index, "where"), carried
            ),
            expectation,
        )
        for index, expectation in enumerate(draft.sweep.expect)
    )
    filters = read_filters(context, overrides.where, carried)
    if document.has_errors:
        return None
    for match, _ in expected:
        for name, value in match.settings:
            if value not in grid.axis_values(name):
                message = f"no run has {name} = {value}, so this applies to no run"
                document.add_mistake("unmatched-expect", match.place, message, severity="warning")
    check_values(document, filters, grid)
    _check_whole(context, filters, overrides.limit)
    if document.has_errors:
        return None
    # Keep the rows of the filters, and the scene as written in their scenarios.
    for condition in filters:
        grid = grid.filter_rows(condition.name, condition.values)
    grid = grid.with_baseline(draft.sweep.scenario) if draft.sweep.baseline else grid
    count = _count_runs(context, grid, overrides.limit, warn=not filters)
    if count is None:
        return None
    warnings = tuple(mistake for mistake in document.mistakes if mistake.severity == "warning")
    sweep = with_default_traces(draft.sweep, count)
    roles, names = sweep.roles, [name for name in grid.names if name not in grid.base]
    return Plan(
        sweep,
        tuple(SweptAxis(name, roles.get(name, "knob"), grid.axis_values(name)) for name in names),
        count,
        warnings,
        grid,
        expected,
    )


def _check_whole(context: SweepContext, filters: Sequence[Filter], limit: int | None) -> None:
    refine = context.sweep.refining
    if refine is None:
        return
    cuts = [condition.place for condition in filters if condition.name in refine.axes]
    cuts += [] if limit is None else [_of_limit(limit)]
    for place in cuts:
        message = "this would cut the grid that is refined"
        context.document.add_mistake(
            "bad-option", place, message, "leave it out, or give the axis other values by --set"
        )


def _of_limit(limit: int) -> Place:
    return Place(SourceText("command line", (f"--limit {limit}",), numbered=False), 1, 9, 9)


def _product_axes(context: SweepContext) -> tuple[str, ...]:
    axes = [name for name, _ in context.swept]
    return tuple(dict.fromkeys([*axes, *effect_switches(context.sweep.effects)]))


def _count_runs(context: SweepContext, grid: Grid, limit: int | None, *, warn: bool) -> int | None:
    document, seeds = context.document, len(context.sweep.seed_values)
    if limit is not None and limit < 1:
        document.add_mistake("bad-option", _of_limit(limit), "the limit must be at least 1 run")
        return None
    most = math.inf if limit is None else limit
    runs, what, unmet = grid.product_size, "rows before `exclude`", ()
    if not grid.excludes or runs <= MOST_RUNS:
        rows, unmet = grid.count_rows(most / seeds)
        runs, what = int(min(rows * seeds, most)), "runs"
    if runs > MOST_RUNS:
        message = f"{runs:,} {what}; a sweep takes at most {MOST_RUNS:,}"
        hint = "use `sample` or fewer values"
        document.add_mistake("too-many-runs", document.key_place(("axes",)), message, hint)
        return None
    for match in unmet if warn else ():
        document.add_mistake(
            "unmatched-exclude", match.place, "excludes no run", severity="warning"
        )
    if runs == 0:
        document.add_mistake(
            "no-runs", document.key_place(("exclude",)), "no runs are left", "exclude less"
        )
    return runs or None


_Kind = TypeVar("_Kind", bound=BaseModel)


def read_yaml_as(path: Path, kind: type[_Kind]) -> _Kind:
    """Read a YAML file as a model; raise SweepFileError with all mistakes that it holds."""
    document = read_document(read_text(path), str(path))
    if not document.has_errors:
        try:
            return kind.model_validate(document.data)
        except ValidationError as error:
            add_validation_errors(document, error, kind)
    raise SweepMistakesError(document.mistakes)
