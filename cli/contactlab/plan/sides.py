"""The sides of a boundary that runs lie on: labels, outcomes, requirements, limits of metrics."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence

from contactlab.errors import suggestion
from contactlab.expression import Expression, ExpressionError
from contactlab.plan.rows import SweepContext
from contactlab.plan.yaml_document import KeyPath, Place
from contactlab.schema.setting_values import SI_UNITS

Side = Callable[[Mapping[str, object]], object]
"""Returns the side of a boundary that a run lies on, from its row."""
FAILED = "failed"
_STABLE = "stable"
_COMPARISON = re.compile(r"[<>=!]")
_UNITS = "|".join(sorted(map(re.escape, SI_UNITS), key=len, reverse=True))
_AMOUNT = re.compile(rf"(?<![\w.])(\d*\.?\d+(?:e[-+]?\d+)?)\s*(%|(?:{_UNITS})(?![\w/]))")


def side_of(where: str, required: frozenset[str]) -> Side:
    """Return what tells the runs on both sides of a boundary apart.

    `required` are the labels of runs that do not do what `must` says.
    """
    match where:
        case "label":
            return lambda row: row["label"]
        case "outcome":
            return lambda row: row["label"] == _STABLE
        case "must":
            return lambda row: required.isdisjoint(_labels(row))
        case _:
            expression = read_limit(where)

    def side(row: Mapping[str, object]) -> object:
        if any(row.get(name) is None for name in expression.names):
            return None
        return bool(expression.evaluate(row))

    return side


def counted(share: str, required: frozenset[str]) -> Side:
    """Return whether a run counts for a share; one that could not be measured does.

    It is `failed`, `must` of runs that do not do what the sweep asks for, a label, be it beside a
    worse one, or a limit of metrics. `required` is as of `side_of`.
    """
    match share:
        case "failed":
            return lambda row: row["label"] != _STABLE
        case "must":
            return lambda row: not required.isdisjoint(_labels(row))
        case word if word.isidentifier():
            return lambda row: word in _labels(row)
        case _:
            beyond = side_of(share, required)
            return lambda row: beyond(row) is not False


def read_by(where: str) -> tuple[str, ...]:
    """Return the names of a row's fields that tell on which side it lies, or whether it counts."""
    return ("label", "labels") if where.isidentifier() else read_limit(where).names


def _labels(row: Mapping[str, object]) -> Collection[object]:
    labels = row["labels"]
    assert isinstance(labels, Collection)
    return labels


def read_limit(text: str) -> Expression:
    """Return a limit of metrics, such as `slip_distance > 1mm`, in the metrics' own units.

    Raises an ExpressionError if it is none; its places are those of the text in SI.
    """
    return Expression(_AMOUNT.sub(_in_si, text))


def _in_si(amount: re.Match[str]) -> str:
    size = 0.01 if amount[2] == "%" else SI_UNITS[amount[2]][1]
    return f"{float(amount[1]) * size:.12g}"


def check_asked(context: SweepContext, place: Place) -> None:
    """Add a mistake unless a sweep, or its scene, says of any run what it must do."""
    sweep, asks = context.sweep, context.vocabulary.asks
    if not (asks or sweep.must or any(asked.must for asked in sweep.expect)):
        message, hint = (
            "neither the sweep nor its scene says of any run what it must do",
            "add must: [...], such as still(BODY)",
        )
        context.document.add("not-asked", place, message, hint)


def check_limit(
    context: SweepContext, text: str, path: KeyPath, words: Sequence[str], others: str = ""
) -> None:
    """Add the mistakes of a limit of metrics, unless it is one of some words.

    `others` says what else may be written.
    """
    document, metrics = context.document, context.vocabulary.metrics
    place = document.value(path)
    known = f"{', '.join(words)}{others}"
    if text == "must":
        check_asked(context, place)
    if text in words:
        return
    try:
        expression = read_limit(text)
    except ExpressionError as error:
        hint = f"write {known}, or METRIC > VALUE"
        document.add("bad-expression", place, str(error), hint)
        return
    unknown = [name for name in expression.names if name not in metrics]
    for name in unknown:
        near = [*words, *metrics] if text == name else metrics
        hint = suggestion(name, near) or "`contactlab list metrics` has them all"
        document.add("unknown-metric", place, f"unknown metric '{name}'", hint)
    if not unknown and not _COMPARISON.search(text):
        message = f"'{text}' has no limit that runs could lie on both sides of"
        document.add("no-limit", place, message, f"write {text} > VALUE, or {known}")
