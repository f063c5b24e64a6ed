"""Options of a command line for the task: --start, --drive, --duration, --watch, --within.

Numbers may have units everywhere: `2s`, `1mm`, `5deg`, `10%`.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from contactlab.errors import SweepFileError
from contactlab.plan.overrides import FlagSetting, drive_option
from contactlab.schema.drive import Drive
from contactlab.schema.requirement import read_requirement
from contactlab.schema.setting_values import read_quantity

_KINDS = ("", "m", "rad")  # of what is watched: a share, a length, an angle


@dataclass(frozen=True)
class TaskOptions:
    """Replacements for parts of the task that a model has by itself."""

    start: str | None = None  # keyframe, or `qpos0`
    drive: Drive | None = None
    duration: float | None = None  # [s]
    watch: tuple[str, ...] = ()  # bodies
    within: tuple[float, str] | None = None  # share, length [m] or angle [rad], and its unit
    # Largest values of metrics and measures by name, in SI units.
    limits: dict[str, float] = field(default_factory=dict[str, float])
    must: tuple[str, ...] = ()  # what has to hold, in words
    # Units of limits as written, by name; empty where a plain number is.
    units: dict[str, str] = field(default_factory=dict[str, str], compare=False)

    @property
    def settings(self) -> list[str]:
        """Return start, duration and requirements as options `--set` have them."""
        start = [] if self.start is None else [FlagSetting(f"keyframe={self.start}", "--start")]
        seconds = self.duration
        duration = [] if seconds is None else [FlagSetting(f"duration={seconds!r}", "--duration")]
        # An address, body[3], would be quoted once more.
        texts = ",".join(json.dumps(text).replace("[", "\\u005b") for text in self.must)
        return [*start, *duration, *([FlagSetting(f"must={texts}", "--must")] if texts else [])]


AS_INFERRED = TaskOptions()
"""Nothing is replaced."""


def read_task_options(
    start: str | None = None,
    drive: str | None = None,
    duration: str | None = None,
    watch: Sequence[str] | None = None,
    within: Sequence[str] | None = None,
    must: Sequence[str] = (),
) -> TaskOptions:
    """Read the options of a command; a SweepFileError says which is wrong, and how it is written.

    `within` is a tolerance of the task, such as `10%` or `1mm`, or that of one metric by its name:
    `hold_slip=1mm`.
    """
    limits: dict[str, float] = {}
    units: dict[str, str] = {}
    own: tuple[float, str] | None = None
    for text in within or ():
        name, equals, value = text.rpartition("=")
        number, unit = read_quantity(value)
        is_task_s = not equals and number > 0 and unit in _KINDS
        if not 0 <= number < math.inf or not (name or is_task_s):
            raise SweepFileError(
                f"'--within {text}' is no tolerance; write a share or a length, 10% or 1mm, or "
                "METRIC=VALUE, such as hold_slip=1mm"
            )
        if name:
            limits[name] = number
            units[name] = unit
        else:
            own = number, unit or "1"
    seconds = None
    if duration is not None:
        seconds, unit = read_quantity(duration)
        if not 0 < seconds < math.inf or unit not in ("", "s"):
            raise SweepFileError(f"'--duration {duration}' is no time; write 2s or 500ms")
    for text in must:
        try:
            read_requirement(text)
        except ValueError as error:
            raise SweepFileError(f"--must: {error}") from error
    moved = drive_option(drive)
    return TaskOptions(start, moved, seconds, tuple(watch or ()), own, limits, tuple(must), units)
