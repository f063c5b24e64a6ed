"""One page of what the checks found, in Markdown."""

from collections.abc import Iterator

from contactlab.schema import Change, CheckReport, CheckResult, Measure


def page(report: CheckReport) -> str:
    """Return a report as a Markdown page."""
    return "\n".join([*_head(report), *_overview(report), *_checks(report)]) + "\n"


def _head(report: CheckReport) -> Iterator[str]:
    yield f"# {report.scene}: {'passes' if report.passed else 'fails'}"
    yield ""
    given = "".join(f" --set '{each}'" for each in report.overrides)
    yield f"    contactlab check {report.model}{given}"
    yield ""
    start = f"keyframe `{report.keyframe}`" if report.keyframe else "its own start"
    yield (
        f"Model `{report.model}` ({report.scene_hash}), from {start}, for {report.kind} "
        f"({report.kind_reason}); {report.engine.name} {report.engine.version}."
    )
    yield ""


def _overview(report: CheckReport) -> Iterator[str]:
    yield "| check | verdict | what came out |"
    yield "|---|---|---|"
    for each in report.checks:
        yield f"| {each.name} | {each.verdict} | {_cell(each.reason)} |"
    yield ""


def _checks(report: CheckReport) -> Iterator[str]:
    for each in report.checks:
        yield from _check(each)


def _check(check: CheckResult) -> Iterator[str]:
    yield f"## {check.name}: {check.verdict}"
    yield ""
    yield f"Asked: {check.asks}."
    yield ""
    yield f"{check.reason[:1].upper()}{check.reason[1:]}."
    yield ""
    if check.measures:
        yield from _measures(check.measures)
    for note in check.notes:
        yield f"- {note}"
    if check.notes:
        yield ""
    for change in check.changes:
        yield from _change(change)
    if check.stores:
        yield f"Evidence: {', '.join(f'`{each}`' for each in check.stores)}."
        yield ""


def _measures(measures: tuple[Measure, ...]) -> Iterator[str]:
    yield "| number | of | value | limit | |"
    yield "|---|---|---|---|---|"
    for each in measures:
        verdict = "" if each.holds is None else "holds" if each.holds else "**missed**"
        limit = "" if each.limit is None else _number(each.limit, each.unit)
        name, of = each.name.replace("_", " "), _cell(each.of or "")
        yield f"| {name} | {of} | {_number(each.value, each.unit)} | {limit} | {verdict} |"
    yield ""


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" + ("" if unit == "1" else f" {unit}")


def _change(change: Change) -> Iterator[str]:
    heads = {True: "This cures it", False: "This does not cure it", None: "To change"}
    yield f"{heads[change.cures]}: {change.shown}"
    yield ""
    yield "```xml"
    yield from change.lines
    yield "```"
    yield ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
