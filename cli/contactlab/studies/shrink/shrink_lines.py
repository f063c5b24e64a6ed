"""The shrink report as lines of text for 80 columns."""

from contactlab.printable import shell_word, visible, wrapped
from contactlab.schema.shrink_report import ShrinkReport


def shrink_lines(report: ShrinkReport) -> list[str]:
    """Return the failure, the removed parts, and the files of the small model."""
    before, after = report.before, report.after
    changes = (
        f"{before[kind]} to {after[kind]} {kind}" for kind in before if before[kind] != after[kind]
    )
    removed = ", ".join(changes) or "no part could be removed"
    since = f", starting at {report.start_time:g} s" if report.start_time else ""
    lines = [
        *wrapped(f"{report.label}: {report.reason}", ""),
        *wrapped(
            f"from {removed}; {report.stored_duration:g} s to {report.duration:g} s{since}", ""
        ),
        *wrapped(f"{report.models_run} models run in {report.seconds:.0f} s", ""),
    ]
    if not report.finished:
        lines += wrapped(
            "The time limit was reached before every part was tried; raise it with --max-time.", ""
        )
    lines.append(f"model, sweep and issue text: {report.folder}")
    lines.append(f"run it: contactlab sweep {shell_word(f'{report.folder}/sweep.yaml')}")
    return [visible(line) for line in lines]
