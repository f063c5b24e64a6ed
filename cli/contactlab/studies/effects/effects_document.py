"""Describes the effects of a scene, and the smallest set that keeps every result."""

from collections.abc import Iterator
from pathlib import Path

from contactlab.printable import shortened
from contactlab.rendering.document import (
    Block,
    Code,
    Document,
    Section,
    Sentence,
    document_of,
    table_of,
)
from contactlab.schema.study_reports import EffectFinding, RecordedEffectsReport
from contactlab.schema.time_ratio import TimeRatio

_MOST_LINES = 12  # of the model's changes


def describe_recorded_effects(
    report: RecordedEffectsReport, *, folder: Path | None = None
) -> Document:
    """Describe effects that were changed alone, and the smallest set.

    Args:
        report: the effects.
        folder: of the report and its evidence, if they were written.
    """
    count = len(report.scenarios) * len(report.seeds)
    used = [each for each in report.effects if each.verdict != "unused"]
    unused = [each for each in report.effects if each.verdict == "unused"]
    blocks: list[Block] = [
        Sentence(report.task.line),
        Sentence(
            f"{report.scene}: each effect changed alone, {count} runs of {report.duration:g} s"
        ),
        table_of(
            ("effect", "base", "verdict", "time when changed", "reason"), list(map(_row, used))
        ),
    ]
    for reason in dict.fromkeys(each.reason for each in unused):
        names = ", ".join(each.effect for each in unused if each.reason == reason)
        blocks.append(Sentence(f"unused, by proof: {names} ({reason})"))
    for each in (each for each in report.interactions if each.below_tolerance):
        names = " and ".join(each.effects)
        blocks.append(Sentence(f"needed alone, below the tolerance together: {names}"))
    blocks += _smallest_set(report, folder)
    if folder:
        blocks.append(Sentence(f"evidence and effects.json in {folder}"))
    return document_of(Section(tuple(blocks), "effects"))


def _row(finding: EffectFinding) -> tuple[object, ...]:
    spread = (
        f"; within the spread over seeds: {', '.join(finding.within_spread)}"
        if finding.within_spread
        else ""
    )
    state, why = "on" if finding.on else "off", finding.reason + spread
    return finding.effect, state, finding.verdict, _ratio_text(finding.time_ratio), why


def _ratio_text(ratio: TimeRatio | None) -> str:
    return "" if ratio is None else ratio.text


def _smallest_set(report: RecordedEffectsReport, folder: Path | None) -> Iterator[Block]:
    smallest, verification = report.smallest_set, report.verification
    yield Sentence(f"smallest set: {', '.join(smallest.on)}")
    for name, measure in smallest.kept.items():
        yield Sentence(f"{name} stays: without it, {measure}")
    if report.time_ratio is not None:
        yield Sentence(f"time of the smallest set: {_ratio_text(report.time_ratio)}")
    if verification.runs:
        held = "holds" if verification.holds else "FAILS"
        how = " as settings, and as the written model" * bool(verification.holds_as_written)
        time = _ratio_text(verification.time_ratio)
        runs = f"{held} in {verification.runs} fresh runs{how}, {time}"
        yield Sentence(f"{runs}: {verification.reason}")
    if not verification.holds:
        return
    patch = f"a patch in {(folder or Path()) / 'written-model'}"
    why = smallest.no_patch_reason
    lines = (why,) if why else tuple(shortened(smallest.mjcf, _MOST_LINES, patch))
    yield Sentence("in the model:")
    yield Code(lines)
    yield Sentence("sweep:")
    yield Code(smallest.sweep)
