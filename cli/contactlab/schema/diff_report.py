"""The report of `contactlab diff`."""

from pathlib import Path
from typing import Literal

from contactlab.rendering.amounts import format_amount, format_percent
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import Model, about


class Difference(Model):
    """A quantity that differs between two models."""

    kind: str = about("body, joint, geom, tendon, actuator, equality, pair, exclude, filter, ...")
    name: str = about("Name of the part in the first model, if it is there; empty for the model.")
    quantity: str = about("The name in MJCF, if there is one.")
    before: str = about("Value in the first model, SI units; empty without the part.")
    after: str = about("Value in the second model.")
    unit: str = about("Unit of both.", default="")
    relative_change: float | None = about(
        "Change over the larger value; of positions over a length, of rotations in radians. Null "
        "if the change has no size; then it always counts."
    )

    @property
    def sentence(self) -> str:
        """The difference in words."""
        of = f"{self.kind} '{self.name}'" if self.name else self.kind
        unit = f" {self.unit}" if self.unit else ""
        if not self.before:
            return f"{of} is new: {self.quantity} {self.after}{unit}".rstrip()
        if not self.after:
            return f"{of} is gone: {self.quantity} {self.before}{unit}".rstrip()
        size = "" if self.relative_change is None else f" ({format_percent(self.relative_change)})"
        return f"{of}: {self.quantity} {self.before} -> {self.after}{unit}{size}"


class MotionChange(Model):
    """Change in motion for one second of the first model's task."""

    task: str = about("The task, in a line.")
    error: float = about(
        "Residual force that the second model needs for the motion of the first, as a share of the "
        "real forces, in the worst body.",
        unit="1",
        better="none",
    )
    body: str = about("The worst body.")
    window: float = about("Length of windows.", unit="s")


class DiffReport(ReportModel):
    """Differences of two models (`diff --format json`)."""

    diff_version: Literal[2] = 2
    mujoco: str = about("The version that compiled both.")
    before: str = about("The first model, as given.")
    after: str = about("The second.")
    tolerance: float = about(
        "Relative change up to which quantities are equal.", unit="1", better="none"
    )
    matched: dict[str, int] = about("Number of parts in both models, by kind.")
    differences: tuple[Difference, ...]
    motion: MotionChange | None = about("Null if it was not measured.", default=None)
    no_motion_reason: str = about("Why it was not measured.", default="")

    @property
    def headline(self) -> str:
        """The result in a sentence."""
        count = len(self.differences)
        count_text = f"{count} difference{'' if count == 1 else 's'}" if count else "no difference"
        one, other = (Path(model).name for model in (self.before, self.after))
        which = f" between {one} and {other}" if one != other else ""
        return f"{count_text}{which} above {100 * self.tolerance:g} %"

    @property
    def problem(self) -> str:
        """The result, if the models differ."""
        return self.headline if self.differences else ""

    @property
    def last_line(self) -> str:
        """The change in motion in words."""
        if self.motion is None:
            return f"motion: {self.no_motion_reason}"
        motion = self.motion
        return (
            "motion: the second model needs a residual force of "
            f"{format_percent(motion.error)} of the real forces to move as the first, in the worst "
            f"body, {motion.body} (windows of "
            f"{format_amount(motion.window, 'ms')} of one second; {motion.task})"
        )
