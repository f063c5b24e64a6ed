"""The report of `contactlab examine`: a verdict on a model's simulation under its task."""

from contactlab.schema.error_budget import BudgetReport
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task


class Examination(Model):
    """The error budget of a model under its task, and what it says."""

    model: str = about("The scene or model, as it was named.")
    mujoco: str = about("Version of MuJoCo.")
    task: Task
    sentence: str = about("The verdict in one sentence: what, where, when, and what removes it.")
    budget: BudgetReport = about("Times in it count from the beginning of the phase.")

    @property
    def sound(self) -> bool:
        """True if the run is the motion of its model.

        How soft that model is, is told and fails nothing: softness may be meant.
        """
        return self.budget.verdict in {"sound", "model"}
