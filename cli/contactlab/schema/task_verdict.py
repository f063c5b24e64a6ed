"""What the runs of a task come to: its numerics and its labels, phase by phase."""

from contactlab.schema.error_budget import BudgetWord
from contactlab.schema.strict_model import Model, Number, about


class PhaseVerdict(Model):
    """What is found in one phase of a task."""

    name: str = about("The phase.")
    share: Number | None = about(
        "Phantom forces over real ones, of the watched body that is worst; null if infinite, or "
        "not measured."
    )
    body: str | None = about("That body; null if not measured.")
    labels: dict[str, int] = about("Runs by each label that is first met in it.", default={})


class TaskVerdict(Model):
    """The verdict of a task: of its watched bodies, in its worst phase."""

    word: BudgetWord | None = about(
        "Of the numerics; null where nothing moves, or MuJoCo does not simulate it."
    )
    sentence: str = about("Says it.")
    phases: tuple[PhaseVerdict, ...]

    @property
    def sound(self) -> bool:
        """Whether the runs are the motion of their model."""
        return self.word in {None, "sound"}

    @property
    def labels(self) -> dict[str, list[str]]:
        """The phases in which each label is first met."""
        found: dict[str, list[str]] = {}
        for phase in self.phases:
            for label in phase.labels:
                found.setdefault(label, []).append(phase.name)
        return found

    @property
    def line(self) -> str:
        """It in one line, below that of the task."""
        held = [f"{name} ({', '.join(phases)})" for name, phases in sorted(self.labels.items())]
        return f"numerics {self.sentence}; labels: {', '.join(held) or 'none'}"
