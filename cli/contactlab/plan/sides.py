"""The sides of a boundary between runs: labels, outcomes, requirements, limits of metrics."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence

from contactlab.errors import suggestion
from contactlab.expression import Expression, ExpressionError
from contactlab.plan.rows import SweepContext
from contactlab.plan.yaml_document import KeyPath, Place
from contactlab.schema.setting_values import SI_UNITS

Side = Callable[[Mapping[str, object]], object]
"""Returns the side of a boundary that a run is on, from its row."""
FAILED = "failed"
_STABLE_LABEL = "stable"
_COMPARISON_PATTERN = re.compile(r"[<>=!]")
_UNIT_PATTERN = "|".join(sorted(map(re.escape, SI_UNITS), key=len, reverse=True))
_AMOUNT_PATTERN = re.compile(
    rf"(?<![\w.])(\d*\.?\d+(?:e[-+]?\d+)?)\s*(%|(?:{_UNIT_PATTERN})(?![\w/]))"
)


def side_of(where: str, required: frozenset[str]) -> Side:
    """Return a function that distinguishes the runs on both sides of a boundary.

    `required` are the labels of runs that violate the requirements in `must`.
    """
    match where:
        case "label":
            return lambda row: row["label"]
        case "outcome":
            return lambda row: row["label"] == _STABLE_LABEL
        case "must":
            return lambda row: required.isdisjoint(_all_labels(row))
        case _:
            expression = read_limit(where)

    def side(row: Mapping[str, object]) -> object:
        if any(row.get(name) is None for name in expression.names):
            return None
        return bool(expression.evaluate(row))

    return side


def counts_for_share(share: str, required: frozenset[str]) -> Side:
    """Return a function that decides whether a run counts for a share; an unmeasured one counts.

    The share is `failed`, `must` for runs that violate requirements, a label, even of a run with a
    worse label, or a limit of metrics. `required` is as in `side_of`.
    """
    match share:
        case "failed":
            return lambda row: row["label"] != _STABLE_LABEL
        case "must":
            return lambda row: not required.isdisjoint(_all_labels(row))
        case word if word.isidentifier():
            return lambda row: word in _all_labels(row)
        case _:
            beyond = side_of(share, required)
            return lambda row: beyond(row) is not False


def fields_read_by(where: str) -> tuple[str, ...]:
    """Return the fields of a row that decide its side, or whether it counts."""
    return ("label", "labels") if where.isidentifier() else read_limit(where).names


def _all_labels(row: Mapping[str, object]) -> Collection[object]:
    labels = row["labels"]
    assert isinstance(labels, Collection)
    return labels


def read_limit(text: str) -> Expression:
    """Return a limit of metrics, such as `slip_distance > 1mm`, in the metrics' own units.

    Raises an ExpressionError for any other text; its places are those of the text in SI.
    """
    return Expression(_AMOUNT_PATTERN.sub(_amount_in_si, text))


def _amount_in_si(amount: re.Match[str]) -> str:
    size = 0.01 if amount[2] == "%" else SI_UNITS[amount[2]][1]
    return f"{float(amount[1]) * size:.12g}"


def check_asked(context: SweepContext, place: Place) -> None:
    """Add a mistake unless a sweep, or its scene, has a requirement of some run."""
    sweep, asks = context.sweep, context.vocabulary.asks
    if not (asks or sweep.must or any(expectation.must for expectation in sweep.expect)):
        message, hint = (
            "neither the sweep nor its scene has requirements of any run",
            "add must: [...], such as still(BODY)",
        )
        context.document.add_mistake("not-asked", place, message, hint)


def check_limit(
    context: SweepContext, text: str, path: KeyPath, words: Sequence[str], others: str = ""
) -> None:
    """Add the mistakes of a limit of metrics, unless it is one of some words.

    `others` names the other allowed texts.
    """
    document, metrics = context.document, context.vocabulary.metrics
    place = document.value_place(path)
    known_words = f"{', '.join(words)}{others}"
    if text == "must":
        check_asked(context, place)
    if text in words:
        return
    try:
        expression = read_limit(text)
    except ExpressionError as error:
        hint = f"write {known_words}, or METRIC > VALUE"
        document.add_mistake("bad-expression", place, str(error), hint)
        return
    unknown = [name for name in expression.names if name not in metrics]
    for name in unknown:
        near = [*words, *metrics] if text == name else metrics
        hint = suggestion(name, near) or "`contactlab list metrics` has them all"
        document.add_mistake("unknown-metric", place, f"unknown metric '{name}'", hint)
    if not unknown and not _COMPARISON_PATTERN.search(text):
        message = f"'{text}' has no limit with runs on both sides"
        document.add_mistake("no-limit", place, message, f"write {text} > VALUE, or {known_words}")
