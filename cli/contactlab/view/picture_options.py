"""What a user may choose of a picture, and what fits which kind of file."""

from dataclasses import dataclass
from pathlib import Path

from contactlab.contact import Floats
from contactlab.errors import OutputError

VIEWERS = (".mcap", ".rrd")
FILMS = {".mp4": 30, ".gif": 25}
"""Pictures a second."""
SHEET = ".png"
_SIDES = (64, 4096)
_SPEEDS = (0.001, 1000.0)


@dataclass(frozen=True)
class PictureOptions:
    """How pictures are taken.

    Attributes:
        size: width and height [pixels].
        camera: name of a camera of the model; None for one that sees the whole motion.
        speed: simulated seconds in a second of film; below 1 is slow motion. None means 1.
        at: times of a sheet's pictures [s]; six over the run if there are none.
    """

    size: tuple[int, int] | None = None
    camera: str | None = None
    speed: float | None = None
    at: tuple[float, ...] = ()


def check_options(target: Path, look: PictureOptions) -> None:
    """Refuse a file of unknown kind, and choices that would have no effect on it.

    Raises:
        OutputError: with what to write instead.
    """
    suffix = target.suffix.lower()
    known = (*VIEWERS, *FILMS, SHEET)
    if suffix not in known:
        raise OutputError(f"cannot write {target}: end its name in {', '.join(known)}")
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: there is no folder {target.parent}")
    if look.at and suffix != SHEET:
        raise OutputError(f"--at chooses moments for {SHEET}; leave it out for {suffix}")
    if look.speed is not None and suffix not in FILMS:
        raise OutputError(f"--speed is for {' and '.join(FILMS)}; leave it out for {suffix}")
    if suffix in VIEWERS and (look.size or look.camera):
        raise OutputError(f"--size and --camera are for pictures; leave them out for {suffix}")
    low, high = _SIDES
    if look.size and any(side % 2 or not low <= side <= high for side in look.size):
        raise OutputError(f"--size takes even numbers from {low} to {high}, as in 640x480")
    slowest, fastest = _SPEEDS
    if look.speed is not None and not slowest <= look.speed <= fastest:
        raise OutputError(f"--speed takes {slowest:g} to {fastest:g}; 0.1 is slow motion")


def check_times(look: PictureOptions, time: Floats) -> None:
    """Refuse moments outside of the run.

    Raises:
        OutputError: with the run's span.
    """
    outside = [moment for moment in look.at if not time[0] <= moment <= time[-1]]
    if outside:
        raise OutputError(
            f"--at {outside[0]:g}: the run goes from {time[0]:g} to {time[-1]:g} s; choose between"
        )
