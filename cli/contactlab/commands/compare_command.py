"""`contactlab compare`: is a store worse than another."""

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

from contactlab.commands.options import METAVAR, Address, store_at
from contactlab.errors import ExpectationError, OutputError, PolicyError, StoreError

if TYPE_CHECKING:
    from contactlab.compare import Remeasure
    from contactlab.schema import ComparePolicy, ComparisonReport


class View(StrEnum):
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


_SUFFIXES = {".txt": View.text, ".json": View.json, ".md": View.markdown, ".xml": View.junit}


def compare(  # noqa: PLR0913 - one argument an option
    baseline: Annotated[
        Address, typer.Argument(parser=store_at, metavar=METAVAR, help="The store to compare with.")
    ],
    candidate: Annotated[
        Address, typer.Argument(parser=store_at, metavar=METAVAR, help="The store that is judged.")
    ],
    policy: Annotated[
        Path | None, typer.Option(help="The file that says what is worse, and what fails.")
    ] = None,
    match: Annotated[
        Match | None, typer.Option(help="Pair runs by id, or by axis values and seed.")
    ] = None,
    files: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help="Write a file: .md, .json, .xml (JUnit) or .txt."),
    ] = None,
    view: Annotated[View, typer.Option("--format", help="How it is printed.")] = View.text,
    *,
    thorough: Annotated[
        bool, typer.Option("--thorough", help="Check every record and every trace first.")
    ] = False,
    remeasure: Annotated[
        int | None, typer.Option(min=1, help="Time so many pairs of runs anew, in turns.")
    ] = None,
    baseline_python: Annotated[
        Path | None, typer.Option(help="The Python that steps the baseline's; this one by default.")
    ] = None,
    candidate_python: Annotated[
        Path | None, typer.Option(help="The Python that steps the candidate's.")
    ] = None,
    accept: Annotated[
        str | None, typer.Option(metavar="CHECK", help="Write into the policy that it may fail.")
    ] = None,
    reason: Annotated[str, typer.Option(help="Why it may.")] = "",
    until: Annotated[
        datetime | None, typer.Option(formats=["%Y-%m-%d"], help="The last day on which it may.")
    ] = None,
) -> None:
    """Compare a store with a baseline; exits with 1 if a gate fails."""
    if remeasure is None and (baseline_python or candidate_python):
        raise PolicyError("an interpreter is only used with --remeasure N")
    targets = _targets(files or [])
    pythons = (baseline_python, candidate_python)
    asked = _Asked(baseline, candidate, policy, match, thorough, remeasure, pythons)
    if accept is not None:
        _accept(asked, accept, reason, until.date() if until else None)
    report = _compared(asked, targets)
    _publish(report, targets)
    typer.echo(_rendered(report, view), nl=False)
    if report.exit_code == ExpectationError.exit_code:
        raise ExpectationError(report.headline)
    if report.exit_code:
        raise StoreError(report.headline)


@dataclass(frozen=True)
class _Asked:
    """What is to be compared, and how."""

    baseline: Address
    candidate: Address
    policy: Path | None
    match: Match | None
    thorough: bool
    remeasure: int | None
    pythons: tuple[Path | None, Path | None]

    def read_policy(self, *, new: bool = False) -> "ComparePolicy":
        """Return the file's policy, or the default one; a file that is to be made has none."""
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


def _compared(asked: _Asked, targets: Sequence[tuple[Path, View]]) -> "ComparisonReport":
    """Compare; stores that cannot be compared are reported like others before the command ends."""
    from contactlab.compare import unreadable_report

    policy = asked.read_policy()
    try:
        return asked.report(policy)
    except StoreError as error:
        _publish(unreadable_report(error, policy), targets)
        raise


def _accept(asked: _Asked, name: str, reason: str, until: date | None) -> None:
    from contactlab.compare import accept, acceptance

    if asked.policy is None:
        raise PolicyError("--accept writes into a policy file; say which with --policy FILE")
    report = asked.report(asked.read_policy(new=True))
    accept(asked.policy, acceptance(report, name, reason, until))


def _targets(files: Sequence[Path]) -> list[tuple[Path, View]]:
    unknown = [path for path in files if path.suffix not in _SUFFIXES]
    if unknown:
        raise OutputError(
            f"cannot tell from its name how to write {unknown[0]}; end it in {', '.join(_SUFFIXES)}"
        )
    return [(path, _SUFFIXES[path.suffix]) for path in files]


def _publish(report: "ComparisonReport", targets: Sequence[tuple[Path, View]]) -> None:
    """Write the files that were asked for and, in a GitHub job, its annotations and summary."""
    from contactlab.store import atomic_write, write_error

    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    try:
        for path, view in targets:
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as temporary:
                temporary.write_text(_rendered(report, view), encoding="utf-8")
        if summary:
            with Path(summary).open("a", encoding="utf-8") as file:
                file.write(_rendered(report, View.markdown))
    except OSError as error:
        raise write_error(Path(error.filename), error) from error
    if os.environ.get("GITHUB_ACTIONS") == "true":
        typer.echo(_rendered(report, View.github), err=True, nl=False)


def _rendered(report: "ComparisonReport", view: View) -> str:
    from contactlab import compare as room

    renderers: dict[View, Callable[[ComparisonReport], str]] = {
        View.text: room.as_text,
        View.json: lambda each: each.model_dump_json(indent=2) + "\n",
        View.markdown: room.as_markdown,
        View.junit: room.as_junit,
        View.github: room.as_annotations,
    }
    return renderers[view](report)
