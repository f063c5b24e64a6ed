"""The report of a grip as lines of text for 80 columns."""

from collections.abc import Iterator, Sequence

from contactlab.printable import visible, wrapped
from contactlab.schema.grip import GripDrift, GripFix, GripReport


def grip_lines(report: GripReport) -> list[str]:
    """Return the verdict, the squeeze, the drifts, trials, placements, causes and fixes."""
    lines = [*wrapped(report.sentence), *wrapped(_where(report)), ""]
    lines += _squeeze(report)
    lines += ["", *_drifts(report.drifts), *_trials(report)]
    if report.placements:
        lines += ["", *_placements(report)]
    if len(report.causes) > 1:
        lines += ["", *(line for each in report.causes[1:] for line in wrapped(each.sentence))]
    if report.fixes:
        lines += ["", *_fixes(report.fixes)]
    if report.notes:
        lines += ["", *(line for note in report.notes for line in wrapped(note))]
    return [visible(line) for line in lines]


def _where(report: GripReport) -> str:
    place = f"keyframe {report.keyframe}" if report.keyframe else "hand with its base fixed"
    return f"{place}; motion relative to {report.base}; tolerance {_speed(report.tolerance)}"


def _squeeze(report: GripReport) -> Iterator[str]:
    if report.opening is not None:
        yield f"opening   {1e3 * report.opening:.3g} mm"
    yield from wrapped(_sides(report))
    controls = ", ".join(
        f"{each.name} {abs(each.force):.3g}"
        + (f" of {each.limit:.3g}" if each.limit is not None else "")
        for each in report.controls
    )
    yield from wrapped(f"actuators {controls}")
    yield f"depth     {1e3 * report.depth:.3g} mm, {report.depth_share:.0%} of half of its width"


def _sides(report: GripReport) -> str:
    """Return the bodies that press on the object: fingers, or one jaw and its counterpart."""
    forces = [f"{each.body} {each.force:.3g} N" for each in report.fingers if each.force > 0]
    moving = [each.body for each in report.fingers if each.body != report.base]
    if len(moving) == 1:
        sides = " against ".join(forces) if len(forces) > 1 else f"{moving[0]} and {report.base}"
        return f"jaw       {sides}" + ("" if len(forces) > 1 else ": they do not hold it")
    return f"fingers   {', '.join(forces) or 'no finger presses on it'}"


def _drifts(drifts: Sequence[GripDrift]) -> Iterator[str]:
    width = max(len(each.name) for each in drifts)
    yield f"{'weight pulls':{width}}  {'mm/s':>9}  {'':8}  lost after"
    for each in drifts:
        speed = "-" if each.speed is None else f"{1e3 * each.speed:.3g}"
        lost = "never" if each.lost_after is None else f"{each.lost_after:.3g} s"
        yield f"{each.name:{width}}  {speed:>9}  {each.trend:8}  {lost}"


def _trials(report: GripReport) -> Iterator[str]:
    for name, trial in (("shaken", report.shake), ("turned", report.turn)):
        way = "far" if trial.distance is None else f"{1e3 * trial.distance:.3g} mm"
        yield f"{name}    {'lost' if trial.lost else f'moves {way}'}"
    pull = report.pull
    yield f"pulled    holds {pull.force:.3g} N, {pull.weights:.3g} weights ({pull.direction})"


def _placements(report: GripReport) -> Iterator[str]:
    width = max(len(each.name) for each in report.placements)
    for each in report.placements:
        yield (
            f"{each.name:{width}}  {each.force:7.3g} N  {_speed(each.speed):>11}  {each.verdict}"
        )


def _fixes(fixes: Sequence[GripFix]) -> Iterator[str]:
    width = max(len(each.name) for each in fixes)
    for each in fixes:
        cost = f"x{each.time_ratio.ratio:.2f}" if each.time_ratio else ""
        worse = ", worse than as written" if each.worse else ""
        yield f"{each.name:{width}}  {_speed(each.speed):>11}  {cost:5}  {each.verdict}{worse}"
        for line in each.lines:
            yield from wrapped(line, "   ")
        if each.no_patch_reason:
            yield from wrapped(f"no patch: {each.no_patch_reason}", "   ")


def _speed(speed: float | None) -> str:
    return "lost" if speed is None else f"{1e3 * speed:.3g} mm/s"
