"""The report of an error budget: its verdict, and the rows of each phase."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about

BUDGET_VERSION = 1

BudgetWord = Literal["unresolved", "not resolved", "model", "sound"]
RowKind = Literal["numerics", "model", "effect", "unknown"]


class BudgetPrice(Model):
    """A ratio of times, measured in turns from the same states."""

    ratio: float = about("Time with the change over time without, the median of rounds.")
    low: float = about("Lower end of a 98.8 % interval of that median.")
    high: float = about("Its upper end.")


class BudgetRow(Model):
    """Effect of one change: phantom impulses over real ones."""

    name: str = about("The row; `run` is the run itself against the reference.")
    summary: str = about("The change that is made.")
    kind: RowKind
    exercised: bool = about("Whether the task makes use of what is changed.")
    infinite: bool = about("Whether the engine gave up, so that no share says how much.")
    share: float | None = about(
        "Of the worst body, the mean over seeds; null if not exercised, or infinite."
    )
    seeds: tuple[float, float] | None = about("Least and largest of any seed; null as above.")
    median: float | None = about("Of all bodies; null as above.")
    by_mass: float | None = about("Weighted by mass; null as above.")
    body: str | None = about("The worst body; null if not exercised.")
    place: str | None = about(
        "The contact, joint, tendon or equality whose impulse on that body differs most in the "
        "worst window; null if not known."
    )
    speed: float | None = about(
        "The worst body's defect, the mean over windows [m/s]; of what creeps, how fast."
    )
    seed: int | None = about("Of the worst window; null if not exercised.")
    time: float | None = about("When the worst window begins [s]; null if not exercised.")
    price: BudgetPrice | None = about("Of the change in the model's own settings; null if none.")


class BudgetWarning(Model):
    """A warning of the engine in the run."""

    kind: str
    place: str = about("The joint, actuator or body it names; empty if none.")
    cause: str = about("Where forces had parted most from the reference's; empty if not known.")
    seed: int
    time: float = about("When the window begins in which it was raised [s].")


class BudgetPhase(Model):
    """The budget of one phase, judged by itself."""

    name: str
    timestep: float = about("Of the run [s].")
    steps: int = about("Of each seed.")
    seeds: int
    window: float = about("Length of windows [s].")
    windows: int = about("How many each seed has.")
    bodies: tuple[str, ...] = about("Those that are judged: they can move, and have mass.")
    run: BudgetRow
    rows: tuple[BudgetRow, ...]
    energy: float | None = about(
        "What energy drifts in the run and not in a reference, as a share; null if infinite."
    )
    excess: float | None = about("Path of the run's velocity beyond the reference's; not judged.")
    peak: float | None = about("Worst window over the body's peak speed; not judged.")
    most: float | None = about(
        "How far off the run may be as far as references at h/4 and h/8 are known: its share, or "
        "that at h/8 and what they are apart, worst body; null if infinite or unchecked."
    )
    limit: float = about("What the run's shares were multiplied by, from h/4 to the limit.")
    lost: float = about("Share of windows in which the reference gave up.")
    warnings: tuple[BudgetWarning, ...]


class BudgetReason(Model):
    """Why a verdict is not sound."""

    word: BudgetWord = about("The verdict that it alone would give.")
    phase: str
    row: str = about("A row, or `run`, `energy`, `reference`, `warning`.")
    share: float | None = about("Null if infinite.")
    body: str
    place: str
    time: float | None
    sentence: str


class BudgetRemedy(Model):
    """A change that was tried against the verdict."""

    name: str
    physics: bool = about("Whether it makes another model, not another computation of this one.")
    settings: dict[str, Setting] = about("What it sets: options, and fields of named parts.")
    removes: bool
    word: BudgetWord = about("The verdict on the changed model.")
    share: float | None = about("Of the row it was tried against, or the run; null if infinite.")
    apart: float | None = about(
        "From the model's motion at its finest step, or, against a row of the model, from that "
        "with the row's change; what comes no nearer is judged no further. Null if infinite."
    )
    before: float | None = about("The same of the model as it is; null if infinite.")
    price: BudgetPrice | None


class BudgetReport(Model):
    """An error budget and its verdict."""

    budget_version: Literal[1] = BUDGET_VERSION
    within: float = about("The tolerance.")
    verdict: BudgetWord
    reasons: tuple[BudgetReason, ...]
    remedies: tuple[BudgetRemedy, ...] = about("Those that were tried, the best first.", default=())
    phases: tuple[BudgetPhase, ...]
