"""Checks of a model, the catalogue of hard cases, and the reference of a run."""

from typing import Literal

from pydantic import RootModel

from contactlab.schema.evidence import Engine, Setting
from contactlab.schema.finding import LEVEL, Level
from contactlab.schema.report_model import DescribedReport
from contactlab.schema.strict_model import FiniteOrNull, Model, about

CheckVerdict = Literal["pass", "warning", "fail", "not applicable"]


class Measure(Model):
    """One number that a check measured."""

    name: str
    of: str | None = about("The pair, body or setting that it belongs to; null if all.")
    value: FiniteOrNull = about("Null if it could not be measured.")
    unit: str
    limit: FiniteOrNull = about("Its limit; null if it is only reported.")
    holds: bool | None = about("Whether the limit is met; null if it is only reported.")
    level: Level = about(f"Of an exceeded limit. {LEVEL}.", default="note")


class CheckResult(Model):
    """One check of a model."""

    name: str = about("task, requirements, inertia, repeat; or a plug-in's")
    question: str = about("The question that it answers.")
    verdict: CheckVerdict
    reason: str
    measures: tuple[Measure, ...] = ()
    notes: tuple[str, ...] = about("Further remarks.", default=())
    stores: tuple[str, ...] = about(
        "Its evidence: stores, relative to the folder of the examination.", default=()
    )


class Reference(Model):
    """One run of one environment, which a parallel engine must reproduce (`reference.json`)."""

    check_version: Literal[1] = 1
    scene: str
    scene_hash: str
    store: str = about("The store that holds the run, relative to this file.")
    run_id: str
    trajectory_hash: str
    engine: Engine
    settings: dict[str, Setting]
    seed: int
    duration: float = about("s")
    success: bool = about("Whether the run is labeled stable.")
    label: str
    metrics: dict[str, float] = about("Values to reproduce, by metric.")
    units: dict[str, str]
    tolerance: float = about("Largest relative difference from each metric.")
    resolution: dict[str, float] = about("Absolute differences below this count as none.")


class StabilityResult(Model):
    """One hard case."""

    name: str
    runs: int
    expected: int = about("Number of runs that have an expectation.")
    as_expected: int = about("Number of these that are as expected.")
    controls: int = about("Runs that are expected to fail, and did.")
    labels: dict[str, int] = about("Runs by worst label.")
    error: FiniteOrNull = about(
        "Largest oracle error of runs that are expected to be stable; null without an oracle."
    )
    step: int | None = about("Earliest step at which such a run failed; null if none did.")
    misses: tuple[str, ...] = about("Unmet expectations, by the start of a run's id.")
    seconds: float = about("Wall time [s].")
    store: str = about("The evidence.")
    skipped: tuple[str, ...] = about("Why runs that need a newer engine were skipped.")

    @property
    def passed(self) -> bool:
        """Whether there were expectations, and all were met."""
        return self.as_expected == self.expected > 0


class StabilityReport(DescribedReport, RootModel[tuple[StabilityResult, ...]]):
    """Every case that could be run."""

    @property
    def cases(self) -> tuple[StabilityResult, ...]:
        """The results, in the order of the cases."""
        return self.root

    @property
    def problem(self) -> str:
        """The cases that failed."""
        failed = [case.name for case in self.root if not case.passed]
        count = f"{len(failed)} of {len(self.root)} cases failed"
        return f"{count}: {', '.join(failed)}" if failed else ""

    @property
    def passed(self) -> bool:
        """True if every case passed."""
        return all(report.passed for report in self.root)
