"""The report of `contactlab engines panel`: engines beside closed forms."""

from contactlab.schema.strict_model import Model, about


class PanelRun(Model):
    """One run of a task by an engine."""

    task: str
    engine: str
    step: float = about(
        "Timestep; of engines that choose their own, of what is recorded.", unit="s"
    )
    accuracy: float | None = about("Of the error control; null where there is none.")
    error: float | None = about(
        "Off the closed form: relative, or in SI units where that is 0; null if a run failed."
    )
    energy: float | None = about("Gained or lost over what there was.", unit="1")
    depth: float | None = about("Deepest contact.", unit="m")
    cost: float | None = about("CPU time of stepping alone, for a second of the task.", unit="s")
    label: str = about("Of the run, or why it failed.")


class PanelTask(Model):
    """A task with a closed form."""

    name: str
    description: str
    measure: str = about("What the error is of.")


class EnginePanel(Model):
    """Every engine that is here on tasks with a closed form, at three steps or accuracies."""

    engines: dict[str, str] = about("Versions by name.")
    tasks: tuple[PanelTask, ...]
    runs: tuple[PanelRun, ...]
    left_out: tuple[str, ...] = about("Engines that cannot do a task, or are not here, and why.")
