"""Describes meanings of words."""

from contactlab.rendering.document import Document, Headline, Items, Section, document_of
from contactlab.schema.explanation import Explanation


def describe_explanation(report: Explanation) -> Document:
    """Describe an explanation: each meaning with its definition, limits, values and advice."""
    return document_of(
        *(
            Section((Headline(one.title), *((Items(one.texts),) if one.texts else ())), "meaning")
            for one in report.meanings
        )
    )
