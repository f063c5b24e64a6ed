"""Errors of a model without some of its parts, and the verdict on each part."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco

from contactlab.budget import Motion, Settings, error_budget
from contactlab.budget.restarts import build_reference_model
from contactlab.contact.trace_arrays import Floats
from contactlab.schema.effects_report import PartVerdict
from contactlab.schema.time_ratio import TimeRatio
from contactlab.studies.effects.model_parts import ModelPart, change_model
from contactlab.tasks.reference_error import ErrorEstimate, TaskReference

LOAD_MARGIN = 0.5
"""Largest share of the tolerance that counts as below it: other pushes may have twice, or half, the
effect of those in the task."""


@dataclass
class PartErrors:
    """Errors of models without parts, in windows of the task and under other loads."""

    reference: TaskReference
    same: Sequence[Floats]
    motions: Sequence[Motion]
    threads: int

    def estimate_error(self, parts: Sequence[ModelPart]) -> ErrorEstimate:
        """Return the error without some parts, or the larger one of those that are added."""
        left_out = [part for part in parts if not part.adds]
        added = [self._measure_added(part) for part in parts if part.adds]
        estimates = list[ErrorEstimate](added)
        if left_out:

            def make_without(model: mujoco.MjModel) -> mujoco.MjModel:
                changed = build_reference_model(model, 1)
                for part in left_out:
                    part.change(changed)
                return changed

            estimates.append(self.reference.error_against(make_without, self.same))
        return max(estimates, key=lambda estimate: estimate.error)

    def _measure_added(self, part: ModelPart) -> ErrorEstimate:
        # Windows begin awake, so that only whole runs show sleep.
        runs = [replace(each, model=change_model(each.model, part.change)) for each in self.motions]
        settings = Settings(places=False, excess=False, workers=self.threads)
        budget = error_budget(runs, rows=("sleep",), settings=settings)
        rows = [(row, phase) for phase in budget.phases for row in phase.rows if row.exercised]
        if not rows:
            return ErrorEstimate(0.0, "", "", 0.0, 0.0, 0.0)
        row, phase = max(rows, key=lambda pair: pair[0].error)
        return ErrorEstimate.of_reading(phase, row)


@dataclass
class MeasuredPart:
    """A part with its verdict, its error, and the time of the model without it.

    There is no error if it was not measured. The counted cost of the model without it decides
    whether it goes, since load changes the measured time; it is 1 if it was not counted.
    """

    part: ModelPart
    error: ErrorEstimate | None = None
    ratio: TimeRatio | None = None
    cost: float = 1.0
    late: bool = False

    @property
    def saves_work(self) -> bool:
        """Whether a smaller model may gain by leaving it out.

        Collisions and sensors that nothing uses go even if they hardly cost anything.
        """
        if self.part.proof and self.part.kind != "feature":
            return self.cost <= 1
        least_saving = 0.01  # of the counted time, since a feature costs a changed line
        return self.cost < 1 - least_saving

    @property
    def verdict_at(self) -> "PartVerdict | None":
        """The verdict that needs no tolerance; None if the error decides."""
        if self.part.proof:
            return "unused"
        if not self.part.exercised:
            return "not exercised"
        if self.part.kind == "actuator":
            return "needed"
        return "not measured" if self.error is None else None

    def find_verdict(self, tolerance: float) -> "PartVerdict":
        """Return the verdict at a tolerance."""
        if (verdict := self.verdict_at) is not None:
            return verdict
        error = math.inf if self.error is None else self.error.error
        if error > LOAD_MARGIN * tolerance:
            return "near the tolerance" if error <= tolerance else "needed"
        return "not exercised" if self.part.carries_loads else "below the tolerance"

    def can_go(self, tolerance: float) -> bool:
        """Return whether a smaller model may lack it."""
        free = bool(self.part.assumed) or self.find_verdict(tolerance) in (
            "unused",
            "below the tolerance",
        )
        return free and not self.part.reason_to_stay and self.part.edits is not None
