"""The report of `contactlab effects`: features and parts of a model, and a smaller model."""

from typing import Literal

from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about
from contactlab.schema.task import Task
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.verification import VerifiedChange

REPORT, FOLDER = "effects.json", "smaller"
"""Files of the study's folder. The model is in `smaller`, with the files that it refers to."""

PartKind = Literal["feature", "geom", "pair", "limit", "tendon", "actuator", "sensor"]
PartVerdict = Literal[
    "unused",
    "not exercised",
    "below the tolerance",
    "near the tolerance",
    "needed",
    "not measured",
    "missing",
    "not needed",
]


class PartEffect(Model):
    """The model as written without one feature or part."""

    kind: PartKind
    name: str
    adds: bool = about("Whether it is added instead of left out, as sleep is.", default=False)
    members: tuple[str, ...] = about("The parts, if several go together.", default=())
    verdict: PartVerdict = about(
        "unused: by proof; not exercised: no run depends on it, so it is kept; below the "
        "tolerance: the motion without it differs by less than half of the tolerance; near the "
        "tolerance: by less than the tolerance, so it is kept; needed: by more, or it is an "
        "actuator that moves something; not measured: the time limit was reached. Against "
        "recordings, of added features, missing: runs are closer; not needed: they are not."
    )
    error: FiniteOrNull = about(
        "Difference of the motion without it, as a share of the real forces, of the worst body; "
        "null if it was not measured, or MuJoCo gave up."
    )
    body: str = about("The worst body; empty without an error.", default="")
    phase: str = ""
    time: FiniteOrNull = about(
        "When its worst window begins [s since the phase began].", default=None
    )
    time_ratio: TimeRatio | None = about("Time without it over time with it; null if not timed.")
    reason: str = about("A proof, or why it stays, whatever it saves; otherwise empty.")
    can_go: bool = about("Whether a smaller model may lack it.")


class SmallerModel(Model):
    """The model without the parts that may go together."""

    left_out: tuple[str, ...] = about("Names of the parts.")
    added: tuple[str, ...] = about("Features that it has in addition.", default=())
    error: FiniteOrNull = about("Error without all of them, as that of a part.")
    time_ratio: TimeRatio = about("Time over that of the model as written, for whole runs.")
    file: str = about("The written model; relative to the report unless it is in another folder.")
    lines: tuple[str, ...] = about("Changed lines of the model files.")
    verified: VerifiedChange | None = about(
        "Measures next to those of the model as written; null if each bit of the motion is equal."
    )
    sentence: str = about("How it was verified.")


class EffectsReport(ReportModel):
    """Features and parts of a model (`effects.json`). Units are SI."""

    effects_version: Literal[3] = 3
    model: str = about("The model, scene or sweep as given.")
    scene_hash: str
    mujoco: str
    task: Task = about("The task, which is run on its own, tilted, and with twice its inputs.")
    scenarios: int = about("Scenarios of a sweep that the task is run in; 1 otherwise.")
    recorded: bool = about(
        "Whether errors are changes of the mean distance from recorded runs.", default=False
    )
    tilt: float = about("Tilt of gravity in the other runs [degrees].")
    tolerance: float = about("The tolerance, a share of the real forces.")
    effects: tuple[PartEffect, ...] = about("Those that save most first.")
    noise_floor: TimeRatio | None = about("Time of the model over its own time: the noise.")
    smaller: SmallerModel | None = about("Null if no set of parts saves more than 3 %.")
    kept: dict[str, str] = about(
        "Parts that stay, since another load needs them, with the measure that was worse."
    )
    sentence: str = about("The result in a sentence.")
    timed_out: bool = about("Whether the time limit was reached before all parts were measured.")
    seconds: float = about("Wall time of the study.")
