"""What `tune` is asked: which model, for what, in which time; and what contradicts itself."""

from collections.abc import Sequence
from dataclasses import dataclass

from contactlab.errors import SweepFileError
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.studies.search.forward import When


@dataclass(frozen=True)
class TuneRequest:
    """Which model to tune, and for what.

    Attributes:
        model: a scene, its folder, a model file, or a robot.
        task: what replaces parts of the model's own; of its limits, only the tolerance.
        error: largest error: a share, or of what is watched in its unit; None for what the model is
            uncertain by.
        real_time: the most accurate settings at so many times real time are wanted instead.
        watched: bodies, sites and sensors whose forward error counts.
        at: when that is looked at; None for the error budget.
        max_time: wall time that it may take [s].
        drop_sensors: whether sensors may go, since nobody reads them.
        apart: distance [m]: collisions of what stayed so far apart in all that was run may go.
        hulls: distance [m]: hulls of meshes may have fewer vertices that reach as far but for that.
    """

    model: str
    task: TaskOptions = AS_INFERRED
    error: float | None = None
    real_time: float | None = None
    watched: Sequence[str] = ()
    at: When | None = None
    max_time: float = 120.0
    drop_sensors: bool = False
    apart: float | None = None
    hulls: float | None = None


def refuse_contradictions(request: TuneRequest) -> None:
    """Refuse options of which one would be ignored."""
    refuse_metrics(request.task)
    if request.real_time is not None and request.error is not None:
        raise SweepFileError("--real-time asks for the least error; leave --error out")
    if request.at is not None and not request.watched:
        raise SweepFileError("--at needs what is watched: --observe BODY, SITE or SENSOR")
    if request.at is not None and request.error is None:
        raise SweepFileError("--at needs the largest forward error: --error 1e-5")
    if request.at is None and request.error is not None and not 0 < request.error < 1:
        raise SweepFileError(
            f"--error {request.error:g} is no share of the real forces; write 2%, or what is "
            "watched and when: --observe hand --at end --error 1e-5"
        )


def refuse_metrics(task: TaskOptions) -> None:
    """Refuse tolerances of metrics, which the error budget would not heed."""
    if task.limits:
        name = next(iter(task.limits))
        raise SweepFileError(
            f"--tolerance {name}=: settings are judged by the error budget; write a share, "
            "--tolerance 5%, or weigh metrics with a sweep: contactlab tradeoff SWEEP"
        )
