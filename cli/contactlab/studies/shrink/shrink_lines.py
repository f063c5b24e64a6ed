"""What was left of a failing model, as lines of text for 80 columns."""

from contactlab.printable import shell_word, visible, wrapped
from contactlab.schema.shrink_report import ShrinkReport


def shrink_lines(report: ShrinkReport) -> list[str]:
    """Return what fails, what was taken out, and where the rest lies."""
    before, after = report.before, report.after
    ways = (
        f"{before[kind]} to {after[kind]} {kind}" for kind in before if before[kind] != after[kind]
    )
    taken = ", ".join(ways) or "nothing could be taken out"
    since = f", from {report.begins:g} s on" if report.begins else ""
    lines = [
        *wrapped(f"{report.label}: {report.reason}", ""),
        *wrapped(f"from {taken}; {report.stored_duration:g} s to {report.duration:g} s{since}", ""),
        *wrapped(f"{report.tried} models were run in {report.seconds:.0f} s", ""),
    ]
    if not report.finished:
        lines += wrapped("the time ended before all was tried; allow more with --max-time", "")
    lines.append(f"model, sweep and text of an issue: {report.folder}")
    lines.append(f"run it: contactlab sweep {shell_word(f'{report.folder}/sweep.yaml')}")
    return [visible(line) for line in lines]
