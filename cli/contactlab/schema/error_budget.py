"""The report of an error budget: its verdict, and the rows of each phase."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, InfiniteAsNull, Model, about
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.verdict import VerdictWord

RowKind = Literal["numerics", "model", "effect", "unknown"]


class BudgetRow(Model):
    """Effect of one change: residual forces as a share of the real forces."""

    name: str = about("The row; `numerical error` is the run as written against the reference.")
    summary: str = about("The change.")
    kind: RowKind
    exercised: bool = about("Whether the task exercises the modified setting.")
    infinite: bool = about("Whether the engine failed, so that the error is infinite.")
    error: FiniteOrNull = about(
        "Of the worst body, the mean over seeds; null if not exercised, or infinite."
    )
    seeds: tuple[float, float] | None = about("Least and largest of any seed; null as above.")
    median: FiniteOrNull = about("Of all bodies; null as above.")
    by_mass: FiniteOrNull = about("Weighted by mass; null as above.")
    body: str | None = about("The worst body; null if not exercised.")
    place: str | None = about(
        "The contact, joint, tendon or equality whose impulse on that body differs most in the "
        "worst window; null if not known."
    )
    speed: FiniteOrNull = about(
        "Defect of the worst body, the mean over windows [m/s]; the speed of a creep."
    )
    seed: int | None = about("Of the worst window; null if not exercised.")
    time: FiniteOrNull = about("When the worst window begins [s]; null if not exercised.")
    time_ratio: TimeRatio | None = about(
        "Of the change in the model's own settings; null if not measured."
    )


class BudgetWarning(Model):
    """A warning of the engine in the run."""

    kind: str
    place: str = about("The joint, actuator or body that it names; empty if none.")
    cause: str = about("Where forces first differ from the reference; empty if not known.")
    seed: int
    time: float = about("When the window of the warning begins [s].")


class BudgetPhase(Model):
    """The budget of one phase, which is judged alone."""

    name: str
    timestep: float = about("Of the run [s].")
    steps: int = about("Of each seed.")
    seeds: int
    seeds_above: int = about("Seeds with a numerical error above the tolerance.", default=0)
    window: float = about("Length of windows [s].")
    windows: int = about("Number of windows of each seed.")
    bodies: tuple[str, ...] = about("The observed bodies, which move and have mass.")
    numerical_error: BudgetRow = about("The run as written against the reference.")
    rows: tuple[BudgetRow, ...]
    energy_drift: FiniteOrNull = about(
        "Energy that drifts in the run and not in a reference, as a share; null if infinite."
    )
    excess_path: FiniteOrNull = about(
        "Path of the run's velocity beyond the reference's; not judged."
    )
    worst_window: FiniteOrNull = about("Worst window over the body's largest speed; not judged.")
    upper_bound: FiniteOrNull = about(
        "Largest numerical error that the convergence of the references at h/4 and h/8 allows, "
        "worst body; null if infinite or unchecked."
    )
    limit_factor: float = about(
        "Factor of the errors of the run, from a reference at h/4 to the limit of fine steps."
    )
    invalid_windows: float = about("Share of windows in which the reference failed.")
    warnings: tuple[BudgetWarning, ...]


class BudgetReason(Model):
    """A number that is above the tolerance."""

    verdict: VerdictWord = about("The verdict that it alone would give.")
    phase: str
    row: str = about("A row, or `energy`, `reference`, `warning`.")
    error: InfiniteAsNull = about("The number, as a share; null if infinite.")
    body: str = about("Body where it is largest; empty if not known.")
    place: str = about("Place where it is largest; empty if not known.")
    time: FiniteOrNull = about("Time when it is largest [s]; null if not known.")
    sentence: str = about("The reason in at most ten words.")


class BudgetFix(Model):
    """A fix that was tried."""

    name: str
    changes_model: bool = about(
        "Whether it makes another model, instead of computing this one differently."
    )
    settings: dict[str, Setting] = about("Options, and fields of named parts, that it sets.")
    removes: bool
    verdict: VerdictWord = about("On the changed model.")
    error: FiniteOrNull = about(
        "Of the row that it was tried against, or the numerical error; null if infinite."
    )
    distance_to_reference: FiniteOrNull = about(
        "From the model's motion at its finest step, or, against a modeling choice, from that "
        "with the choice changed. A fix that comes no nearer is not judged further. Null if "
        "infinite."
    )
    distance_before: FiniteOrNull = about("The same of the model as written; null if infinite.")
    time_ratio: TimeRatio | None


class BudgetReport(ReportModel):
    """An error budget and its verdict."""

    budget_version: Literal[2] = 2
    tolerance: float = about("Largest error that counts as right.")
    verdict: VerdictWord
    reasons: tuple[BudgetReason, ...]
    fixes: tuple[BudgetFix, ...] = about("Fixes that were tried, the best first.", default=())
    phases: tuple[BudgetPhase, ...]
