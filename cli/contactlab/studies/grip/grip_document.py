"""Describes a grip: its verdict, the squeeze, the drifts, trials, placements, causes and fixes."""

from collections.abc import Iterator, Sequence

from contactlab.rendering.amounts import format_amount
from contactlab.rendering.document import (
    Column,
    Document,
    Facts,
    Headline,
    Row,
    Sentence,
    Table,
    document_of,
    table_of,
)
from contactlab.schema.grip import GripFix, GripReport


def describe_grip(report: GripReport) -> Document:
    """Describe whether a gripper holds an object, and why not."""
    place = f"keyframe {report.keyframe}" if report.keyframe else "hand with its base fixed"
    limit = _speed_text(report.tolerance)
    where = f"{place}; motion relative to {report.base}; tolerance {limit}"

    speed = Column("speed", "right")
    drifts = [
        (
            each.name,
            _speed_text(each.speed, lost="-"),
            each.trend,
            "never" if each.lost_after is None else format_amount(each.lost_after, "s"),
        )
        for each in report.drifts
    ]
    placements = [
        (each.name, format_amount(each.force, "N", digits=3), _speed_text(each.speed), each.verdict)
        for each in report.placements
    ]
    of_placements = ("object", Column("force", "right"), speed, "verdict")
    of_fixes = (Column("fix"), speed, Column("time"), Column("verdict"))
    return document_of(
        [Headline(report.sentence), Sentence(where)],
        [Facts(tuple(_squeeze_facts(report)))],
        [
            table_of(("weight pulls", speed, "", "lost after"), drifts),
            Facts(tuple(_trial_facts(report))),
        ],
        [table_of(of_placements, placements)] if placements else [],
        [Sentence(cause.sentence) for cause in report.causes[1:]],
        [Table(of_fixes, tuple(map(_fix_row, report.fixes)))] if report.fixes else [],
        [Sentence(text) for text in _explain_missing_patches(report.fixes)],
        [Sentence(note) for note in report.notes],
    )


def _squeeze_facts(report: GripReport) -> Iterator[tuple[str, str]]:
    if report.opening is not None:
        yield "opening", format_amount(report.opening, "mm")

    # The bodies that press on the object: fingers, or one jaw and its counterpart.
    forces = [
        f"{each.body} {format_amount(each.force, 'N', digits=3)}"
        for each in report.fingers
        if each.force > 0
    ]
    moving = [each.body for each in report.fingers if each.body != report.base]
    if len(moving) != 1:
        yield "fingers", ", ".join(forces) or "no finger presses on it"
    elif len(forces) > 1:
        yield "jaw", " against ".join(forces)
    else:
        yield "jaw", f"{moving[0]} and {report.base}: they do not hold it"

    controls = (
        f"{each.name} {abs(each.force):.3g}"
        + (f" of {each.limit:.3g}" if each.limit is not None else "")
        for each in report.controls
    )
    yield "actuators", ", ".join(controls)
    share = format_amount(report.depth_share, "%")
    depth = f"{format_amount(report.depth, 'mm')}, {share} of half of its width"
    if report.depth < 0:
        depth = f"none: {format_amount(-report.depth, 'mm')} apart, their margins press before"
    yield "depth", depth


def _trial_facts(report: GripReport) -> Iterator[tuple[str, str]]:
    for name, trial in (("shaken", report.shake), ("turned", report.turn)):
        way = "far" if trial.distance is None else format_amount(trial.distance, "mm")
        yield name, "lost" if trial.lost else f"moves {way}"
    pull = report.pull
    if not any(each.force > 0 for each in report.fingers):
        return  # nothing is held that could be pulled
    force = format_amount(pull.force, "N", digits=3)
    yield "pulled", f"holds {force}, {pull.weights:.3g} weights ({pull.direction})"


def _fix_row(fix: GripFix) -> Row:
    ratio = format_amount(fix.time_ratio.ratio, "x") if fix.time_ratio else ""
    worse = ", worse than as written" if fix.worse else ""
    cells = (fix.name, _speed_text(fix.speed), ratio, f"{fix.verdict}{worse}")
    return Row(cells, details=fix.lines)


def _explain_missing_patches(fixes: Sequence[GripFix]) -> Iterator[str]:
    # Many fixes change the same thing that the file does not have.
    for reason in dict.fromkeys(fix.no_patch_reason for fix in fixes if fix.no_patch_reason):
        names = [fix.name for fix in fixes if fix.no_patch_reason == reason]
        are_all = len(names) == len(fixes) > 1
        yield f"no patch for {'any of them' if are_all else '; '.join(names)}: {reason}"


def _speed_text(speed: float | None, lost: str = "lost") -> str:
    return lost if speed is None else format_amount(speed, "mm/s")
