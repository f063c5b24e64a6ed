"""The verdict of a task: its numerics and its failure labels, phase by phase."""

from contactlab.schema.strict_model import FiniteOrNull, Model, about
from contactlab.schema.verdict import VerdictWord


class PhaseVerdict(Model):
    """The numerics and the failure labels of one phase of a task."""

    name: str = about("The phase.")
    numerical_error: FiniteOrNull = about(
        "Residual force as a share of the real forces, of the worst observed body; null if "
        "infinite or not measured."
    )
    body: str | None = about("That body; null if not measured.")
    labels: dict[str, int] = about("Number of runs by each label that begins in it.", default={})


class TaskVerdict(Model):
    """The verdict of a task: of its observed bodies, in its worst phase."""

    verdict: VerdictWord | None = about(
        "Verdict of the numerics; null if nothing moves, or MuJoCo does not simulate it."
    )
    sentence: str = about("The verdict in a sentence.")
    phases: tuple[PhaseVerdict, ...]

    @property
    def is_accurate(self) -> bool:
        """Whether the runs are the motion of their model."""
        return self.verdict in {None, "ok"}

    @property
    def labels(self) -> dict[str, list[str]]:
        """The phases where each label begins."""
        phases_by_label: dict[str, list[str]] = {}
        for phase in self.phases:
            for label in phase.labels:
                phases_by_label.setdefault(label, []).append(phase.name)
        return phases_by_label

    @property
    def line(self) -> str:
        """The verdict in one line, for below the line of the task."""
        labels = [f"{name} ({', '.join(phases)})" for name, phases in sorted(self.labels.items())]
        return f"numerics {self.sentence}; failure labels: {', '.join(labels) or 'none'}"
