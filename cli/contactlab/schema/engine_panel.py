"""The report of `contactlab engines panel`: engines against closed forms."""

from typing import Literal

from contactlab.schema.strict_model import Model, about


class PanelRun(Model):
    """One run of a task by an engine."""

    task: str
    engine: str
    step: float = about("Timestep; if the engine chooses its own, that of the recording.", unit="s")
    accuracy: float | None = about("Accuracy of the error control; null without one.")
    error: float | None = about(
        "Difference from the closed form: relative, or in SI units if that is 0; null if the run "
        "failed."
    )
    energy: float | None = about("Gained or lost energy over the initial energy.", unit="1")
    depth: float | None = about("Deepest contact.", unit="m")
    cost: float | None = about("CPU time of stepping alone, for a second of the task.", unit="s")
    label: str = about("Label of the run, or why it failed.")


class PanelTask(Model):
    """A task with a closed form."""

    name: str
    description: str
    measure: str = about("The quantity of the error.")


class EnginePanel(Model):
    """Every installed engine on tasks with a closed form, at three steps or accuracies."""

    panel_version: Literal[2] = 2
    engines: dict[str, str] = about("Versions by name.")
    tasks: tuple[PanelTask, ...]
    runs: tuple[PanelRun, ...]
    skipped: tuple[str, ...] = about(
        "Engines that cannot simulate a task, or are not installed, and why."
    )
