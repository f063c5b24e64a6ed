"""The report of `contactlab lint`."""

from typing import Literal

from contactlab.schema.finding import PlacedFinding
from contactlab.schema.strict_model import Model, about


class LintReport(Model):
    """What is wrong with models before anything runs (`lint --format json`)."""

    lint_version: Literal[1] = 1
    mujoco: str = about("The version that compiled them.")
    models: tuple[str, ...] = about("The files that were looked at.")
    skipped: tuple[str, ...] = about("Files that hold no model.", default=())
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
