"""The report that all writers take, as data, and the order of its findings, the worst first."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pydantic import BaseModel

from contactlab.judge.wording import pair_location, pair_values, plural
from contactlab.printable import printable
from contactlab.schema.finding import Finding, Outcome
from contactlab.writers.signs import ORDER


@dataclass(frozen=True)
class Section:
    """A part of a report after its findings: lines, a table of one header, and lines of a file."""

    title: str
    lines: tuple[str, ...] = ()
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    code: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """Result of one command, for the writers.

    Attributes:
        title: the command and its subject.
        place: parts of the class names of its findings in JUnit, the widest first.
        headline: the result, in a sentence.
        passed: whether the job passes.
        record: the whole result as data.
        facts: names with texts, such as causes, the task and the engine.
        findings: results of the checks.
        sections: details of the findings.
        notes: sentences at the end.
        commands: command lines for the next step, each with its purpose.
        rules: sentences about the names of findings, by name.
        lists_passed: whether findings that passed are shown one by one, or counted.
    """

    title: str
    place: tuple[str, ...]
    headline: str
    passed: bool
    record: BaseModel
    facts: tuple[tuple[str, str], ...] = ()
    findings: tuple[Finding, ...] = ()
    sections: tuple[Section, ...] = ()
    notes: tuple[str, ...] = ()
    commands: tuple[tuple[str, str], ...] = ()
    rules: Mapping[str, str] = field(default_factory=dict[str, str])
    lists_passed: bool = True

    @property
    def command_lines(self) -> list[str]:
        """The commands, each in a line with its purpose."""
        return [f"{what}: {command}" for what, command in self.commands]


@dataclass(frozen=True)
class Line:
    """A finding in a table, with its worst pair and where that is; errors are urgent."""

    outcome: Outcome
    name: str
    message: str = ""
    worst: str = ""
    where: str = ""
    urgent: bool = False

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Its cells after the outcome."""
        return self.name, self.message, self.worst, self.where


def finding_lines(report: Report, most_metrics: int | None = None) -> list[Line]:
    """Return the lines of findings, the worst first; those skipped for one reason together.

    Metrics with one outcome: `most_metrics` that fail in most runs have lines, the others share
    one; None gives each its own.
    """
    lines: list[Line] = []
    skipped: dict[tuple[str, str], list[Finding]] = {}
    metrics: dict[Outcome, list[Finding]] = {}
    for finding in report.findings:
        if finding.outcome not in {"skipped", "passed"} and finding.kind == "metrics":
            metrics.setdefault(finding.outcome, []).append(finding)
        elif finding.outcome == "skipped":
            skipped.setdefault((finding.level, finding.message), []).append(finding)
        elif finding.outcome != "passed" or report.lists_passed:
            lines.append(_line_of_finding(finding))
    for outcome, same in metrics.items():
        ranked = sorted(same, key=lambda each: -each.failing / max(1, each.judged))
        lines += map(_line_of_finding, ranked[:most_metrics])
        if rest := ranked[len(ranked[:most_metrics]) :]:
            names = [*dict.fromkeys(each.name.split()[0] for each in rest)]
            most_names = 20  # about three lines
            also = ", ".join(names if len(names) <= most_names else [*names[:most_names], "..."])
            lines.append(Line(outcome, plural(len(rest), "more metric"), also, urgent=True))
    lines += [
        _line_of_finding(same[0]) if len(same) == 1 else _join_skipped_findings(same)
        for same in skipped.values()
    ]
    return sorted(lines, key=lambda line: ORDER.index(line.outcome))


def _line_of_finding(finding: Finding) -> Line:
    pair = finding.worst[0] if finding.worst else None
    return Line(
        finding.outcome,
        finding.full_name,
        finding.full_message,
        pair_values(finding, pair) if pair else "",
        pair_location(pair) if pair else "",
        finding.outcome in {"failed", "warned"} or finding.is_open,
    )


def _join_skipped_findings(findings: Sequence[Finding]) -> Line:
    """Return one line for all skipped findings of one reason and level."""
    names = list(dict.fromkeys(finding.name.split()[0] for finding in findings))
    where = ", ".join(names if len(names) <= 3 else [*names[:3], "..."])
    name = plural(len(findings), "check")
    return Line("skipped", name, findings[0].message, "", where, findings[0].is_open)


def as_json(report: Report) -> str:
    """Return the data of a report as JSON, in the shape of its published schema."""
    # Pydantic itself writes no text that UTF-8 cannot hold, which data may have.
    data = report.record.model_dump(mode="json")
    return printable(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)) + "\n"
