"""Checks of a model, and the decorator that declares one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from contactlab.judge.limits import LIMITS, Limit
from contactlab.registry import Registry
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.check_results import check_result
from contactlab.tasks.checked_model import CheckedModel


class Measured(NamedTuple):
    """Result of a check: without measures it does not apply, for the reason of its first note."""

    measures: Sequence[Measure]
    notes: Sequence[str] = ()
    stores: Sequence[str] = ()  # its evidence: names of stores


CheckFunction = Callable[[CheckedModel], Measured]


@dataclass(frozen=True)
class Check:
    """One question about a model, answered by measures with limits.

    Attributes:
        name: its name on the command line and in reports.
        question: the criterion, in words.
        function: measures a model.
        limits: limits of its measures; waivers and --tolerance use their names.
        findings: names of measures that state a limit of their own.
        place: where it stands among the checks of a report, the least first.
    """

    name: str
    question: str
    function: CheckFunction
    limits: tuple[Limit, ...] = ()
    findings: tuple[str, ...] = ()
    place: float = 100

    def __call__(self, checked: CheckedModel) -> CheckResult:
        """Return the result for a model."""
        return check_result(self.name, self.question, *self.function(checked))


class _Checks(Registry[Check]):
    """Checks in the order of a report."""

    def add(self, entry: Check) -> Check:
        """Add a check and its limits."""
        for limit in entry.limits:
            LIMITS.add(limit)
        super().add(entry)
        ordered = sorted(self.values(), key=lambda check: check.place)
        self.clear()
        self.update({check.name: check for check in ordered})
        return entry


CHECKS: Registry[Check] = _Checks("check")


def check(
    name: str,
    *,
    question: str,
    limits: tuple[Limit, ...] = (),
    findings: tuple[str, ...] = (),
    place: float = 100,
) -> Callable[[CheckFunction], CheckFunction]:
    """Declare a check: the function measures a `CheckedModel`, by `measure` with the limits.

    Arguments are those of `Check`. A PluginError if a name is taken.
    """

    def declare(function: CheckFunction) -> CheckFunction:
        CHECKS.add(Check(name, question, function, limits, findings, place))
        return function

    return declare
