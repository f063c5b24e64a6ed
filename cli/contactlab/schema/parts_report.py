"""The report of `contactlab effects MODEL`: what each feature and part of a model is worth."""

from typing import Literal

from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task

PARTS_VERSION = 1
REPORT = "parts.json"

PartKind = Literal["feature", "geom", "pair", "limit", "tendon", "actuator"]
Worth = Literal[
    "provably unused",
    "unused in this task, kept",
    "below the tolerance",
    "needed",
    "not measured, kept",
]


class PartWorth(Model):
    """One feature or part, left out of the model as written."""

    kind: PartKind
    name: str
    worth: Worth
    exercised: bool = about("Whether any step of the task, of it tilted or doubled, uses it.")
    share: float | None = about(
        "Largest share of the real forces by which the motion without it differs, of the worst "
        "body; null if it is not exercised, or the engine gave up."
    )
    body: str = about("The worst; empty without a share.")
    phase: str
    time: float | None = about("When its worst window begins [s since the phase began].")
    price: BudgetPrice | None = about("Time without it over time with it; null if not timed.")
    reason: str = about("A proof, or why it is kept whatever it saves; else empty.")


class PartsReport(Model):
    """What each feature and part of a model is worth (`parts.json`). Units are SI."""

    parts_version: Literal[1] = PARTS_VERSION
    model: str = about("As given.")
    scene_hash: str
    mujoco: str
    task: Task = about("What it is judged on, then with gravity tilted, then by twice its inputs.")
    tilt: float = about("Of gravity in the other runs [degrees].")
    within: float = about("The tolerance, a share.")
    parts: tuple[PartWorth, ...]
    twin: BudgetPrice | None = about("Time of the model beside itself: what noise is.")
    ended: bool = about("Whether the time was over before all parts were measured.")
    seconds: float = about("Wall time that it took.")
