"""`contactlab compare`: whether a store is worse than another."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import Address, store_at
from contactlab.errors import ExpectationError, OutputError, PolicyError, StoreError

if TYPE_CHECKING:
    from contactlab.compare import Remeasure
    from contactlab.schema import ComparePolicy, ComparisonReport


class ReportFormat(StrEnum):
    """How a comparison is printed."""

    text = "text"
    json = "json"
    markdown = "markdown"
    junit = "junit"
    github = "github"


class Match(StrEnum):
    """How runs are paired."""

    id = "id"
    axes = "axes"


_SUFFIXES = {
    ".txt": ReportFormat.text,
    ".json": ReportFormat.json,
    ".md": ReportFormat.markdown,
    ".xml": ReportFormat.junit,
}


def compare(
    baseline: Annotated[
        Address,
        typer.Argument(parser=store_at, metavar="BASELINE", help="Store to compare with."),
    ],
    candidate: Annotated[
        Address, typer.Argument(parser=store_at, metavar="CANDIDATE", help="Store to judge.")
    ],
    policy: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Policy file: tolerances, and what fails the job."),
    ] = None,
    match: Annotated[
        Match | None, typer.Option(help="Pair runs by id, or by axis values and seed.")
    ] = None,
    files: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File to write: .md, .json, .xml (JUnit) or .txt; may be repeated.",
        ),
    ] = None,
    output: Annotated[
        ReportFormat, typer.Option("--format", help="How results are printed.")
    ] = ReportFormat.text,
    *,
    thorough: Annotated[
        bool, typer.Option("--thorough", help="Verify every record and every trace first.")
    ] = False,
    remeasure: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Time N pairs of runs again, interleaved."),
    ] = None,
    baseline_python: Annotated[
        Path | None,
        typer.Option(help="Python that times the baseline's runs; by default this one."),
    ] = None,
    candidate_python: Annotated[
        Path | None,
        typer.Option(help="Python that times the candidate's runs; by default this one."),
    ] = None,
    accept: Annotated[
        str | None,
        typer.Option(metavar="CHECK", help="Accept a failed check: add it to the policy file."),
    ] = None,
    reason: Annotated[str, typer.Option(help="Why it is accepted.")] = "",
    until: Annotated[
        datetime | None,
        typer.Option(formats=["%Y-%m-%d"], help="Last day on which it is accepted."),
    ] = None,
) -> None:
    """Compare a store with a baseline; exit with 1 if a gate fails."""
    if remeasure is None and (baseline_python or candidate_python):
        raise PolicyError("--baseline-python and --candidate-python need --remeasure N")
    targets = _targets(files or [])
    pythons = (baseline_python, candidate_python)
    request = _Request(baseline, candidate, policy, match, thorough, remeasure, pythons)
    if accept is not None:
        _accept(request, accept, reason, until.date() if until else None)
    report = _report(request, targets)
    _publish(report, targets)
    typer.echo(_rendered(report, output), nl=False)
    if report.exit_code == ExpectationError.exit_code:
        raise ExpectationError(report.headline)
    if report.exit_code:
        raise StoreError(report.headline)


@dataclass(frozen=True)
class _Request:
    """What to compare, and how."""

    baseline: Address
    candidate: Address
    policy: Path | None
    match: Match | None
    thorough: bool
    remeasure: int | None
    pythons: tuple[Path | None, Path | None]

    def read_policy(self, *, new: bool = False) -> "ComparePolicy":
        """Return the policy of the file, or the default one: without a file, or for a new one."""
        from contactlab.compare import DEFAULT_POLICY, read_policy

        file = None if new and self.policy and not self.policy.exists() else self.policy
        read = DEFAULT_POLICY if file is None else read_policy(file)
        return read.model_copy(update={"match": self.match.value}) if self.match else read

    def report(self, policy: "ComparePolicy") -> "ComparisonReport":
        from contactlab.compare import compare as compare_stores

        return compare_stores(
            self.baseline,
            self.candidate,
            policy,
            thorough=self.thorough,
            remeasure=self._timers(self.remeasure) if self.remeasure else None,
        )

    def _timers(self, runs: int) -> "Remeasure":
        from contactlab.compare import Remeasure
        from contactlab.run import timing_process

        pythons = [python or Path(sys.executable) for python in self.pythons]
        return Remeasure(runs, *(partial(timing_process, python) for python in pythons))


def _report(request: _Request, targets: Sequence[tuple[Path, ReportFormat]]) -> "ComparisonReport":
    """Compare; publish a report also of stores that cannot be compared."""
    from contactlab.compare import unreadable_report

    policy = request.read_policy()
    try:
        return request.report(policy)
    except StoreError as error:
        _publish(unreadable_report(error, policy), targets)
        raise


def _accept(request: _Request, name: str, reason: str, until: date | None) -> None:
    from contactlab.compare import accept, acceptance

    if request.policy is None:
        raise PolicyError("--accept adds to a policy file; name it with --policy FILE")
    report = request.report(request.read_policy(new=True))
    accept(request.policy, acceptance(report, name, reason, until))


def _targets(files: Sequence[Path]) -> list[tuple[Path, ReportFormat]]:
    unknown = [path for path in files if path.suffix not in _SUFFIXES]
    if unknown:
        raise OutputError(f"{unknown[0]}: write a name that ends in {', '.join(_SUFFIXES)}")
    return [(path, _SUFFIXES[path.suffix]) for path in files]


def _publish(report: "ComparisonReport", targets: Sequence[tuple[Path, ReportFormat]]) -> None:
    """Write the files of `-o` and, in a GitHub job, its annotations and summary."""
    from contactlab.store import atomic_write, write_error

    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    try:
        for path, format_ in targets:
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as temporary:
                temporary.write_text(_rendered(report, format_), encoding="utf-8")
        if summary:
            with Path(summary).open("a", encoding="utf-8") as file:
                file.write(_rendered(report, ReportFormat.markdown))
    except OSError as error:
        raise write_error(Path(error.filename), error) from error
    if os.environ.get("GITHUB_ACTIONS") == "true":
        typer.echo(_rendered(report, ReportFormat.github), err=True, nl=False)


def _rendered(report: "ComparisonReport", format_: ReportFormat) -> str:
    from contactlab import compare as formats

    renderers: dict[ReportFormat, Callable[[ComparisonReport], str]] = {
        ReportFormat.text: formats.as_text,
        ReportFormat.json: lambda each: each.model_dump_json(indent=2) + "\n",
        ReportFormat.markdown: formats.as_markdown,
        ReportFormat.junit: formats.as_junit,
        ReportFormat.github: formats.as_annotations,
    }
    return renderers[format_](report)
