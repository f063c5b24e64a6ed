"""The report of `contactlab parity --closed-forms`: engines against closed forms."""

from typing import Literal

from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about

REPORT = "panel.json"
"""Name of its file."""


class PanelRun(Model):
    """One run of a task by an engine."""

    task: str
    engine: str
    step: float = about("Timestep; if the engine chooses its own, that of the recording.", unit="s")
    accuracy: FiniteOrNull = about("Accuracy of the error control; null without one.")
    error: FiniteOrNull = about(
        "Difference from the closed form: relative, or in SI units if that is 0; null if the run "
        "failed."
    )
    energy: FiniteOrNull = about("Gained or lost energy over the initial energy.", unit="1")
    depth: FiniteOrNull = about("Deepest contact.", unit="m")
    cost: FiniteOrNull = about("CPU time of stepping alone, for a second of the task.", unit="s")
    label: str = about("Label of the run, or why it failed.")


class PanelTask(Model):
    """A task with a closed form."""

    name: str
    description: str
    measure: str = about("The quantity of the error.")


class EnginePanel(ReportModel):
    """Every installed engine on tasks with a closed form, at three steps or accuracies."""

    panel_version: Literal[2] = 2
    engines: dict[str, str] = about("Versions by name.")
    tasks: tuple[PanelTask, ...]
    runs: tuple[PanelRun, ...]
    skipped: tuple[str, ...] = about(
        "Engines that cannot simulate a task, or are not installed, and why."
    )
