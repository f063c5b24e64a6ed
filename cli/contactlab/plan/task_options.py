"""Options for the task: --keyframe, --drive, --duration, --observe, --tolerance, --seeds, ...

Numbers may have units everywhere: `2s`, `1mm`, `5deg`, `10%`.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from contactlab.errors import SweepFileError
from contactlab.plan.overrides import FlagSetting, drive_option
from contactlab.schema.drive import Drive, drive_text
from contactlab.schema.requirement import read_requirement
from contactlab.schema.setting_values import read_quantity

_TOLERANCE_UNITS = ("", "m", "rad")  # a share of the real forces, a length or an angle


@dataclass(frozen=True)
class TaskOptions:
    """Replacements for parts of the default task of a model."""

    keyframe: str | None = None  # a name, or `qpos0`
    drive: Drive | None = None
    duration: float | None = None  # [s]
    observe: tuple[str, ...] = ()  # bodies
    tolerance: tuple[float, str] | None = None  # share, length [m] or angle [rad], and its unit
    # Largest values of metrics and measures by name, in SI units.
    limits: dict[str, float] = field(default_factory=dict[str, float])
    require: tuple[str, ...] = ()  # requirements, as text
    # Units of limits as written, by name; empty for plain numbers.
    units: dict[str, str] = field(default_factory=dict[str, str], compare=False)
    seeds: int | None = None  # number of seeds, from 0 on

    @property
    def settings(self) -> list[str]:
        """Keyframe, duration and requirements as texts of `--set`."""
        keyframe = self.keyframe
        start = [] if keyframe is None else [FlagSetting(f"keyframe={keyframe}", "--keyframe")]
        seconds = self.duration
        duration = [] if seconds is None else [FlagSetting(f"duration={seconds!r}", "--duration")]
        # An address, body[3], would be quoted once more.
        texts = ",".join(json.dumps(text).replace("[", "\\u005b") for text in self.require)
        required = [FlagSetting(f"must={texts}", "--require")] if texts else []
        return [*start, *duration, *required]

    @property
    def variant(self) -> list[str]:
        """The replaced start, drive and duration in words, for the name of a folder."""
        drive = None if self.drive is None else drive_text(self.drive)
        options = {"keyframe": self.keyframe, "drive": drive, "duration": self.duration}
        return [f"{name}={value}" for name, value in options.items() if value is not None]


AS_INFERRED = TaskOptions()
"""Nothing is replaced."""


def read_task_options(
    keyframe: str | None = None,
    drive: str | None = None,
    duration: str | None = None,
    observe: Sequence[str] | None = None,
    tolerance: Sequence[str] | None = None,
    require: Sequence[str] = (),
    seeds: int | None = None,
) -> TaskOptions:
    """Read the options of a command; a SweepFileError says which is wrong and how to write it.

    `tolerance` is that of the task, such as `10%` or `1mm`, or that of one metric by its name:
    `hold_slip=1mm`.
    """
    limits: dict[str, float] = {}
    units: dict[str, str] = {}
    own: tuple[float, str] | None = None
    for text in tolerance or ():
        name, equals, value = text.rpartition("=")
        number, unit = read_quantity(value)
        of_task = not equals and number > 0 and unit in _TOLERANCE_UNITS
        if of_task and not unit and number > 1 and not value.rstrip().endswith("%"):
            raise SweepFileError(f"'--tolerance {text}' is {number:.0%}; write {value}% or a share")
        if not 0 <= number < math.inf or not (name or of_task):
            raise SweepFileError(
                f"'--tolerance {text}' is not a tolerance; write a share or a length, 10% or 1mm, "
                "or METRIC=VALUE, such as hold_slip=1mm"
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
            raise SweepFileError(f"'--duration {duration}' is not a time; write 2s or 500ms")
    for text in require:
        try:
            read_requirement(text)
        except ValueError as error:
            raise SweepFileError(f"--require: {error}") from error
    return TaskOptions(
        keyframe,
        drive_option(drive),
        seconds,
        tuple(observe or ()),
        own,
        limits,
        tuple(require),
        units,
        seeds,
    )
