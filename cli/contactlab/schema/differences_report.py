"""The report of `contactlab advisories find`: differences of two releases, by cause."""

from typing import Literal

from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about


class RefusedModel(Model):
    """A model that was not compared."""

    model: str
    reason: str


class DifferenceGroup(Model):
    """Differences of the same quantity in the same stage of a step."""

    stage: str = about("First stage that differs, in the order of their computation.")
    quantity: str = about("The quantity, with kinds of geoms instead of their names.")
    models: tuple[str, ...] = about("The models with this difference.")
    place: str = about("The quantity in the first of these models.")
    first: FiniteOrNull = about("Its value under the first release.", default=None)
    second: FiniteOrNull = about("Its value under the second release.", default=None)
    faulty: str = about("The release at fault; empty if nothing decides, so that it is a change.")
    reason: str = about("The computation that decides, or why nothing does.")
    bodies: int = about("Number of bodies of the smallest model found.")
    draft: str = about("File of the drafted advisory.")
    listed: tuple[str, ...] = about(
        "Listed advisories that one of the releases has, and that this model meets.", default=()
    )


class DifferencesReport(ReportModel):
    """Differences of two releases over a corpus (`advisories find --format json`)."""

    differences_version: Literal[1] = 1
    releases: tuple[str, str]
    compared: int = about("Number of models that were compared.")
    states: int = about("Number of states that both releases began in.")
    refused: tuple[RefusedModel, ...] = about("Models that were not compared.", default=())
    groups: tuple[DifferenceGroup, ...] = about("By stage, those of most models first.")

    @property
    def headline(self) -> str:
        """The result in a sentence."""
        faults = sum(bool(group.faulty) for group in self.groups)
        changes, (first, second) = len(self.groups) - faults, self.releases
        counts = ((faults, "fault"), (changes, "change"), (self.compared, "model"))
        phrases = [f"{count} {word}{'s' * (count != 1)}" for count, word in counts]
        return f"{phrases[0]} and {phrases[1]} from {first} to {second}, in {phrases[2]}"

    @property
    def problem(self) -> str:
        """That no model was compared, if so."""
        return "" if self.compared else f"no model was compared: {self.refused[0].reason}"
