"""The task that a model is judged on: its start, drive, duration and observed bodies.

It is the author's own task if a keyframe has controls.
"""

from typing import Literal

from contactlab.schema.drive import Drive, drive_text
from contactlab.schema.strict_model import Model, Number, about

DEFAULT_TOLERANCE = 0.1
"""Largest error that counts as right, as a share, unless a task says otherwise."""
SEEDS = (0, 1, 2)
QPOS0 = "qpos0"
"""Stands for the default configuration of a model, where no keyframe is used."""


class Phase(Model):
    """A part of a task that is judged alone, since a phase at rest dilutes errors."""

    name: Literal["held", "rest", "excitation", "driven"] = about("kind of its drive")
    begin: Number = about("[s]")
    end: Number = about("[s]")


class Task(Model):
    """Task that a model is judged on."""

    start: str = about("keyframe, or qpos0")
    drive: Drive = about("its drive; none: constant controls, those of the start")
    own_controls: bool = about("whether the start is a keyframe with controls, which are kept")
    programmed: bool = about("whether the scene has controls over time", default=False)
    excitation: str = about("inputs of the second phase", default="sines and pushes")
    duration: Number = about("simulated time [s]")
    phases: tuple[Phase, ...] = about("judged one by one; the worst counts")
    observed: tuple[str, ...] = about("bodies; all if empty", default=())
    tolerance: Number = about("largest error: a share, length [m] or angle [rad]", default=0.1)
    unit: Literal["1", "m", "rad"] = about("of `tolerance`", default="1")
    seeds: tuple[int, ...] = about("of all that is random, one run each", default=SEEDS)

    @property
    def line(self) -> str:
        """The task in one line, for the head of every answer."""
        start = self.start if self.start == QPOS0 else f"keyframe {self.start}"
        runs = f"{len(self.seeds)} seed{'s' * (len(self.seeds) != 1)}"
        observed = ", ".join(self.observed) or "all bodies"
        return (
            f"{start}, {self._motion_text()}; {runs}; observed: {observed}; "
            f"tolerance {self._tolerance_text()}"
        )

    def _motion_text(self) -> str:
        seconds = f"{self.duration:g} s"
        match self.drive:
            case "none" if self.programmed:
                return f"{seconds} with the controls of its scene"
            case "none":
                return f"{seconds} {'held by its' if self.own_controls else 'without'} controls"
            case "hold":
                return f"{seconds} held by an external load on its joints (--drive hold)"
            case "exercise":
                rest, excited = (phase.end - phase.begin for phase in self.phases)
                controls = "with its controls" if self.own_controls else "at rest"
                return f"{rest:.3g} s {controls}, then {excited:.3g} s of {self.excitation}"
            case _:
                return f"{seconds} driven by {drive_text(self.drive)}"

    def _tolerance_text(self) -> str:
        match self.unit:
            case "m":
                return f"{self.tolerance * 1e3:g} mm"
            case "rad":
                return f"{self.tolerance:g} rad"
            case _:
                return f"{self.tolerance * 100:g} %"
