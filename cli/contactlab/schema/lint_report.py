"""The report of `contactlab lint`."""

from typing import Literal

from contactlab.schema.finding import PlacedFinding
from contactlab.schema.strict_model import Model, about


class LintReport(Model):
    """Faults of model files (`lint --format json`)."""

    lint_version: Literal[2] = 2
    mujoco: str = about("The version that compiled them.")
    models: tuple[str, ...] = about("The linted files.")
    skipped: tuple[str, ...] = about("Files without a model.", default=())
    findings: tuple[PlacedFinding, ...] = about("By model and line; ignored ones have a waiver.")

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
