"""Pictures of a run, taken and written as films and sheets."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contactlab.contact import BodyMotion, Floats
from contactlab.run.replay import Start
from contactlab.view import Picture, pictures
from contactlab.view.caption import captioned
from contactlab.view.film import write_gif, write_mp4, write_png
from contactlab.view.forces import frame_times, nearest
from contactlab.view.look import FILMS, SHEET, Look

_SIZE = (640, 480)
_MOMENTS = 6
_WRITERS = {".mp4": write_mp4, ".gif": write_gif}


@dataclass(frozen=True)
class Shots:
    """Pictures of a run that are still to be taken.

    Attributes:
        start: the run's record and model.
        motion: what is drawn.
        qpos: (F, nq) configurations of the motion's frames.
        look: how pictures are taken.
    """

    start: Start
    motion: BodyMotion
    qpos: Floats
    look: Look

    def write(self, target: Path) -> None:
        """Write a film or a sheet, as the file's suffix says."""
        suffix = target.suffix.lower()
        if suffix == SHEET:
            write_png(target, self.moments())
        else:
            _WRITERS[suffix](target, self.film(FILMS[suffix]), FILMS[suffix])

    def film(self, rate: float) -> Iterator[Picture]:
        """Yield a film's pictures, so many a second of film."""
        times = frame_times(self.motion.time, rate / (self.look.speed or 1.0))
        shown = nearest(self.motion.time, times)
        repeats = np.bincount(shown, minlength=len(self.motion.time)).tolist()
        frames = [frame for frame, count in enumerate(repeats) if count]
        for frame, picture in zip(frames, self._take(frames), strict=True):
            for _ in range(repeats[frame]):
                yield picture

    def moments(self) -> list[Picture]:
        """Return a sheet's pictures."""
        times = np.array(self.look.at or self._usual_moments())
        wanted: list[int] = nearest(self.motion.time, times).tolist()
        frames = sorted(set(wanted))
        taken = dict(zip(frames, self._take(frames), strict=True))
        return [taken[frame] for frame in wanted]

    def _usual_moments(self) -> list[float]:
        """Return times evenly over the frames in which something that moves is in view."""
        motion = self.motion
        far = np.linalg.norm(motion.positions[:, motion.moving] - motion.centre, axis=2)
        seen = motion.time[(far <= motion.radius).any(axis=1)]
        span = seen if len(seen) else motion.time
        return np.linspace(span[0], span[-1], _MOMENTS).tolist()

    def _take(self, frames: Sequence[int]) -> Iterator[Picture]:
        chosen = {frame: self.qpos[frame] for frame in frames}
        model, size = self.start.prepared.model, self.look.size or _SIZE
        taken = pictures(model, self.motion, chosen, size, self.look.camera)
        for frame, picture in zip(frames, taken, strict=True):
            yield captioned(picture, self._caption(frame))

    def _caption(self, frame: int) -> str:
        record = self.start.record
        caption = f"{self.motion.time[frame]:.3f} s   {record.scene} {record.run_id[:8]}: "
        scale = f"   1 N is {self.motion.scale:g} m" if len(self.motion.forces.frame) else ""
        return caption + record.label + scale
