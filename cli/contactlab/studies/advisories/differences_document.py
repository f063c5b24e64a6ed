"""Describes the differences of two releases: one row for each cause."""

from contactlab.rendering.document import (
    Document,
    Headline,
    Items,
    Sentence,
    document_of,
    table_of,
)
from contactlab.schema.differences_report import DifferencesReport


def describe_differences(report: DifferencesReport) -> Document:
    """Describe the differences by stage, and the models that were not compared."""
    most_named = 3
    rows = [
        (
            group.stage,
            group.quantity,
            f"fault in {group.faulty}" if group.faulty else "change",
            len(group.models),
            ", ".join(group.models[:most_named]),
            group.first,
            group.second,
            group.bodies,
            group.draft.rpartition("/")[2],
            ", ".join(group.listed),
        )
        for group in report.groups
    ]
    heads = ("stage", "quantity", "judged as", "models", "such as", *report.releases)
    refused = tuple(f"{each.model}: {each.reason}" for each in report.refused)
    return document_of(
        [
            Headline(report.headline),
            Sentence(f"{report.states} states, each with a window of steps under both releases"),
            table_of((*heads, "bodies", "draft", "listed as"), rows),
            *([Items(refused, "not compared")] if refused else []),
        ]
    )
