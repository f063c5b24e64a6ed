"""Reports of judges: their policy, the files they are written to, and how they are printed."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from contactlab.command_line.declaration import Arguments, Show
from contactlab.command_line.surroundings import surroundings
from contactlab.command_line.terminal import echo, echo_commands, stdout
from contactlab.errors import ContactlabError, OutputError

if TYPE_CHECKING:
    from contactlab.schema.comparison import ComparePolicy, ComparisonReport
    from contactlab.writers import Report

ReportFormat = Literal["text", "json", "markdown", "junit", "sarif", "github"]
_FORMATS: Mapping[str, ReportFormat] = {
    ".txt": "text",
    ".json": "json",
    ".md": "markdown",
    ".xml": "junit",
    ".sarif": "sarif",
}
ReportOf = Callable[[Any, Arguments], "Report"]
"""Returns the report of a command, from its result and its parameters."""


class ConcludedReport(Protocol):
    """A report with the exit code of its command."""

    exit_code: int
    headline: str


def policy_of(
    policy: str | Path | None, overrides: Mapping[str, str | None] | None = None
) -> "ComparePolicy":
    """Return the policy of a file, or the default one, changed by options."""
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.comparison import ComparePolicy

    policy_of_file = (
        ComparePolicy(version=1) if policy is None else read_yaml_as(Path(policy), ComparePolicy)
    )
    return policy_of_file.model_copy(
        update={name: value for name, value in (overrides or {}).items() if value}
    )


def files_to_write(files: Sequence[str | Path]) -> list[tuple[Path, ReportFormat]]:
    """Return the files of `-o`, each with the format of its suffix."""
    paths = [Path(file) for file in files]
    if unknown := [path for path in paths if path.suffix not in _FORMATS]:
        raise OutputError(f"{unknown[0]}: write a name that ends in {', '.join(_FORMATS)}")
    return [(path, _FORMATS[path.suffix]) for path in paths]


def publish(report: "ComparisonReport", targets: Sequence[tuple[Path, ReportFormat]]) -> None:
    """Write the files of `-o`, and announce the report to a CI job."""
    from contactlab.store.atomic_files import atomic_write, write_error
    from contactlab.writers import WRITERS

    published = report_comparison(report, {})
    try:
        for path, form in targets:
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as temporary:
                temporary.write_text(WRITERS[form](published), encoding="utf-8")
    except OSError as error:
        raise write_error(Path(error.filename), error) from error
    surroundings().announce(
        lambda: WRITERS["markdown"](published), lambda: WRITERS["github"](published)
    )


def report_comparison(report: "ComparisonReport", arguments: Arguments) -> "Report":
    """Return the report of a comparison."""
    from contactlab.comparison.report import report_of

    del arguments
    return report_of(report)


def print_report(
    form: ReportFormat, report_of: ReportOf, result: object, arguments: Arguments
) -> None:
    """Print a report; its text is as wide as the terminal."""
    from contactlab.writers import WRITERS, as_text

    report = report_of(result, arguments)
    text = as_text(report, stdout().width) if form == "text" else WRITERS[form](report)
    show = echo_commands if form == "github" else echo
    show(text.removesuffix("\n"))


def list_printers(report_of: ReportOf, *forms: ReportFormat) -> dict[str, Show]:
    """Return the printers of a command's findings, by format: of all formats by default."""
    chosen = forms or (*_FORMATS.values(), "github")
    return {form: partial(print_report, form, report_of) for form in chosen}


def find_failure(report: ConcludedReport, arguments: Arguments) -> ContactlabError | None:
    """Return the error if a gate of the report fails or cannot be judged."""
    from contactlab.judge.conclusion import error_of

    del arguments
    return error_of(report.exit_code, report.headline)
