"""Describes a shrunk model: the failure, the removed parts, and the files of the small model."""

from contactlab.printable import shell_word
from contactlab.rendering.document import Code, Document, Headline, Sentence, document_of
from contactlab.schema.shrink_report import ShrinkReport


def describe_shrinking(report: ShrinkReport) -> Document:
    """Describe the smallest model that fails as a stored run does."""
    before, after = report.before, report.after
    changes = (
        f"{before[kind]} to {after[kind]} {kind}" for kind in before if before[kind] != after[kind]
    )
    removed = ", ".join(changes) or "no part could be removed"
    since = f", starting at {report.start_time:g} s" if report.start_time else ""
    times = f"{report.stored_duration:g} s to {report.duration:g} s{since}"
    unfinished = "The time limit was reached before every part was tried; raise it with --max-time."
    command = f"run it: contactlab sweep {shell_word(f'{report.folder}/sweep.yaml')}"
    return document_of(
        [
            Headline(f"{report.label}: {report.reason}"),
            Sentence(f"from {removed}; {times}"),
            Sentence(f"{report.models_run} models run in {report.seconds:.0f} s"),
            *([] if report.finished else [Sentence(unfinished)]),
            Code((f"model, sweep and issue text: {report.folder}", command), indent=0),
        ]
    )
