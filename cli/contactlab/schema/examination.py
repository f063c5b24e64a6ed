"""The report of `contactlab examine`: a verdict on a model's simulation under its task."""

from typing import Literal

from contactlab.schema.error_budget import BudgetPrice, BudgetReport
from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task


class Fact(Model):
    """What is deep, overlaps, or weighs what no body can; it judges nothing."""

    kind: Literal["depth", "overlap", "force", "inertia"]
    place: str = about("The contact, or the body.")
    value: float
    unit: str
    sentence: str


class ModelChange(Model):
    """A change that removes what the verdict names, on the task's seeds and on fresh ones."""

    name: str
    physics: bool = about("Whether it makes another model, not another computation of this one.")
    options: dict[str, Setting] = about("The options that it changes.")
    share: float | None = about("What is left of the reason's share; null if infinite.")
    price: BudgetPrice | None = about("Time with the change over time without; null if unknown.")
    lines: tuple[str, ...] = about("The lines of the model's files, each after FILE:LINE.")
    unwritten: str = about("Why there are no lines.", default="")


class Examination(Model):
    """The error budget of a model under its task, and what it says."""

    model: str = about("The scene or model, as it was named.")
    mujoco: str = about("Version of MuJoCo.")
    task: Task
    sentence: str = about("The verdict in one sentence: what, where, when, and what removes it.")
    budget: BudgetReport = about("Times in it count from the beginning of the phase.")
    facts: tuple[Fact, ...] = ()
    changes: tuple[ModelChange, ...] = about("At most three, the cheapest first.", default=())
    written: str | None = about("The changed model's file, if one was written.", default=None)

    @property
    def sound(self) -> bool:
        """True if the run is the motion of its model.

        How soft that model is, is told and fails nothing: softness may be meant.
        """
        return self.budget.verdict in {"sound", "model"}
