"""What a job is told of one check, whichever command makes it, and how a failure is accepted."""

from datetime import date
from typing import Annotated, Literal

from pydantic import Field

from contactlab.schema.strict_model import Model, Whole, Word, about

CheckOutcome = Literal["failed", "warned", "noted", "passed", "skipped"]
Count = Annotated[Whole, Field(ge=0)]


class JudgedCheck(Model):
    """One thing that was judged."""

    name: str
    group: str = about("Which part of what was judged; or empty.", default="")
    outcome: CheckOutcome = about("Its effect on the job.")
    failing: int = about("How many of those that were judged fail.")
    message: str = about("The result, in words.")
    accepted: str | None = about("Why it is accepted.", default=None)

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

    check: Word = about("the check's name")
    group: Word | None = about("its group; all groups if left out", default=None)
    max: Count = about("how many runs may fail it")
    reason: Word = about("why it is accepted")
    until: date | None = about("last accepted day, YYYY-MM-DD", default=None)


class Acceptances(Model):
    """The failing checks that are known and accepted."""

    version: Literal[1] = about("version of this file format: 1")
    accept: tuple[AcceptedCheck, ...] = about("checks that may fail", default=())
