"""The report of `contactlab effects MODEL`: the influence of each feature and part of a model."""

from typing import Literal

from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about
from contactlab.schema.task import Task
from contactlab.schema.time_ratio import TimeRatio

PARTS_VERSION = 2
REPORT = "parts.json"

PartKind = Literal["feature", "geom", "pair", "limit", "tendon", "actuator"]
PartVerdict = Literal["unused", "not exercised", "below the tolerance", "needed", "not measured"]


class PartEffect(Model):
    """The model as written without one feature or part."""

    kind: PartKind
    name: str
    verdict: PartVerdict = about(
        "unused: by proof; not exercised: no run uses it, so it is kept; below the tolerance: the "
        "motion without it differs by less than the tolerance; needed: by more; not measured: the "
        "time limit was reached."
    )
    exercised: bool = about(
        "Whether any step uses it: of the task, with gravity tilted, or with twice the inputs."
    )
    error: FiniteOrNull = about(
        "Difference of the motion without it, as a share of the real forces, of the worst body; "
        "null if it is not exercised, or MuJoCo gave up."
    )
    body: str = about("The worst body; empty without an error.")
    phase: str
    time: FiniteOrNull = about("When its worst window begins [s since the phase began].")
    time_ratio: TimeRatio | None = about("Time without it over time with it; null if not timed.")
    reason: str = about("A proof, or why it is kept whatever it saves; otherwise empty.")


class PartsReport(ReportModel):
    """The influence of each feature and part of a model (`parts.json`). Units are SI."""

    parts_version: Literal[2] = PARTS_VERSION
    model: str = about("As given.")
    scene_hash: str
    mujoco: str
    task: Task = about("The task, which is run as it is, tilted, and with twice its inputs.")
    tilt: float = about("Tilt of gravity in the other runs [degrees].")
    tolerance: float = about("The tolerance, a share of the real forces.")
    parts: tuple[PartEffect, ...]
    noise_floor: TimeRatio | None = about("Time of the model over its own time: the noise.")
    timed_out: bool = about("Whether the time limit was reached before all parts were measured.")
    seconds: float = about("Wall time of the study.")
