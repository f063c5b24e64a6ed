"""Describes a search for settings: its result, the compared candidates, and the written files."""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

from contactlab.judge.wording import plural
from contactlab.printable import shell_word, shorten_lines
from contactlab.rendering.amounts import format_amount, format_interval, format_percent
from contactlab.rendering.document import (
    Block,
    Code,
    Column,
    Document,
    Facts,
    Headline,
    Row,
    Section,
    Sentence,
    Table,
    document_of,
)
from contactlab.reporting.budget_document import seeds_text
from contactlab.schema.time_ratio import LEAST_SAVING
from contactlab.schema.tune_report import (
    PATCH,
    REPORT,
    FrontPoint,
    TuneReport,
)
from contactlab.studies.search.configuration import INTEGRATOR, list_settings
from contactlab.studies.search.report_text import (
    UNVERIFIED,
    counts_as_equal,
    ending_text,
    error_text,
    find_error,
    no_speedup_text,
)
from contactlab.studies.search.tuning_problem import LIMITED


def describe_tuning(report: TuneReport, *, folder: Path | None = None) -> Document:
    """Describe a search.

    Args:
        report: the search.
        folder: of the report and the written models, if they were written.
    """
    heads = (
        Column("point", breakable=True),
        Column("error", "right"),
        Column("any seeds", "right"),
        Column("time", "right"),
        Column("speed", "right"),
    )
    front = tuple(_front_row(point, report) for point in report.front)
    return document_of(
        Section((Sentence(report.task.line), Headline(f"{report.model}: {report.sentence}"))),
        Section((Facts(tuple(_list_facts(report))),), "search", follows=True),
        Section((Table(heads, front, ruled=False),), "front", follows=True),
        Section(tuple(map(Sentence, _front_notes(report))), "front notes", follows=True),
        Section(tuple(_list_details(report)), "details", follows=True),
        Section(tuple(map(Sentence, _list_notes(report))), "notes", follows=True),
        Section(tuple(_written_files(report, folder)), "files", follows=True),
    )


def _list_facts(report: TuneReport) -> Iterator[tuple[str, str]]:
    target = report.target
    if report.fall:
        yield "drive", report.fall
    yield "target", _target_text(report)
    if target.unit == "1":
        yield "errors", _errors_text(report)
    if target.divergence:
        yield "motion", target.divergence
    yield "search", f"{ending_text(report)}, {report.seconds:.0f} s"
    yield "speed", f"{format_amount(report.real_time)}x real time as written, on one core"
    known_parts = list[str]()
    for each in report.uncertainty:
        parameter, _, share = each.name.partition(" ")
        known_parts.append(
            f"{format_percent(each.error)} ({parameter} known to {share}, {each.body})"
        )
    if known_parts:
        yield "model", f"known to {' and '.join(known_parts)}"
    if why := no_speedup_text(report):
        yield "limits", why


def _errors_text(report: TuneReport) -> str:
    text = "residual force as a share of the real forces, in the worst body and phase, mean over "
    most = max(point.error_seeds for point in report.front)
    text += f"{'up to ' * (len(report.front) > 1)}{plural(most, 'seed')}"
    count = len(report.task.seeds)
    if most <= count:
        return f"{text}, as in `contactlab MODEL`"
    return f"{text}; `contactlab MODEL` runs the first {count}"


def _front_notes(report: TuneReport) -> Iterator[str]:
    texts = {point.number: _list_changes(point) for point in report.front}
    phrases = dict.fromkeys(itertools.chain(*texts.values()))
    if phrases:
        own = (
            f"{phrase} ({_join_numbers([one for one, its in texts.items() if phrase in its])})"
            for phrase in phrases
        )
        yield f"settings by point: {', '.join(own)}"
    for point in report.front:
        if point.state in ("verified", "failed"):
            file = f"; {point.file}" if point.file else ""
            yield f"point {point.number} {point.state}: {point.verification}{file}"
    if others := [point.number for point in report.front if point.state == "not verified"]:
        yield (
            f"not verified: {_join_numbers(others)}; --pick N writes and verifies one; --error 1% "
            "searches the fastest within 1 %"
        )
    few_points = 4
    if len(report.front) < few_points:
        reason = f"no other of {report.trials} candidates is distinctly faster or more accurate"
        if report.ended == "time":
            reason = "the CPU limit ended the search; allow more with --max-cpu"
        elif report.ended == "work":
            reason = f"{report.max_cpu:g} s allow no more work; allow more with --max-cpu"
        yield f"Few points: {reason}."


def _list_changes(point: FrontPoint) -> list[str]:
    candidate = point.candidate
    own = {name: value for name, value in candidate.settings.items() if name != INTEGRATOR}
    removed = {
        "without unused parts": candidate.removes_unused,
        "without far pairs": candidate.removes_far_pairs,
        "simplified hulls": candidate.simplifies_hulls,
    }
    return [*list_settings(own), *(text for text, is_made in removed.items() if is_made)]


def _join_numbers(numbers: Sequence[int]) -> str:
    # 1, 2, 3, 5 are "1-3, 5".
    first = {number: number - place for place, number in enumerate(numbers)}
    groups = [list(own) for _, own in itertools.groupby(numbers, first.__getitem__)]
    return ", ".join(f"{own[0]}-{own[-1]}" if len(own) > 1 else str(own[0]) for own in groups)


def _target_text(report: TuneReport) -> str:
    target = report.target
    limit = error_text(target.limit, target.unit)
    match target.kind:
        case "as written":
            own = error_text(find_error(report), target.unit, target.tolerance)
            text = f"no less accurate than the model as written, {own} in the table"
            if counts_as_equal(report):
                text += f"; errors below {limit} count as equal"
            if target.chance:
                text += (
                    f"; the motion is chaotic, and seeds differ by {format_percent(target.chance)}"
                )
            return text
        case "tolerance":
            return f"error at most {limit} (the tolerance)"
        case "real time":
            return f"the least error at {target.real_time:g}x real time"
        case _:
            return f"error at most {limit}, as requested"


def _front_row(point: FrontPoint, report: TuneReport) -> Row:
    unit, ratio = report.target.unit, point.candidate.time_ratio
    if "as written" in point.marks:
        time = format_amount(1.0, "x")
    elif ratio:
        interval = format_interval(ratio.low, ratio.high, "x").replace(" to ", "-")
        time = f"{format_amount(ratio.ratio, 'x')} ({interval})"
    else:
        time = f"work {format_amount(point.candidate.cost, 'x')}"
    low, high = (error_text(value, unit) for value in (point.error_low, point.error_high))
    errors = f"{low.removesuffix(f' {unit}')} to {high}"
    if point.error_high is None:
        errors = f"above {low}"
    if point.error_seeds == 1:
        errors = "1 seed"
    elif unit == "1" and point.error_low is not None and point.error_high is not None:
        errors = seeds_text(point.error_low, point.error_high)
    return Row(
        (
            f"{point.number} {', '.join((point.name, *point.marks))}",
            error_text(point.error, unit, report.target.tolerance),
            errors,
            time,
            f"{format_amount(point.real_time, digits=2)}x",
        )
    )


def _list_details(report: TuneReport) -> Iterator[Block]:
    """Yield unused parts, assumptions, and the changed lines."""
    if report.masked or report.excluded:
        count = _count_pairs(report.masked, report.excluded)
        yield Sentence(
            f"unused: {count} provably cannot touch: without their collisions the motion is the "
            "same, bit for bit"
        )
    if report.disabled_flags:
        flags = " and ".join(report.disabled_flags)
        yield Sentence(f"unused: {flags}: no state depends on it")
    if pairs := report.far_pairs:
        count = _count_pairs(pairs.geoms, pairs.bodies)
        distance = f"{1e3 * pairs.distance:g} mm"
        text = (
            f"{count} stayed at least {distance} apart in every run (the task, tilted, and with "
            "twice its inputs)"
        )
        # Work that was not counted may be saved, too.
        if pairs.removed:
            yield Sentence(f"assumed: {text}. If they meet, they now pass through each other")
        elif pairs.cost is None or pairs.cost < 1 - LEAST_SAVING:
            ratio = f" at x{pairs.cost:.2g} work" if pairs.cost else ""
            option = f"--apply far-pairs={distance.replace(' ', '')}"
            yield Sentence(f"option: {text}. {option} ignores their collisions{ratio}")
    if hulls := report.simplified_hulls:
        yield Sentence(
            f"assumed: {plural(len(hulls.meshes), 'hull')} with fewer vertices, at most "
            f"{format_amount(hulls.max_distance, 'mm')} inside the original"
        )
    lines = [f"{each.file}:{each.line}: {each.element or 'removed'}" for each in report.lines]
    most_lines = 12  # of the patch
    if lines:
        yield Code(tuple(shorten_lines(lines, most_lines, PATCH)), indent=0)


def _count_pairs(geoms: Sequence[str], bodies: Sequence[object]) -> str:
    counts = (plural(len(geoms), "geom"), f"{plural(len(bodies), 'pair')} of bodies")
    return " and ".join(text for text, some in zip(counts, (geoms, bodies), strict=True) if some)


def _list_notes(report: TuneReport) -> Iterator[str]:
    """Yield the settings that were not changed and why, then the effects of the time limit."""
    limited = {each.name: each.reason for each in report.not_changed if each.name in LIMITED}
    unchanged = list(
        dict.fromkeys(
            f"{each.name} ({each.reason})"
            for each in report.not_changed
            if each.name not in limited and each.reason != UNVERIFIED
        )
    )
    most_listed = 6
    yield from (f"Not changed: {each}." for each in unchanged[:most_listed])
    if (more := len(unchanged) - most_listed) > 0:
        yield f"Not changed: {more} more settings, listed in {REPORT}."
    yield from (f"note: {name}: {reason}" for name, reason in limited.items())
    if any(each.reason == UNVERIFIED for each in report.not_changed):
        yield f"note: {UNVERIFIED}"


def _written_files(report: TuneReport, folder: Path | None) -> Iterator[Block]:
    if folder is None:
        return
    for point in report.front:
        if point.number == report.picked and point.file:
            yield Sentence(f"wrote {folder / point.file} (point {point.number}, {point.state})")
    if other := report.equal_error:
        yield Sentence(f"wrote {folder / other.file} (equal error): {other.verified.sentence}")
    picked = [one.file for one in report.front if one.number == report.picked and one.file]
    if report.file:
        patch = f", {PATCH}" if (folder / PATCH).is_file() else ""
        yield Sentence(f"wrote {folder / report.file}{patch} and {REPORT}")
    else:
        yield Sentence(f"{REPORT} in {folder}")
    if file_names := [*picked, *([report.file] if report.file else [])]:
        yield Code((f"next: contactlab {shell_word(folder / file_names[0])}",), indent=0)
