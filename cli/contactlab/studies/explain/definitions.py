"""Definitions of every word that contactlab prints, each from the place that computes it."""

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from typing import Any, NamedTuple

from contactlab import resources
from contactlab.engines import ENGINES
from contactlab.engines.engine import SimulationEngine
from contactlab.errors import SweepFileError
from contactlab.measure import LABELS, METRICS, ORACLES, THRESHOLDS, Label, Metric, Threshold
from contactlab.measure.entries import SEVERITIES, Oracle
from contactlab.mjcf import CONTACT, OPTIONS
from contactlab.modifications.catalogue import list_rows
from contactlab.modifications.modification import Row
from contactlab.modifications.numerics import RUN
from contactlab.plan.mistakes import MISTAKES
from contactlab.scene.effects.effect import Effect
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.parameters import PARAMETERS, Parameter
from contactlab.scene.scene_source import find_scene
from contactlab.schema.explanation import WordMeaning
from contactlab.store.table_layout import FIXED_COLUMNS, LOOP_COLUMNS, PLUGINS_COLUMN, Column
from contactlab.studies.check.check_entries import CHECKS, Check
from contactlab.studies.explain.glossary import Term, read_glossary
from contactlab.studies.lint.rules import RULES, Rule

Definitions = Mapping[str, list[Callable[[], Iterator[str]]]]
"""Lines of text by word: one entry for each meaning of the word."""

_COLUMNS = (*FIXED_COLUMNS, PLUGINS_COLUMN, *LOOP_COLUMNS)
_UNIT = re.compile(r"\s*\[.*\]$")


def is_defined(word: str) -> bool:
    """Return whether a word has a definition."""
    return _find_meanings(word) is not None


def _find_meanings(word: str) -> list[Callable[[], Iterator[str]]] | None:
    # Names of fixes have hyphens, terms have spaces.
    key = _definition_key(word)
    keys = (key, key.replace("-", "_"), key.replace("-", " "))
    known, axes = _collect_definitions(), _scene_axes()
    meanings = ([*known.get(key, ()), *axes.get(key, ())] for key in keys)
    return next(filter(None, meanings), None)


def define_word(word: str) -> tuple[WordMeaning, ...]:
    """Return every meaning of a word.

    Case does not matter, nor does a unit in brackets, as in `depth [m]`.

    Raises:
        SweepFileError: the word has no definition; the message suggests the nearest one.
    """
    meanings = _find_meanings(word)
    if meanings is None:
        SweepFileError.unless_known(
            _definition_key(word),
            [*_collect_definitions(), *_scene_axes()],
            f"'{word}' has no definition",
            "; `contactlab list` shows all names, docs/reference/glossary.md all terms",
        )
    return tuple(
        WordMeaning(word=word, title=title, texts=tuple(texts))
        for title, *texts in (lines() for lines in meanings or ())
    )


def words_of(names: list[str]) -> list[str]:
    """Return the terms that a command line names: all of its words together, if that is a term."""
    together = " ".join(names)
    return [together] if is_defined(together) else names


def _definition_key(word: str) -> str:
    return " ".join(_UNIT.sub("", word).split()).casefold()


def _collect_definitions() -> Definitions:
    # Those of a word are in the order of their importance.
    definitions: dict[str, list[Callable[[], Iterator[str]]]] = {}
    for kind in _list_kinds():
        for name, entry in kind.entries.items():
            definitions.setdefault(_definition_key(name), []).append(partial(kind.lines, entry))
    for term in read_glossary():
        for word in (term.word, *term.synonyms):
            definitions.setdefault(_definition_key(word), []).append(partial(_term_lines, term))
    return definitions


class _Kind(NamedTuple):
    title: str
    entries: Mapping[str, Any]
    lines: Callable[[Any], Iterator[str]]


def _list_kinds() -> tuple[_Kind, ...]:
    headed = {metric.heading: metric for metric in METRICS.values() if metric.heading}
    known_names = LABELS.keys() | METRICS.keys()
    limits = {name: each for name, each in THRESHOLDS.items() if name not in known_names}
    rows = {row.name: row for row in (RUN, *list_rows())}
    columns = {column.name: column for column in _COLUMNS}
    severities = {name: (name, text) for name, text in SEVERITIES.items()}
    mistakes = {name: (name, text) for name, text in MISTAKES.items()}
    return (
        _Kind("labels", LABELS, _label_lines),
        _Kind("metrics", METRICS, _metric_lines),
        _Kind("headings of metrics", headed, _heading_lines),
        _Kind("limits", limits, _threshold_lines),
        _Kind("axes", PARAMETERS, _axis_lines),
        _Kind("effects", EFFECTS, _effect_lines),
        _Kind("rows of the error budget", rows, _row_lines),
        _Kind("checks", CHECKS, _check_lines),
        _Kind("rules of lint", RULES, _rule_lines),
        _Kind("oracles", ORACLES, _oracle_lines),
        _Kind("engines", ENGINES, _engine_lines),
        _Kind("severities", severities, _severity_lines),
        _Kind("mistakes", mistakes, _mistake_lines),
        _Kind("columns of runs.parquet", columns, _column_lines),
    )


def list_words() -> tuple[WordMeaning, ...]:
    """Return all words with a definition, by their kind."""
    words = {kind.title: [*kind.entries] for kind in _list_kinds()}
    words["axes of shipped scenes"] = [*_scene_axes()]
    words["terms"] = [term.word for term in read_glossary()]
    return tuple(
        WordMeaning(word=title, title=title, texts=(", ".join(dict.fromkeys(names)),))
        for title, names in words.items()
    )


@cache
def _scene_axes() -> Definitions:
    # Axes that shipped scenes add, such as `drop_height`.
    definitions: dict[str, list[Callable[[], Iterator[str]]]] = {}
    for scene in resources.scene_names():
        manifest = find_scene(scene).manifest
        own = {} if manifest is None else {**manifest.initial, **manifest.structure}
        for name, axis in own.items():
            text = (f"{name} [{axis.unit}]: an axis of the scene {scene}", axis.description)
            definitions.setdefault(_definition_key(name), []).append(lambda text=text: iter(text))
    return definitions


def _label_lines(label: Label) -> Iterator[str]:
    place = list(LABELS).index(label.name) + 1
    yield (
        f"{label.name}: a label; severity {label.severity}, rank {place} of {len(LABELS)}, where "
        "1 is the worst"
    )
    yield label.meaning
    for threshold in label.thresholds:
        yield _limit_line(threshold)
    yield f"change: {label.advice or 'see the reason in the run'}"


def _limit_line(threshold: Threshold) -> str:
    default = "none" if threshold.default is None else f"{threshold.default:g} {threshold.unit}"
    return f"limit {threshold.name}: {default.removesuffix(' 1')}. {threshold.source}"


def _metric_lines(metric: Metric) -> Iterator[str]:
    better = {"none": "neither way is better"}.get(metric.better, f"{metric.better} is better")
    yield f"{metric.name} [{metric.unit}]: a metric, version {metric.version}; {better}"
    yield metric.definition
    limits = [
        (threshold, label)
        for label in LABELS.values()
        for threshold in label.thresholds
        if threshold.name == metric.name
    ]
    yield from dict.fromkeys(_limit_line(threshold) for threshold, _ in limits)
    labels = [label for _, label in limits]
    if len(labels) == 1:
        yield f"over it, a run is {labels[0].name}: {labels[0].advice or labels[0].meaning}"
    elif labels:
        names = ", ".join(label.name for label in labels)
        yield f"labels that read it: {names}; `contactlab explain LABEL` has the change of each"


def _heading_lines(metric: Metric) -> Iterator[str]:
    yield f"{metric.heading}: heading of {metric.name} in the table of runs"
    yield metric.definition


def _threshold_lines(threshold: Threshold) -> Iterator[str]:
    labels = [label.name for label in LABELS.values() if threshold in label.thresholds]
    yield f"{threshold.name}: a limit of {', '.join(labels)}"
    yield _limit_line(threshold)


def _axis_lines(axis: Parameter) -> Iterator[str]:
    yield f"{axis.name}{f' [{axis.unit}]' if axis.unit else ''}: an axis, {axis.description}"
    if axis.choices:
        yield f"values: {', '.join(axis.choices)}"
    if axis.parts:
        yield f"its numbers, as axes of their own: {', '.join(axis.parts)}"
    if axis.conflicts:
        yield f"not together with: {', '.join(axis.conflicts)}"
    where = "<option>" if axis.sets in OPTIONS else "<geom> and <pair>"
    if axis.sets in {*OPTIONS, *CONTACT}:
        yield f"in MJCF: {axis.sets} of {where}"


def _effect_lines(effect: Effect) -> Iterator[str]:
    yield f"{effect.name}: an effect, {effect.kind}: {effect.what}"
    if effect.called_by:
        yield f"called for by {effect.called_by}"
    yield "as an axis: true or false; `contactlab effects MODEL` measures whether it matters"


_ROW_KINDS = {
    "numerics": "a numerical setting",
    "model": "a modeling choice",
    "effect": "an effect that is left out",
    "unknown": "an uncertain parameter",
}


def _row_lines(row: Row) -> Iterator[str]:
    yield f"{row.name}: a row of the error budget, {_ROW_KINDS.get(row.kind, row.kind)}"
    yield f"It measures how the motion changes with {row.summary}."


def _check_lines(check: Check) -> Iterator[str]:
    yield f"{check.name}: a check of an examination"
    yield f"It passes if {check.question}."


def _rule_lines(rule: Rule) -> Iterator[str]:
    yield f"{rule.name}: a rule of `contactlab lint`"
    yield f"{rule.about} {rule.details}"


def _oracle_lines(oracle: Oracle) -> Iterator[str]:
    yield f"{oracle.name}: an oracle, the closed form of a scene"
    yield oracle.definition


def _engine_lines(engine: SimulationEngine) -> Iterator[str]:
    yield f"{engine.name}: an engine, {engine.summary}"


def _severity_lines(severity: tuple[str, str]) -> Iterator[str]:
    name, meaning = severity
    yield f"{name}: a severity of labels"
    yield f"{meaning[:1].upper()}{meaning[1:]}."


def _mistake_lines(mistake: tuple[str, str]) -> Iterator[str]:
    name, sentence = mistake
    yield f"{name}: a mistake in a sweep file or an option"
    yield sentence


def _column_lines(column: Column) -> Iterator[str]:
    unit = f" [{column.unit}]" if column.unit else ""
    yield f"{column.name}{unit}: a column of runs.parquet"
    yield column.description


def _term_lines(term: Term) -> Iterator[str]:
    yield f"{term.word}: {term.context}"
    yield term.definition
