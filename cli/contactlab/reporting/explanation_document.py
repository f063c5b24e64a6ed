"""Describes meanings of words, and contacts of a model in units of the world."""

from contactlab.rendering.document import (
    Block,
    Document,
    Facts,
    Headline,
    Items,
    Section,
    Sentence,
    document_of,
)
from contactlab.reporting.examination import grouped_contacts
from contactlab.schema.explanation import Explanation, WordMeaning


def describe_explanation(report: Explanation) -> Document:
    """Describe an explanation: its meanings, or a task and its contacts."""
    if not report.task:
        return document_of(*map(_meaning_section, report.meanings))
    head: list[Block] = [Headline(report.task)]
    if not report.contacts:
        head.append(Sentence("no body in contact can move, so no contact has a stiffness"))
    if report.requested and not report.missed:
        head.append(Sentence("verified by a run with these settings"))
    contacts = grouped_contacts(report.contacts)
    return document_of(
        Section(tuple(head), "task"),
        *(Section((Facts(facts),), "contacts", title=names) for names, facts in contacts.items()),
    )


def _meaning_section(meaning: WordMeaning) -> Section:
    texts = (Items(meaning.texts),) if meaning.texts else ()
    return Section((Headline(meaning.title), *texts), "meaning")
