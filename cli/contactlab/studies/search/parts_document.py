"""Describes the influence of each feature and part of a model."""

from collections.abc import Iterator
from pathlib import Path

from contactlab.printable import shell_word
from contactlab.rendering.amounts import format_percent
from contactlab.rendering.document import Block, Document, Headline, Sentence, document_of, table_of
from contactlab.schema.parts_report import REPORT, PartEffect, PartsReport

_HEADS = ("", "removed", "verdict", "error", "worst body", "time without")


def describe_parts(report: PartsReport, *, folder: Path | None = None) -> Document:
    """Describe features and parts that were removed alone.

    Args:
        report: the parts.
        folder: of the report, if it was written.
    """
    head = (
        f"{report.model}: each feature and part removed alone, in the task, with gravity tilted by "
        f"{report.tilt:g} degrees, and with twice the controls and pushes"
    )
    blocks: list[Block] = [Sentence(report.task.line), Headline(head)]
    shown = [part for part in report.parts if part.verdict != "unused"]
    measured = [part for part in shown if part.error is not None or part.time_ratio]
    rows = [_part_row(part, report) for part in measured]
    if report.noise_floor:
        rows.append(("", "noise floor", "", "", "", report.noise_floor.text))
    if rows:
        blocks.append(table_of(_HEADS, rows))
    blocks += map(Sentence, _unmeasured_texts(report))
    unused = [part for part in report.parts if part.verdict == "unused"]
    for reason in dict.fromkeys(part.reason for part in unused):
        names = ", ".join(part.name for part in unused if part.reason == reason)
        blocks.append(Sentence(f"unused, by proof: {names} ({reason})"))
    if unused:
        model = shell_word(report.model)
        blocks.append(Sentence(f"next: contactlab tune {model} removes the unused parts"))
    if report.timed_out:
        late = (
            "The time limit was reached before all parts were measured; raise it with --max-time."
        )
        blocks.append(Sentence(late))
    if folder:
        blocks.append(Sentence(f"{REPORT} in {folder}"))
    return document_of(blocks)


def _unmeasured_texts(report: PartsReport) -> Iterator[str]:
    """Yield the parts that have neither an error nor a time, by verdict and kind."""
    names: dict[str, dict[str, list[str]]] = {}
    for part in report.parts:
        if part.verdict != "unused" and part.error is None and part.time_ratio is None:
            kind, name, verdict, *_ = _part_row(part, report)
            names.setdefault(verdict, {}).setdefault(kind, []).append(name)
    for verdict, kinds in names.items():
        listed = (f"{kind}{'s' * (len(of) > 1)} {', '.join(of)}" for kind, of in kinds.items())
        yield f"{verdict}: {'; '.join(listed)}"


def _part_row(part: PartEffect, report: PartsReport) -> tuple[str, ...]:
    error = "" if part.error is None else format_percent(part.error)
    where = f"{part.body}, {part.phase}" if part.body else ""
    verdict: str = part.verdict
    ratio, noise_floor = part.time_ratio, report.noise_floor
    saves = bool(ratio and noise_floor and ratio.is_less(min(1.0, noise_floor.low)))
    if part.verdict == "below the tolerance" and not part.reason:
        saved = format_percent(1 - ratio.ratio) if saves and ratio else "nothing"
        verdict += f", saves {saved}"
    elif part.reason:
        verdict += f" ({part.reason})"
    time = "" if ratio is None else ratio.text
    return part.kind, part.name, verdict, error, where, time
