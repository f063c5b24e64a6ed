"""The report of `contactlab diff`."""

from pathlib import Path
from typing import Literal

from contactlab.schema.strict_model import Model, about


class Difference(Model):
    """A quantity that two models do not have alike."""

    kind: str = about("body, joint, geom, tendon, actuator, equality, pair, exclude, filter, ...")
    name: str = about("Of the part, in the first model if it has it; empty for the whole model.")
    quantity: str = about("In MJCF's word, where it has one.")
    before: str = about("In the first model, SI units; empty if the part is not there.")
    after: str = about("In the second.")
    unit: str = about("Of both.", default="")
    share: float | None = about(
        "Size of the change over that of the larger value; of places over a length, of turns in "
        "radians. Null where it has no size: that counts always."
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
        size = "" if self.share is None else f" ({100 * self.share:.2g} %)"
        return f"{of}: {self.quantity} {self.before} -> {self.after}{unit}{size}"


class MotionChange(Model):
    """Change in motion for one second of the first model's task, as a backward error."""

    task: str = about("The task, in a line.")
    share: float = about(
        "Phantom forces under which the second model would have the first one's motion, over the "
        "real ones, in the worst body.",
        unit="1",
        better="none",
    )
    body: str = about("The worst body.")
    window: float = about("Length of windows.", unit="s")


class DiffReport(Model):
    """What two models do not have alike (`diff --format json`)."""

    diff_version: Literal[1] = 1
    mujoco: str = about("The version that compiled both.")
    before: str = about("The first model, as given.")
    after: str = about("The second.")
    within: float = about("Share up to which quantities are alike.", unit="1", better="none")
    matched: dict[str, int] = about("How many parts of a kind are in both.")
    differences: tuple[Difference, ...]
    motion: MotionChange | None = about("Null where it was not measured.", default=None)
    unmoved: str = about("Why it was not.", default="")

    @property
    def headline(self) -> str:
        """The result in a sentence."""
        count = len(self.differences)
        found = f"{count} difference{'' if count == 1 else 's'}" if count else "no difference"
        one, other = (Path(model).name for model in (self.before, self.after))
        which = f" between {one} and {other}" if one != other else ""
        return f"{found}{which} beyond {100 * self.within:g} %"

    @property
    def last_line(self) -> str:
        """The change in motion in words."""
        if self.motion is None:
            return f"motion: {self.unmoved}"
        return (
            f"motion: in windows of {1e3 * self.motion.window:.0f} ms of one second, the second "
            f"moves as the first would under phantom forces of {100 * self.motion.share:.2g} % "
            f"of the real ones, in the worst body, {self.motion.body} (backward error; "
            f"{self.motion.task})"
        )
