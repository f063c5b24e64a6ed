"""The report of `contactlab grip`: whether a gripper holds, and why not."""

from typing import Literal

from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about

GripWord = Literal["holds", "creeps", "drops"]
GripTrend = Literal["still", "steady", "fading", "growing", "uneven", "lost"]
CauseKind = Literal[
    "regularised friction", "Coulomb's limit", "weak squeeze", "sinking in", "shape", "unknown"
]


class GripControl(Model):
    """A control, and what its actuator gives while the object is held."""

    name: str = about("The actuator.")
    opened: float | None = about("Control that opens; null for a keyframe.")
    closed: float = about("Control that closes, as it is held.")
    force: float = about("Force of the actuator, in its own unit.")
    limit: float | None = about("The most that it can give, in its own unit; null if none is set.")


class GripFinger(Model):
    """A finger, and how hard it presses."""

    body: str = about("Its first body.")
    force: float = about("Sum of the normal forces of its contacts.", unit="N")


class GripDrift(Model):
    """How the object moves in the hand under its weight in one direction."""

    name: str = about("Where the weight pulls.")
    seconds: float = about("How long it was watched.", unit="s")
    speeds: tuple[float | None, ...] = about("Mean speeds in quarters of the run.", unit="m/s")
    trend: GripTrend = about("Of the last three of these.")
    speed: float | None = about(
        "In the last quarter; if it fades, mean over ten seconds to come; if it is uneven, mean of "
        "all quarters but the first; null once it is lost.",
        unit="m/s",
    )
    lost: float | None = about("When the pads no longer cover it; null if never.", unit="s")


class GripTrial(Model):
    """How far the object was from its place."""

    way: float | None = about("The farthest; null if it is not finite.", unit="m")
    lost: bool


class GripPull(Model):
    """What the fingers hold against a pull, where they hold least."""

    direction: str
    force: float = about("Largest force of the contacts against it.", unit="N")
    weights: float = about("That force over the object's weight.", unit="1")


class GripPlacement(Model):
    """The same measure with the object elsewhere, or of another size."""

    name: str
    force: float = about("Of the finger that presses least, of those that do.", unit="N")
    speed: float | None = about("Of the worst direction; null if it is lost.", unit="m/s")
    verdict: GripWord


class GripCause(Model):
    """Why a gripper does not hold."""

    kind: CauseKind
    sentence: str


class GripRemedy(Model):
    """A change that was run: closed on the object, and loaded in all directions."""

    name: str
    options: dict[str, Setting] = about("The settings that it changes; none for a control.")
    speed: float | None = about("Of the worst direction; null if it is lost.", unit="m/s")
    verdict: GripWord
    worse: bool = about("Whether the object moves faster than as written.")
    price: BudgetPrice | None = about("Time with it over time without; null if unknown.")
    lines: tuple[str, ...] = about("The lines of the model's files, each after FILE:LINE.")
    unwritten: str = about("Why there are no lines.", default="")


class GripReport(Model):
    """Whether a gripper holds an object, measured by closing it with its own actuators."""

    model: str = about("The scene or model, as it was named.")
    mujoco: str = about("Version of MuJoCo.")
    keyframe: str | None = about("The keyframe that was judged; null on a bench.")
    verdict: GripWord
    sentence: str = about("The verdict: how fast, where to, when it is lost, why, what helps.")
    within: float = about("Speed from which it creeps.", unit="m/s")
    held: str = about("The object.")
    base: str = about("The body that carries the fingers, in whose frame all is measured.")
    opening: float | None = about("Largest clearance of the fingers.", unit="m")
    controls: tuple[GripControl, ...]
    fingers: tuple[GripFinger, ...]
    depth: float = about("Of the deepest contact with the object.", unit="m")
    depth_share: float = about("That depth over half of the object's width.", unit="1")
    weight: float = about("Of the object.", unit="N")
    drifts: tuple[GripDrift, ...] = about("Without a further load first.")
    shake: GripTrial = about("A circle of 5 m/s2 at 5 Hz for a second.")
    turn: GripTrial = about("A full turn of gravity in two seconds.")
    pull: GripPull
    placements: tuple[GripPlacement, ...] = about("Empty for a keyframe.")
    causes: tuple[GripCause, ...]
    remedies: tuple[GripRemedy, ...] = about("What holds comes first, the cheapest leading.")
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """True if the object stays."""
        return self.verdict == "holds"
