"""The report of a verification: each measure of a changed model next to that of the original."""

from contactlab.schema.strict_model import FiniteOrNull, Model, about


class VerifiedMeasure(Model):
    """One measure in one run, of the original model and of the changed one."""

    name: str = about("The measure, such as `depth`.")
    run: str = about("The run that it was measured in, such as `tilted by 20 degrees`.")
    unit: str = about("Unit of its numbers; `1` for a share.")
    before: FiniteOrNull = about("Value of the original model; null if not finite.")
    after: FiniteOrNull = about("Value of the changed model; null if not finite.")
    spread: float = about("By how much it differs among repetitions of the original.")
    tolerance: float = about("By how much it may be worse; at least the spread.")
    place: str = about("Body, contact, joint or actuator with the largest value; may be empty.")
    more_is_better: bool = about("Whether it must not shrink instead.", default=False)
    worse: bool = about("Whether it is worse by more than the tolerance.")


class SkippedRun(Model):
    """A run that was not made."""

    run: str
    reason: str


class VerifiedChange(Model):
    """Whether a changed model is worse than the original in any measure."""

    verification_version: int = 1
    seeds: tuple[int, ...] = about("Seeds of the task that both models ran.", default=())
    fresh_seeds: tuple[int, ...] = about("Seeds that no setting was chosen by.", default=())
    measures: tuple[VerifiedMeasure, ...] = ()
    skipped: tuple[SkippedRun, ...] = about("Runs that were not made, with the reason.", default=())
    identical: bool = about("Whether every run has the bits of the original's.")
    passed: bool = about("Whether no measure is worse, and those that must improve do.")
    sentence: str = about("The result in one line.")
    ended_early: bool = about("Whether a limit on time ended it.", default=False)

    @property
    def line(self) -> str:
        """The result after a word that says how much was verified."""
        if self.ended_early and not self.measures:
            return f"not verified: {self.sentence}; --write verifies it"
        return f"verified{' in part' * self.ended_early}: {self.sentence}"
