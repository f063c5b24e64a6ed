"""Comparisons: their policy, the files they are written to, and how they are printed."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from contactlab.command_line.declaration import Given, Show
from contactlab.command_line.surroundings import surroundings
from contactlab.command_line.terminal import echo, echo_commands
from contactlab.errors import ContactlabError, ExpectationError, OutputError, StoreError

if TYPE_CHECKING:
    from contactlab.schema.comparison import ComparePolicy, ComparisonReport

ReportFormat = Literal["text", "json", "markdown", "junit", "github"]
_FORMATS: Mapping[str, ReportFormat] = {
    ".txt": "text",
    ".json": "json",
    ".md": "markdown",
    ".xml": "junit",
}


def policy_of(
    policy: str | Path | None, given: Mapping[str, str | None] | None = None
) -> "ComparePolicy":
    """Return the policy of a file, or the default one, with what options say."""
    from contactlab.comparison.compare_stores import DEFAULT_POLICY
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.comparison import ComparePolicy

    read = DEFAULT_POLICY if policy is None else read_yaml_as(Path(policy), ComparePolicy)
    return read.model_copy(update={name: value for name, value in (given or {}).items() if value})


def files_to_write(files: Sequence[str | Path]) -> list[tuple[Path, ReportFormat]]:
    """Return the files of `-o`, each with the format of its suffix."""
    paths = [Path(file) for file in files]
    if unknown := [path for path in paths if path.suffix not in _FORMATS]:
        raise OutputError(f"{unknown[0]}: write a name that ends in {', '.join(_FORMATS)}")
    return [(path, _FORMATS[path.suffix]) for path in paths]


def publish(report: "ComparisonReport", targets: Sequence[tuple[Path, ReportFormat]]) -> None:
    """Write the files of `-o`; tell a CI job that calls the command."""
    from contactlab.store.atomic_files import atomic_write, write_error

    try:
        for path, form in targets:
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as temporary:
                temporary.write_text(_rendered(report, form), encoding="utf-8")
    except OSError as error:
        raise write_error(Path(error.filename), error) from error
    surroundings().announce(
        lambda: _rendered(report, "markdown"), lambda: _rendered(report, "github")
    )


def print_report(form: ReportFormat, report: "ComparisonReport", given: Given) -> None:
    """Print a comparison."""
    del given
    show = echo_commands if form == "github" else echo
    show(_rendered(report, form).removesuffix("\n"))


COMPARED: Mapping[str, Show] = {
    name: partial(print_report, name) for name in (*_FORMATS.values(), "github")
}
"""Printers of a comparison, by format."""


def failure(report: "ComparisonReport", given: Given) -> ContactlabError | None:
    """Return the error of a comparison whose gates fail, or that cannot be judged."""
    del given
    if not report.exit_code:
        return None
    failed = report.exit_code == ExpectationError.exit_code
    return (ExpectationError if failed else StoreError)(report.headline)


def _rendered(report: "ComparisonReport", form: ReportFormat) -> str:
    from contactlab.comparison.report_formats import as_annotations, as_junit, as_markdown, as_text

    renderers: dict[ReportFormat, Callable[[ComparisonReport], str]] = {
        "text": as_text,
        "json": lambda compared: compared.model_dump_json(indent=2) + "\n",
        "markdown": as_markdown,
        "junit": as_junit,
        "github": as_annotations,
    }
    return renderers[form](report)
