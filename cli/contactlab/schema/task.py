"""The task that a model is judged on: where it starts, what drives it, how long, what is watched.

It is the author's own wherever a keyframe has controls.
"""

from typing import Literal

from contactlab.schema.drive import Drive, drive_text
from contactlab.schema.strict_model import Model, Number, about

DEFAULT_WITHIN = 0.1
"""The share within which a run counts as right, unless a task says otherwise."""
SEEDS = (0, 1, 2)
_PROGRAMMED = "with the controls of its scene"
QPOS0 = "qpos0"
"""Stands for the reference configuration of a model, where no keyframe is used."""


class Phase(Model):
    """A part of a task that is judged by itself, since rest dilutes."""

    name: Literal["held", "neutral", "excitement", "driven"] = about("what happens in it")
    begin: Number = about("[s]")
    end: Number = about("[s]")


class Task(Model):
    """Task that a model is judged on."""

    start: str = about("keyframe, or qpos0")
    drive: Drive = about("what moves it; none: constant controls, those of the start")
    own_controls: bool = about("whether the start is a keyframe with controls, which are kept")
    programmed: bool = about("whether the scene has controls over time", default=False)
    duration: Number = about("simulated time [s]")
    phases: tuple[Phase, ...] = about("judged one by one; the worst counts")
    watched: tuple[str, ...] = about("bodies; all if empty", default=())
    within: Number = about("largest share (or length [m], angle [rad]) of an error", default=0.1)
    unit: Literal["1", "m", "rad"] = about("of `within`", default="1")
    seeds: tuple[int, ...] = about("of what is random, one run each", default=SEEDS)

    @property
    def line(self) -> str:
        """The task in one line, as the head of every answer has it."""
        runs = f"{len(self.seeds)} seed{'s' * (len(self.seeds) != 1)}"
        watched = ", ".join(self.watched) or "all bodies"
        parts = f"{self._motion()}, {self.duration:g} s, {runs}"
        return f"{parts}; watched: {watched}; tolerance {self._tolerance()}"

    def _motion(self) -> str:
        begin = self.start if self.start == QPOS0 else f"keyframe {self.start}"
        match self.drive:
            case "none":
                controls = "held with its controls" if self.own_controls else "without controls"
                return f"{begin} {controls if not self.programmed else _PROGRAMMED}"
            case "hold":
                return f"{begin} held by an external load on its joints (--drive hold)"
            case "exercise":
                rest = "its controls" if self.own_controls else "neutral controls"
                times = [f"{phase.end - phase.begin:.3g} s" for phase in self.phases]
                return f"{begin}, {rest} for {times[0]}, then sines and pushes for {times[-1]}"
            case _:
                return f"{begin} driven by {drive_text(self.drive)}"

    def _tolerance(self) -> str:
        match self.unit:
            case "m":
                return f"{self.within * 1e3:g} mm"
            case "rad":
                return f"{self.within:g} rad"
            case _:
                return f"{self.within * 100:g} %"
