"""What a job is told of one check, whichever command makes it, and how a failure is accepted."""

from datetime import date
from typing import Annotated, Literal

from pydantic import Field

from contactlab.schema.strict_model import Model, Whole, Word

CheckOutcome = Literal["failed", "warned", "noted", "passed", "skipped"]
Count = Annotated[Whole, Field(ge=0)]


class JudgedCheck(Model):
    """One thing that was judged."""

    name: str
    group: str = Field(default="", description="Which part of what was judged; or empty.")
    outcome: CheckOutcome = Field(description="Its effect on the job.")
    failing: int = Field(description="How many of those that were judged fail.")
    message: str = Field(description="The result, in words.")
    accepted: str | None = Field(default=None, description="Why it is accepted.")

    @property
    def full_name(self) -> str:
        """Its name with its group."""
        return f"{self.name} ({self.group})" if self.group else self.name

    @property
    def full_message(self) -> str:
        """Its message, and why it is accepted."""
        return f"{self.message}; accepted: {self.accepted}" if self.accepted else self.message


class AcceptedCheck(Model):
    """A failed check that is known and accepted; `contactlab compare --accept` writes these."""

    check: Word = Field(description="the check's name")
    group: Word | None = Field(default=None, description="its group; all groups if left out")
    max: Count = Field(description="how many runs may fail it")
    reason: Word = Field(description="why it is accepted")
    until: date | None = Field(default=None, description="last accepted day, YYYY-MM-DD")


class Acceptances(Model):
    """The failing checks that are known and accepted."""

    version: Literal[1] = Field(description="version of this file format: 1")
    accept: tuple[AcceptedCheck, ...] = Field(default=(), description="checks that may fail")
