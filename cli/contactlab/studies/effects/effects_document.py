"""Describes features and parts of a model in one table, and the smaller model."""

from collections.abc import Iterator
from pathlib import Path

from contactlab.printable import shell_word, shorten_lines
from contactlab.rendering.amounts import format_table_error
from contactlab.rendering.document import (
    Block,
    Code,
    Document,
    Headline,
    Sentence,
    document_of,
    table_of,
)
from contactlab.schema.effects_report import REPORT, EffectsReport, PartEffect

_HEADS = ("feature or part", "verdict", "error", "worst body", "time")


def describe_effects(report: EffectsReport, *, folder: Path | None = None) -> Document:
    """Describe features and parts that were left out, and the smaller model.

    Args:
        report: the effects.
        folder: of the report, if it was written.
    """
    runs = f" in {report.scenarios} scenarios" * (report.scenarios > 1)
    how = (
        f"{report.model}: each feature and part left out alone{runs}, in the task, with gravity "
        f"tilted by {report.tilt:g} degrees, and with twice the controls and pushes"
    )
    shown_parts = [each for each in report.effects if each.error is not None or each.time_ratio]
    if report.recorded:
        how = (
            f"{report.model}: each feature changed alone, against {report.scenarios} recorded runs"
        )
    blocks: list[Block] = [Sentence(report.task.line), Sentence(how), Headline(report.sentence)]
    rows = [_describe_row(each) for each in shown_parts]
    if report.noise_floor:
        rows.append(("noise floor", "", "", "", f"x{report.noise_floor.ratio:.2f}"))
    if rows:
        blocks.append(table_of(_HEADS, rows))
    blocks += map(Sentence, _list_sentences(report, shown_parts))
    if smaller := report.smaller:
        path = Path(smaller.file) if folder is None else folder / smaller.file
        most_lines = 12
        blocks += [
            Sentence(f"verified: {smaller.sentence}"),
            Code(tuple(shorten_lines(smaller.lines, most_lines, f"the patch next to {path}"))),
            Sentence(f"wrote {path}"),
            Code((f"next: contactlab {shell_word(path)}",), indent=0),
        ]
        if any(part.kind == "sensor" and part.can_go for part in report.effects):
            advice = "Your program may read sensors: --keep sensors keeps all, --keep NAME one."
            blocks.append(Sentence(advice))
    if report.timed_out:
        blocks.append(Sentence("The CPU limit was reached; raise it with --max-cpu."))
    if folder:
        blocks.append(Sentence(f"{REPORT} in {folder}"))
    return document_of(blocks)


def _describe_row(part: PartEffect) -> tuple[str, ...]:
    error = "" if part.error is None else format_table_error(part.error)
    ratio, time = part.time_ratio, ""
    if ratio is not None:
        # A difference within noise does not count.
        time = "same" if ratio.low <= 1 <= ratio.high else f"x{ratio.ratio:.2f}"
    # A row fits into 80 columns with the longest verdict, error and time.
    part_name, body = _shorten_name(name_part(part), width=25), _shorten_name(part.body, width=15)
    return part_name, part.verdict, error, body, time


def name_part(part: PartEffect) -> str:
    """Return the name of a row, with its kind if that does not say it."""
    name = f"add {part.name}" if part.adds else part.name
    return name if part.kind == "feature" or part.members else f"{part.kind} {name}"


def _shorten_name(text: str, width: int) -> str:
    # Names of a model often share their begin, and differ in their end.
    if len(text) <= width:
        return text
    begin = width // 3
    return f"{text[:begin]}…{text[begin + 1 - width :]}"


def _list_sentences(report: EffectsReport, shown_parts: list[PartEffect]) -> Iterator[str]:
    for part in shown_parts:
        if part.members == (part.name,):
            yield f"{part.name}: {part.reason}"
        elif part.members:
            yield f"{part.name}: {_join_names(part.members)} ({part.reason})"
    safe = [part for part in shown_parts if part.verdict == "below the tolerance" and part.reason]
    for reason in dict.fromkeys(part.reason for part in safe):
        names = [part.name for part in safe if part.reason == reason]
        yield f"kept as {reason}: {_join_names(names)}"
    for name, measure in report.kept.items():
        yield f"{name} stays: without it, {measure}"
    slight = [part for part in shown_parts if part.verdict == "not exercised"]
    if slight:
        names = _join_names([part.name for part in slight])
        yield f"hardly loaded in these runs, which proves nothing for others: {names}"
    hidden_parts = [part for part in report.effects if part not in shown_parts]
    for verdict in dict.fromkeys(part.verdict for part in hidden_parts):
        own = [part for part in hidden_parts if part.verdict == verdict]
        kinds = dict.fromkeys(part.kind for part in own)
        texts = [
            f"{kind} {_join_names([part.name for part in own if part.kind == kind])}"
            for kind in kinds
        ]
        yield f"{verdict}: {'; '.join(texts)}"


def _join_names(names: "list[str] | tuple[str, ...]") -> str:
    most_names = 12
    more = len(names) - most_names
    return ", ".join(names[:most_names]) + (f" and {more} more" if more > 0 else "")
