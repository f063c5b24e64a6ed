"""`contactlab metrics` and `contactlab labels`: what is measured, and what it is called."""

from collections.abc import Sequence

from contactlab.commands.output import Format, FormatOption, print_json, print_table


def metrics(output: FormatOption = Format.text) -> None:
    """List every metric: unit, direction, version and definition."""
    from contactlab.measure import METRICS

    keys = ("metric", "unit", "better", "version", "definition")
    rows = [
        (each.name, each.unit, each.better, each.version, each.definition)
        for each in METRICS.values()
    ]
    _print(keys, rows, output)


def labels(output: FormatOption = Format.text) -> None:
    """List every label, worst first, with its meaning and the thresholds that it reads."""
    from contactlab.measure import LABELS

    rows = [(each.name, each.meaning, ", ".join(each.thresholds)) for each in LABELS.values()]
    _print(("label", "meaning", "thresholds"), rows, output)


def thresholds(output: FormatOption = Format.text) -> None:
    """List every threshold that a scene or a sweep may set, with its default and source."""
    from contactlab.measure import THRESHOLDS

    rows = [(each.name, each.default, each.unit, each.source) for each in THRESHOLDS.values()]
    _print(("threshold", "default", "unit", "source"), rows, output)


def _print(keys: tuple[str, ...], rows: Sequence[Sequence[object]], output: Format) -> None:
    if output is Format.json:
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    else:
        print_table(keys, rows)
