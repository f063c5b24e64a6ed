"""The report of `contactlab stability`: one result for each hard case."""

from pydantic import Field, RootModel

from contactlab.schema.strict_model import Model


class StabilityResult(Model):
    """One hard case."""

    name: str
    runs: int
    asked: int = Field(description="Runs that an expectation applies to.")
    met: int = Field(description="How many of these were as expected.")
    controls: int = Field(description="Runs that are expected to fail, and did.")
    labels: dict[str, int] = Field(description="Runs by worst label.")
    error: float | None = Field(
        description="Largest oracle error of runs that are expected to be stable; null without "
        "an oracle."
    )
    step: int | None = Field(
        description="Earliest step at which such a run failed; null if none did."
    )
    misses: tuple[str, ...] = Field(description="Unmet expectations, by the start of a run's id.")
    seconds: float = Field(description="Wall time [s].")
    store: str = Field(description="The evidence.")
    not_exercised: str | None = Field(
        default=None, description="What of a model no run exercised, and the drive that would."
    )
    left_out: tuple[str, ...] = Field(
        description="Why runs that need a newer engine were left out."
    )

    @property
    def passed(self) -> bool:
        """Whether there were expectations, and all were met."""
        return self.met == self.asked > 0


class StabilityReport(RootModel[tuple[StabilityResult, ...]]):
    """Every case that could be run."""

    @property
    def cases(self) -> tuple[StabilityResult, ...]:
        """The results, in the order of the cases."""
        return self.root

    @property
    def passed(self) -> bool:
        """Whether every case passed."""
        return all(each.passed for each in self.root)
