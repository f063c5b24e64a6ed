"""An advisory: a known fault of an engine, with a model that shows it."""

from functools import cache
from typing import Annotated, Literal

from pydantic import Field

from contactlab.schema.strict_model import Flag, Model, Number, Value, Whole, Word, about

Release = Annotated[str, Field(pattern=r"^\d+(\.\d+)*$")]
"""The number of a release, such as 3.11.0."""
Severity = Literal["wrong result", "crash", "slow"]
ALL_EARLIER = "0"
"""Stands for all earlier releases, as the release that introduced a fault."""


@cache
def numbers_of(version: str) -> tuple[int, ...]:
    """Return the numbers of a version, without its other parts."""
    return tuple(int(part) for part in version.split(".") if part.isdigit())


class AffectedReleases(Model):
    """A range of releases that have the fault."""

    introduced: Release = about("The first release with the fault; 0 for all earlier ones.")
    fixed: Release | None = about("The first release without it; leave out if none.", default=None)

    def __str__(self) -> str:
        """Return the range in words."""
        first_release = "" if self.introduced == ALL_EARLIER else f"{self.introduced} "
        return f"{first_release}before {self.fixed}" if self.fixed else f"from {self.introduced}"

    def includes_release(self, version: str) -> bool:
        """Return whether a release is in the range."""
        numbers = numbers_of(version)
        is_introduced = self.introduced == ALL_EARLIER or numbers_of(self.introduced) <= numbers
        return is_introduced and (self.fixed is None or numbers < numbers_of(self.fixed))


class Witness(Model):
    """A small model that shows the fault, and the number that shows it."""

    model: Word = about("MJCF or URDF text without other files, of at most a few bodies.")
    keyframe: str = about("Name of the keyframe to start from; qpos0 without one.", default="")
    saved: Flag = about(
        "Save the model as MJCF, and load that, before anything else.", default=False
    )
    steps: Annotated[Whole, Field(ge=0)] = about(
        "Number of steps before the forward computation that is measured.", default=0
    )
    measure: Word = about("Expression over fields of mjModel and mjData.")
    right: Number = about("Its right value.")
    wrong: Number = about("Its value in affected releases, at least half of the way there.")
    tolerance: Annotated[Number, Field(ge=0)] = about(
        "Distance from the right value that is right."
    )
    reason: Word = about("The source of the right value: a closed form, or another computation.")


class Workaround(Model):
    """Settings that avoid the fault, of one modification of the catalogue."""

    modification: Word = about("Name of an entry of docs/reference/modifications.md.")
    settings: dict[Word, Value] = about("Values by the names of settings, as in a sweep.")


class Advisory(Model):
    """A known fault of an engine: the affected releases, the affected models, and a witness."""

    id: Annotated[str, Field(pattern=r"^[A-Z]{2,8}-\d{4}-\d{4}$")] = about(
        "Prefix of who publishes it, year and number: CL-2026-0001."
    )
    title: Word = about("The fault in one line.")
    consequence: Word = about("How it shows in a simulation, in one or two sentences.")
    engine: Word = about("Name of the engine.", default="mujoco")
    affected: tuple[AffectedReleases, ...] = about("The releases that have it.", min_length=1)
    severity: Severity = about("Its worst consequence.")
    applies: Word = about("Expression over fields of mjModel: whether a model may meet the fault.")
    occurs: str = about(
        "Expression over fields of mjModel and mjData: whether the fault can act in a state of a "
        "run; leave out if it can in every state.",
        default="",
    )
    witness: Witness = about("The model that shows it.")
    workarounds: tuple[Workaround, ...] = about("Ways to avoid it, the best one first.", default=())
    advice: str = about("What to do if no setting avoids it, in one sentence.", default="")
    sources: tuple[Annotated[str, Field(pattern=r"^https://")], ...] = about(
        "Public pages that describe it.", default=()
    )

    def affects_release(self, version: str) -> bool:
        """Return whether a release has the fault."""
        return any(releases.includes_release(version) for releases in self.affected)

    def find_fixed_release(self, version: str) -> str | None:
        """Return the first release after an affected one that is without the fault, if any."""
        return next((each.fixed for each in self.affected if each.includes_release(version)), None)
