"""The report of `contactlab success`: how many successes of episodes are physical."""

from typing import Literal

from contactlab.schema.evidence import Setting, Status
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about

REPORT, PAGE, EPISODES = "success.json", "success.html", "episodes"
"""Names in the folder of a result: its report, its page, and the store of its episodes."""
OUTCOMES = "outcomes.json"
"""Name next to a store: the outcomes of the episodes that were played without a record."""
Outcome = Literal["met", "unmet", "undecided"]


class PlayedEpisode(Model):
    """An episode that was played without a record."""

    run_id: str
    axes: dict[str, Setting] = about("Axis values, with the variant.")
    seed: int
    status: Status
    status_reason: str | None = None
    success: bool | None = None
    total_reward: FiniteOrNull = about("Sum of the rewards.", unit="1", default=None)
    steps: int = about("Steps made.", unit="1")


class SuccessShare(Model):
    """A share of episodes, and its interval of 95 %."""

    good: int = about("Number of these episodes.", unit="1")
    episodes: int = about("Number of all.", unit="1")
    low: float = about("Lower end of the interval.", unit="1")
    high: float = about("Upper end of the interval.", unit="1")

    @property
    def share(self) -> float:
        """The share."""
        return self.good / self.episodes


class DecisivePair(Model):
    """A pair of bodies whose contacts decide."""

    pair: str
    share: float = about("Its part of the impulse of all contacts of the object.", unit="1")


class VariantResult(Model):
    """Successes under a variant, against those as written in the same cases."""

    name: str
    kind: Literal["numerics", "control", "robot"] = about(
        "numerics must not matter, a robot meets the others; the control is chance alone."
    )
    summary: str = about("The change.")
    success: SuccessShare | None = about("Null if no episode could be played.")
    gained: int = about("Failures that become successes.", unit="1")
    lost: int = about("Successes that become failures.", unit="1")
    difference: tuple[float, float] | None = about(
        "95 % interval (Tango) of the difference of the shares.", unit="1"
    )
    chance: float | None = about(
        "Chance of so unequal numbers, were both as likely (McNemar, exact).", unit="1"
    )
    problem: str = about("Why episodes could not be played; empty if all were.", default="")


class SuccessLoss(Model):
    """A reason for which successes are not physical."""

    cause: str = about("A label, `too deep`, or a variant.")
    kind: Literal["contact", "variant"]
    episodes: int = about("Successes that it takes away.", unit="1")
    alone: int = about("Those that nothing else takes away.", unit="1")
    example: str = about("Its reason in the first such episode.", default="")
    run: str = about("Id of this episode.", default="")
    time: FiniteOrNull = about("When it begins there.", unit="s", default=None)


class PartingForce(Model):
    """Normal force of a pair when two episodes part."""

    pair: str
    written: FiniteOrNull = about("In the episode as written.", unit="N")
    variant: FiniteOrNull = about("In the variant.", unit="N")


class Parting(Model):
    """The first moment when a success that is lost leaves the one that stays."""

    case: dict[str, Setting] = about("Axis values and seed.")
    variant: str
    time: float = about("When the object is first farther away than the distance.", unit="s")
    body: str
    distance: float = about("The distance.", unit="m")
    forces: tuple[PartingForce, ...] = about("At that time, of the decisive pairs.")
    runs: tuple[str, str] = about("Run ids: as written, and of the variant.")


class SuccessRequirement(Model):
    """A required share."""

    text: str
    quantity: Literal["success", "physical"]
    least: float = about("The required share.", unit="1")
    outcome: Outcome = about("By the interval: above, below, or around the required share.")
    needed: int | None = about("Episodes that would decide it, at the same share.")


class SuccessReport(ReportModel):
    """Successes as written and physical successes of the same episodes."""

    success_version: Literal[1] = 1
    source: str
    store: str = about("The store of the episodes.")
    mujoco: str = about("Version of MuJoCo.")
    policy: str = about("The policy, or how actions are drawn.")
    objects: tuple[str, ...] = about("Bodies of the object.")
    named: bool = about("Whether an option names it; otherwise it was found in the traces.")
    pairs: tuple[DecisivePair, ...]
    depth_limit: float = about(
        "Largest depth that lasts 20 ms, as a share of the thickness of the thinner body.", unit="1"
    )
    written: SuccessShare = about("Successes as written.")
    sound: SuccessShare = about("Successes whose decisive contacts are sound.")
    physical: SuccessShare = about(
        "Successes whose decisive contacts are sound and that survive all variants of numerics."
    )
    difference: tuple[float, float] = about(
        "95 % interval (Tango) of the share of physical minus that of successes.", unit="1"
    )
    chance: float = about(
        "Chance of so many lost successes, were losses and gains as likely (McNemar, exact).",
        unit="1",
    )
    losses: tuple[SuccessLoss, ...] = about("The largest first.")
    variants: tuple[VariantResult, ...]
    parting: Parting | None = None
    needed: int | None = about("Episodes that would tell the difference; null if it is told.")
    stop: Literal["all episodes", "decided"] = about("Why no more episodes were played.")
    anytime: bool = about(
        "Whether intervals of success hold at any number of episodes; otherwise they are Wilson's."
    )
    requirements: tuple[SuccessRequirement, ...] = ()
    repeated: bool = about("Whether variants of numerics were played.")
    not_checked: tuple[str, ...] = about("What the episodes cannot show.", default=())
    notes: tuple[str, ...] = ()

    @property
    def problem(self) -> str:
        """The requirements that are not met."""
        open_ones = [each for each in self.requirements if each.outcome != "met"]
        return "; ".join(f"{each.text}: {each.outcome}" for each in open_ones)
