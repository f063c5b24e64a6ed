"""The report of `contactlab advisories check`: witnesses under several releases of an engine."""

from typing import Literal

from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about

WitnessOutcome = Literal["shown", "not shown", "unclear", "crashed", "not run"]


class WitnessResult(Model):
    """The witness of one advisory under one release."""

    advisory: str
    release: str
    affected: bool = about("Whether the advisory says that this release has the fault.")
    outcome: WitnessOutcome = about(
        "shown: at least half of the way from the right to the wrong value; not shown: right; "
        "unclear: neither."
    )
    measured: FiniteOrNull = about("The measured value; null if it is not finite.", default=None)
    meets: bool = about("Whether the predicate applies to the witness.", default=False)
    reason: str = about("Why it did not run, or is not met.", default="")

    @property
    def mistake(self) -> str:
        """The wrong statement of the advisory about this release; empty if all are right."""
        match self.outcome:
            case "shown" | "crashed" if not self.affected:
                return "the witness shows the fault, but the release is not listed as affected"
            case "shown" if not self.meets:
                return f"the predicate does not apply to the witness: {self.reason}"
            case "not shown" if self.affected:
                return "the witness gives the right value, but the release is listed as affected"
            case "not run" if self.affected:
                return f"the witness does not run: {self.reason}"
            case "unclear":
                return f"the measured value {self.measured} is neither right nor wrong"
            case _:
                return ""


class AdvisoriesCheck(ReportModel):
    """All witnesses under all releases (`advisories check --format json`)."""

    advisories_check_version: Literal[1] = 1
    releases: tuple[str, ...] = about("The releases, oldest first.")
    results: tuple[WitnessResult, ...] = about("By advisory and release.")

    @property
    def mistakes(self) -> list[str]:
        """The wrong statements of advisories, each with the releases that it is about."""
        releases_by_mistake = dict[tuple[str, str], list[str]]()
        for result in self.results:
            if result.mistake:
                releases_by_mistake.setdefault((result.advisory, result.mistake), []).append(
                    result.release
                )
        return [
            f"{name}: {mistake} ({', '.join(releases)})"
            for (name, mistake), releases in releases_by_mistake.items()
        ]

    @property
    def headline(self) -> str:
        """The number of advisories, releases and mistakes in a sentence."""
        names = {result.advisory for result in self.results}
        wrong = {result.advisory for result in self.results if result.mistake}
        releases = f"{len(self.releases)} release{'s' * (len(self.releases) != 1)}"
        size = f"{len(names)} {'advisory' if len(names) == 1 else 'advisories'}"
        return f"{len(wrong)} of {size} wrong" if wrong else f"{size} as written in {releases}"

    @property
    def problem(self) -> str:
        """The mistakes, if there are any."""
        return "\n".join(self.mistakes)
