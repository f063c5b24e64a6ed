"""The request of a tune study, and checks for contradictory options."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from contactlab.errors import SweepFileError
from contactlab.modifications.modification import ReductionName
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.studies.search.forward_error import ErrorTime


@dataclass(frozen=True)
class TuneRequest:
    """The model to tune, and the target.

    Attributes:
        model: a scene, its folder, a model file, or a robot.
        task: options that replace parts of the model's task; of its limits, only the tolerance.
        error: target error: a share, or in the unit of the observed output; None for that of the
            model as written, at most the tolerance.
        real_time: if given, find the most accurate settings at this multiple of real time.
        observed: bodies, sites and sensors of a forward error.
        error_at: when the forward error is measured; None for the error budget.
        max_cpu: limit of CPU time [s].
        pick: number of a point of the front to write and verify.
        apply: reductions without a proof, by name, with their distance [m] if they have one.
    """

    model: str
    task: TaskOptions = AS_INFERRED
    error: float | None = None
    real_time: float | None = None
    observed: Sequence[str] = ()
    error_at: ErrorTime | None = None
    max_cpu: float = 120.0
    pick: int | None = None
    apply: Mapping[ReductionName, float | None] = field(
        default_factory=dict[ReductionName, float | None]
    )


def refuse_contradictions(request: TuneRequest) -> None:
    """Refuse options that would be ignored."""
    refuse_metrics(request.task)
    if request.real_time is not None and request.error is not None:
        raise SweepFileError("--real-time minimizes the error; remove --error")
    if request.error_at is not None and not request.observed:
        raise SweepFileError("--error-at needs --observe BODY, SITE or SENSOR")
    if request.error_at is not None and request.error is None:
        raise SweepFileError("--error-at needs a target: --error 1e-5")
    if request.error_at is None and request.error is not None and not 0 < request.error < 1:
        raise SweepFileError(
            f"--error {request.error:g} is not a fraction; write for example 2%, or for a forward "
            "error --observe hand --error-at end --error 1e-5"
        )


def refuse_metrics(task: TaskOptions) -> None:
    """Refuse tolerances of metrics, which the error budget does not use."""
    if task.limits:
        name = next(iter(task.limits))
        raise SweepFileError(
            f"--tolerance {name}=: tune uses the error budget; write a share, "
            "--tolerance 5%, or weigh metrics with a sweep: contactlab tradeoff SWEEP"
        )
