"""`contactlab compare`: whether a store is worse than another; `baseline`: what to keep of one."""

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, echo_commands, print_json
from contactlab.errors import ExpectationError, OutputError, PolicyError, StoreError

if TYPE_CHECKING:
    from contactlab.comparison.metric_checks import Remeasure
    from contactlab.schema.comparison import ComparePolicy, ComparisonReport

ReportFormat = Literal["text", "json", "markdown", "junit", "github"]
Match = Literal["id", "axes"]
_FORMATS: dict[str, ReportFormat] = {
    ".txt": "text",
    ".json": "json",
    ".md": "markdown",
    ".xml": "junit",
}


def compare(
    baseline: opt.Address = opt.store_argument("BASELINE", "Store to compare with."),
    candidate: opt.Address = opt.store_argument("CANDIDATE", "Store to judge."),
    policy: Path | None = opt.option("FILE", "Policy file: tolerances, and what fails the job."),
    match: Match | None = typer.Option(None, help="Pair runs by id, or by axis values and seed."),
    files: list[Path] | None = opt.output_option(
        "FILE", "File to write: .md, .json, .xml (JUnit) or .txt; may be repeated."
    ),
    output: ReportFormat = opt.FORMAT,
    *,
    thorough: bool = opt.flag("--thorough", "Verify every record and every trace first."),
    baseline_digest: str | None = opt.BASELINE_DIGEST,
    remeasure: int | None = typer.Option(
        None, min=1, metavar="N", help="Time N pairs of runs again, interleaved."
    ),
    baseline_python: Path | None = typer.Option(
        None, help="Python that times the baseline's runs; by default this one."
    ),
    candidate_python: Path | None = typer.Option(
        None, help="Python that times the candidate's runs; by default this one."
    ),
    accept: str | None = opt.option("CHECK", "Accept a failed check: add it to the policy file."),
    reason: str = typer.Option("", help="Why it is accepted."),
    until: datetime | None = typer.Option(
        None, formats=["%Y-%m-%d"], help="Last day on which it is accepted."
    ),
) -> None:
    """Compare a store with a baseline; exit with 1 if a gate fails."""
    from contactlab.comparison.compare_stores import compare as compare_stores
    from contactlab.comparison.compare_stores import unreadable_report
    from contactlab.comparison.policies import accept as add_accepted
    from contactlab.comparison.policies import acceptance

    targets = files_to_write(files or [])
    given = {"match": match, "baseline_digest": baseline_digest}
    timers = _timers(remeasure, baseline_python, candidate_python)
    run = partial(compare_stores, baseline, candidate, thorough=thorough, remeasure=timers)
    if accept is not None:
        if policy is None:
            raise PolicyError("--accept adds to a policy file; name it with --policy FILE")
        before = run(policy_of(policy if policy.exists() else None, given))
        entries = acceptance(before, accept, reason, until.date() if until else None)
        add_accepted(policy, entries)
    rules = policy_of(policy, given)
    try:
        report = run(rules)
    except StoreError as error:
        publish(unreadable_report(error, rules), targets)
        raise
    publish(report, targets)
    print_report(report, output)
    if report.exit_code == ExpectationError.exit_code:
        raise ExpectationError(report.headline)
    if report.exit_code:
        raise StoreError(report.headline)


def _timers(
    runs: int | None, baseline_python: Path | None, candidate_python: Path | None
) -> "Remeasure | None":
    if runs is None:
        if baseline_python or candidate_python:
            raise PolicyError("--baseline-python and --candidate-python need --remeasure N")
        return None
    from contactlab.comparison.metric_checks import Remeasure
    from contactlab.run.stored_runs import timing_process

    here = Path(sys.executable)
    pythons = (baseline_python or here, candidate_python or here)
    return Remeasure(runs, *(partial(timing_process, python) for python in pythons))


def policy_of(policy: Path | None, given: Mapping[str, str | None]) -> "ComparePolicy":
    """Return the policy of a file, or the default one, with what options say."""
    from contactlab.comparison.compare_stores import DEFAULT_POLICY
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.comparison import ComparePolicy

    read = DEFAULT_POLICY if policy is None else read_yaml_as(policy, ComparePolicy)
    return read.model_copy(update={name: value for name, value in given.items() if value})


def files_to_write(files: Sequence[Path]) -> list[tuple[Path, ReportFormat]]:
    """Return the files of `-o`, each with the format of its suffix."""
    unknown = [path for path in files if path.suffix not in _FORMATS]
    if unknown:
        raise OutputError(f"{unknown[0]}: write a name that ends in {', '.join(_FORMATS)}")
    return [(path, _FORMATS[path.suffix]) for path in files]


def publish(report: "ComparisonReport", targets: Sequence[tuple[Path, ReportFormat]]) -> None:
    """Write the files of `-o` and, in a GitHub job, its annotations and summary."""
    from contactlab.store.atomic_files import atomic_write, write_error

    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    try:
        for path, format_ in targets:
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as temporary:
                temporary.write_text(_rendered(report, format_), encoding="utf-8")
        if summary:
            with Path(summary).open("a", encoding="utf-8") as file:
                file.write(_rendered(report, "markdown"))
    except OSError as error:
        raise write_error(Path(error.filename), error) from error
    if os.environ.get("GITHUB_ACTIONS") == "true":
        print_report(report, "github", err=True)


def print_report(report: "ComparisonReport", format_: ReportFormat, *, err: bool = False) -> None:
    """Print a comparison."""
    show = echo_commands if format_ == "github" else echo
    show(_rendered(report, format_).removesuffix("\n"), err=err)


def _rendered(report: "ComparisonReport", format_: ReportFormat) -> str:
    from contactlab.comparison.report_formats import as_annotations, as_junit, as_markdown, as_text

    renderers: dict[ReportFormat, Callable[[ComparisonReport], str]] = {
        "text": as_text,
        "json": lambda each: each.model_dump_json(indent=2) + "\n",
        "markdown": as_markdown,
        "junit": as_junit,
        "github": as_annotations,
    }
    return renderers[format_](report)


baselines = typer.Typer(help="Keep stores to compare with.", no_args_is_help=True)


@baselines.command()
def update(
    store: opt.Address = opt.store_argument("STORE", "Store to take as the baseline."),
    dest: Path = typer.Argument(..., help="Folder of the baseline, created or replaced."),
    baseline_digest: str | None = opt.BASELINE_DIGEST,
    output: opt.Format = opt.FORMAT,
) -> None:
    """Write a store without its traces, small enough to commit."""
    from contactlab.store.verify_store import write_baseline

    written = write_baseline(store, dest, baseline_digest)
    runs, digest = written.manifest.runs, written.digest
    size = sum(path.stat().st_size for path in dest.rglob("*") if path.is_file())
    if output == "json":
        print_json({"baseline": str(dest), "runs": runs, "bytes": size, "digest": digest})
        return
    echo(f"{dest} holds the {runs} runs of {store} without traces: {size / 1e6:.2g} MB")
    echo(f"digest {digest}")
    echo(f"compare with it: contactlab compare {dest} STORE --baseline-digest {digest}")
