"""A finding: the result of one check, with its effect on a job; and waivers of findings.

All judges use these words: check, compare, lock, parity, and sweeps with expectations.
"""

from collections.abc import Mapping
from datetime import date
from typing import Annotated, Literal

from pydantic import Field

from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, Whole, Word, about

Level = Literal["gate", "warn", "note"]
LEVEL = "gate: fails the job; warn: a warning; note: reported only"
Outcome = Literal["failed", "warned", "noted", "passed", "skipped"]
Change = Literal["better", "same", "worse", "changed", "missing", "not comparable"]
Verdict = Literal[Change, "met", "unmet", "not applicable"]
Count = Annotated[Whole, Field(ge=0)]


class RunPair(Model):
    """Two runs that were compared, or one without a counterpart."""

    baseline_run: str | None
    candidate_run: str | None
    axes: dict[str, Setting]
    baseline: float | str | None
    candidate: float | str | None


class Finding(Model):
    """Result of one check; the set of findings does not depend on their outcomes."""

    name: str
    kind: str = about("The part of the judgement; for a model, the name of the check.")
    group: str = about("Axis values of its runs, such as cone=elliptic; or empty.", default="")
    level: Level = about(f"Of a failure. {LEVEL}.")
    outcome: Outcome = about("Its effect on the job.")
    verdict: Verdict = about("A change, or whether a limit or an expectation is met.")
    judged: int = about("Number of runs, groups of runs, or measures that were judged.")
    failing: int = about("Number of these that fail.")
    counts: dict[Verdict, int] = about("Number of these with each verdict.", default={})
    message: str = about("The result, in words.")
    value: float | None = about("The worst value that has a limit; otherwise null.", default=None)
    limit: float | None = about("The limit of this value.", default=None)
    unit: str = ""
    waived: str | None = about("Reason of its waiver; null without one.", default=None)
    worst: tuple[RunPair, ...] = about("The worst few pairs of runs.", default=())

    @property
    def full_name(self) -> str:
        """Its name with its group."""
        return f"{self.name} ({self.group})" if self.group else self.name

    @property
    def full_message(self) -> str:
        """Its message, with the reason of its waiver."""
        return f"{self.message}; waived: {self.waived}" if self.waived else self.message

    @property
    def is_open(self) -> bool:
        """Whether it is a gate that could not be judged."""
        return self.outcome == "skipped" and self.level == "gate"


SEVERITIES: Mapping[Level, str] = {"gate": "error", "warn": "warning", "note": "note"}
"""The words of linters and of CI for levels."""


class PlacedFinding(Finding):
    """A finding in a line of a file."""

    file: str = about("The file, relative to the working directory if it lies there.")
    line: int = about("The line in it, from 1.")
    fix: tuple[str, ...] = about("Lines that fix it: FILE:LINE: ELEMENT.", default=())
    docs: str = about("The page of the rule.", default="")

    @property
    def severity(self) -> str:
        """Its level in the word of linters."""
        return SEVERITIES[self.level]


class Waiver(Model):
    """A check that may fail, for a stated reason; `contactlab compare --waive` writes these."""

    check: Word = about("name of the check")
    group: Word | None = about("its group; all groups if left out", default=None)
    max: Count = about("largest number of runs that may fail the check")
    reason: Word = about("why it may fail")
    until: date | None = about("last day of the waiver, YYYY-MM-DD", default=None)


class Waivers(Model):
    """Checks that may fail."""

    version: Literal[1] = about("version of this file format: 1")
    waive: tuple[Waiver, ...] = about("checks that may fail", default=())
