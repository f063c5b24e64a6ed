"""The report of `contactlab grip`: whether a gripper holds an object, and why not."""

import math
from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.verification import VerifiedChange

GripVerdict = Literal["holds", "penetrates", "creeps", "drops"]
GripTrend = Literal["still", "steady", "fading", "growing", "uneven", "lost"]
CauseKind = Literal[
    "regularized friction",
    "Coulomb's limit",
    "weak squeeze",
    "deep penetration",
    "shape",
    "unknown",
]


class GripControl(Model):
    """A control, and the force of its actuator while the object is held."""

    name: str = about("The actuator.")
    open_control: FiniteOrNull = about("Control that opens; null for a keyframe.")
    closed_control: float = about("Control that closes, during the hold.")
    force: float = about("Force of the actuator, in its own unit.")
    limit: FiniteOrNull = about("Largest force of the actuator; null if none is set.")


class GripFinger(Model):
    """A finger, and its force on the object."""

    body: str = about("Its first body.")
    force: float = about("Sum of the normal forces of its contacts.", unit="N")


class GripDrift(Model):
    """Motion of the object in the hand under its weight in one direction."""

    name: str = about("Direction of the weight.")
    seconds: float = about("Duration of the run.", unit="s")
    speeds: tuple[FiniteOrNull, ...] = about("Mean speeds in quarters of the run.", unit="m/s")
    trend: GripTrend = about("Trend of the last three of these.")
    speed: FiniteOrNull = about(
        "Speed in the last quarter; if it fades, mean over the next ten seconds; if it is uneven, "
        "mean of all quarters except the first; null once the object is lost.",
        unit="m/s",
    )
    lost_after: FiniteOrNull = about("When the pads no longer cover it; null if never.", unit="s")


class GripTrial(Model):
    """Displacement of the object under a changing load."""

    distance: FiniteOrNull = about("Largest displacement; null if it is not finite.", unit="m")
    lost: bool


class GripPull(Model):
    """Largest pull that the fingers hold, in their weakest direction."""

    direction: str
    force: float = about("Largest force of the contacts against it.", unit="N")
    weights: float = about("That force over the object's weight.", unit="1")


class GripPlacement(Model):
    """The same measures with the object elsewhere, or of another size."""

    name: str
    force: float = about("Force of the finger that presses least, of those that press.", unit="N")
    speed: FiniteOrNull = about("Speed in the worst direction; null if it is lost.", unit="m/s")
    verdict: GripVerdict


class GripCause(Model):
    """Why a gripper does not hold."""

    kind: CauseKind
    sentence: str


class GripFix(Model):
    """A change that was tested: closed on the object, and loaded in all directions."""

    name: str
    options: dict[str, Setting] = about("The changed settings; none for a control.")
    keyframe_controls: tuple[float, ...] = about(
        "New `ctrl` of the keyframe, which squeezes less; empty if unchanged.", default=()
    )
    speed: FiniteOrNull = about("Speed in the worst direction; null if it is lost.", unit="m/s")
    verdict: GripVerdict
    worse: bool = about("Whether the object moves faster than as written.")
    time_ratio: TimeRatio | None = about("Time with it over time without; null if unknown.")
    lines: tuple[str, ...] = about("Changed lines of the model files, each after FILE:LINE.")
    no_patch_reason: str = about("Why there are no lines.", default="")
    verification: VerifiedChange | None = about(
        "Measures of the model with it against those of the original, if it is recommended.",
        default=None,
    )


class GripReport(ReportModel):
    """Whether a gripper holds an object, measured by closing it with its own actuators."""

    grip_version: Literal[2] = 2
    model: str = about("The scene or model, as given.")
    mujoco: str = about("Version of MuJoCo.")
    keyframe: str | None = about("The judged keyframe; null if the hand was mounted and closed.")
    verdict: GripVerdict
    sentence: str = about("The verdict with speed, direction, time of loss, cause and fix.")
    tolerance: float = about("Largest speed of an object that does not creep.", unit="m/s")
    object: str = about("The object.")
    base: str = about(
        "The body that carries the fingers. Motion is relative to them, in its frame."
    )
    opening: FiniteOrNull = about("Largest clearance of the fingers.", unit="m")
    controls: tuple[GripControl, ...]
    fingers: tuple[GripFinger, ...]
    depth: float = about("Depth of the deepest contact with the object.", unit="m")
    depth_share: float = about("That depth over half of the object's width.", unit="1")
    weight: float = about("Weight of the object.", unit="N")
    drifts: tuple[GripDrift, ...] = about("The first is without a further load.")
    shake: GripTrial = about("A circle of 5 m/s2 at 5 Hz for a second.")
    turn: GripTrial = about("A full turn of gravity in two seconds.")
    pull: GripPull
    placements: tuple[GripPlacement, ...] = about("Empty for a keyframe.")
    causes: tuple[GripCause, ...]
    fixes: tuple[GripFix, ...] = about("Fixes that hold come first, the fastest leading.")
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """True if the object does not creep or drop."""
        return self.verdict == "holds"

    @property
    def worst_speed(self) -> float:
        """The largest speed of its drifts [m/s]; infinite if the object is lost."""
        speeds = (math.inf if drift.speed is None else drift.speed for drift in self.drifts)
        return max(speeds, default=math.inf)

    @property
    def problem(self) -> str:
        """The verdict, if the gripper does not hold the object."""
        if self.holds:
            return ""
        if self.verdict == "penetrates":
            return f"{self.model}: the fingers penetrate {self.object}"
        return f"{self.model}: {self.object} {self.verdict}"
