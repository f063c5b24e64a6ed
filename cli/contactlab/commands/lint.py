"""`contactlab lint`: checks of model files before anything runs."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line.declaration import Argument, Arguments, command
from contactlab.command_line.judgements import print_report
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say
from contactlab.errors import ContactlabError, ExpectationError

if TYPE_CHECKING:
    from contactlab.schema.lint_report import LintReport
    from contactlab.writers import Report


def _find_failure(report: "LintReport", arguments: Arguments) -> ContactlabError | None:
    # The findings and their number are printed already.
    del arguments
    return None if report.passed else ExpectationError("")


def _list_findings(report: "LintReport", arguments: Arguments) -> "Report":
    from contactlab.studies.lint.linting import findings_of_lint

    del arguments
    return findings_of_lint(report)


@command(
    "examine",
    failure=_find_failure,
    keeps="nothing",
    examples=("lint robot.xml", "lint models/*.xml --format sarif"),
    formats={
        **report_formats(),
        "github": partial(print_report, "github", _list_findings),
        "sarif": partial(print_report, "sarif", _list_findings),
    },
)
def lint(
    models: Annotated[
        Sequence[str | Path] | str | Path,
        Argument("MODEL...", "Scenes, .xml or .urdf files, or menagerie:ROBOT.", kind=list[str]),
    ],
) -> "LintReport":
    """Check model files, by line, without running them.

    An error is a fault that no author intends, a warning mostly needs a fix, a note is good to
    know. `<!-- contactlab: ignore RULE -->` next to a line ignores a rule there.

    Raises:
        SceneError: there is no such model.
    """
    from contactlab.studies.lint.linting import lint as lint_models

    report = lint_models([str(models)] if isinstance(models, str | Path) else [*map(str, models)])
    if report.skipped:
        say(f"skipped files without a model: {', '.join(report.skipped)}")
    return report
