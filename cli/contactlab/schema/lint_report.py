"""The report of `contactlab lint`."""

from typing import Literal

from contactlab.schema.finding import PlacedFinding
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import about


class LintReport(ReportModel):
    """Faults of model files (`lint --format json`)."""

    lint_version: Literal[2] = 2
    mujoco: str = about("The version that compiled them.")
    models: tuple[str, ...] = about("The linted files.")
    skipped: tuple[str, ...] = about("Files without a model.", default=())
    findings: tuple[PlacedFinding, ...] = about("By model and line; ignored ones have a waiver.")

    @property
    def headline(self) -> str:
        """The number of findings in a sentence."""
        texts = [
            f"{count} {word}{'s' * (count > 1)}"
            for word in ("error", "warning", "note")
            if (count := len(self.open(word)))
        ]
        waived = sum(finding.waived is not None for finding in self.findings)
        texts += [f"{waived} ignored"] if waived else []
        models = f"{len(self.models)} model{'' if len(self.models) == 1 else 's'}"
        return f"{', '.join(texts) or 'nothing found'} in {models}"

    @property
    def problem(self) -> str:
        """The number of findings, if there is an error that is not ignored."""
        return "" if self.passed else self.headline

    @property
    def passed(self) -> bool:
        """Whether there is no error that is not ignored."""
        return all(finding.outcome != "failed" for finding in self.findings)

    def open(self, severity: str) -> list[PlacedFinding]:
        """Return the findings of a severity that are not ignored."""
        return [
            finding
            for finding in self.findings
            if finding.severity == severity and finding.waived is None
        ]
