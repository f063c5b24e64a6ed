"""The options of pictures and films, and which kind of file each applies to."""

from dataclasses import dataclass
from pathlib import Path

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import OutputError

VIEWERS = (".mcap", ".rrd")
FILMS = {".mp4": 30, ".gif": 25}
"""Frames per second."""
SHEET = ".png"
_SIDES = (64, 4096)
_SPEEDS = (0.001, 1000.0)


@dataclass(frozen=True)
class PictureOptions:
    """How pictures are taken.

    Attributes:
        size: width and height [pixels].
        camera: name of a camera of the model; None for one that sees the whole motion.
        speed: simulated seconds per second of film, below 1 for slow motion; None for 1.
        at: times of a sheet's pictures [s]; six over the run if empty.
    """

    size: tuple[int, int] | None = None
    camera: str | None = None
    speed: float | None = None
    at: tuple[float, ...] = ()


def check_options(target: Path, options: PictureOptions) -> None:
    """Check the kind of a file, and that each option applies to it.

    Raises:
        OutputError: says what to write instead.
    """
    suffix = target.suffix.lower()
    known = (*VIEWERS, *FILMS, SHEET)
    if suffix not in known:
        raise OutputError(f"cannot write {target}: end its name in {', '.join(known)}")
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: there is no folder {target.parent}")
    if options.at and suffix != SHEET:
        raise OutputError(f"--at is for {SHEET} only; leave it out for {suffix}")
    if options.speed is not None and suffix not in FILMS:
        raise OutputError(f"--speed is for {' and '.join(FILMS)} only; leave it out for {suffix}")
    if suffix in VIEWERS and (options.size or options.camera):
        raise OutputError(f"--size and --camera are for pictures; leave them out for {suffix}")
    low, high = _SIDES
    if options.size and any(side % 2 or not low <= side <= high for side in options.size):
        raise OutputError(f"--size takes even numbers from {low} to {high}, as in 640x480")
    slowest, fastest = _SPEEDS
    if options.speed is not None and not slowest <= options.speed <= fastest:
        raise OutputError(f"--speed takes {slowest:g} to {fastest:g}; 0.1 is slow motion")


def check_times(options: PictureOptions, time: Floats) -> None:
    """Check that all times lie in the run.

    Raises:
        OutputError: says from when to when the run goes.
    """
    outside = [each for each in options.at if not time[0] <= each <= time[-1]]
    if outside:
        raise OutputError(
            f"--at {outside[0]:g}: choose a time within the run, {time[0]:g} to {time[-1]:g} s"
        )
