"""Pictures of a run, taken and written as films and sheets."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import av
import numpy as np
from av.video.stream import VideoStream
from PIL import Image, ImageDraw, ImageFont

from contactlab.contact import Floats
from contactlab.run.stored_runs import PreparedReplay
from contactlab.store import atomic_write
from contactlab.view.animation import BodyMotion
from contactlab.view.drawn_motion import frame_times, nearest
from contactlab.view.mujoco_pictures import Picture, draw_pictures
from contactlab.view.picture_options import FILMS, SHEET, PictureOptions

_SIZE = (640, 480)
_MOMENTS = 6


@dataclass(frozen=True)
class RunPictures:
    """Pictures of a run that are still to be taken.

    Attributes:
        start: the run's record and model.
        motion: what is drawn.
        qpos: (F, nq) configurations of the motion's frames.
        look: how pictures are taken.
    """

    start: PreparedReplay
    motion: BodyMotion
    qpos: Floats
    look: PictureOptions

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
        taken = draw_pictures(model, self.motion, chosen, size, self.look.camera)
        for frame, picture in zip(frames, taken, strict=True):
            yield captioned(picture, self._caption(frame))

    def _caption(self, frame: int) -> str:
        record = self.start.record
        caption = f"{self.motion.time[frame]:.3f} s   {record.scene} {record.run_id[:8]}: "
        scale = f"   1 N is {self.motion.scale:g} m" if len(self.motion.forces.frame) else ""
        return caption + record.label + scale


_MILLISECONDS = 1000
# Half as large as encoders' usual best, and no difference to the eye.
_QUALITY = {"crf": "20"}


def write_mp4(target: Path, pictures: Iterator[Picture], rate: int) -> None:
    """Write pictures of one even size as H.264 video, `rate` a second."""
    with atomic_write(target) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream: VideoStream = container.add_stream("libx264", rate=rate, options=_QUALITY)
        first = next(pictures)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"
        for picture in chain([first], pictures):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def write_gif(target: Path, pictures: Iterator[Picture], rate: int) -> None:
    """Write pictures as an endless animation, `rate` a second."""
    images = (Image.fromarray(picture) for picture in pictures)
    with atomic_write(target) as temporary:
        next(images).save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=images,
            duration=_MILLISECONDS // rate,
            loop=0,
        )


def write_png(target: Path, pictures: Sequence[Picture]) -> None:
    """Write pictures side by side as one."""
    with atomic_write(target) as temporary:
        sheet(pictures).save(temporary, format="PNG")


_BACKGROUND, _INK = (255, 255, 255), (40, 44, 52)
_MARGIN = 6


def captioned(picture: Picture, text: str) -> Picture:
    """Return a picture with a line of text below it; its height stays even, as films need it."""
    height, width, _ = picture.shape
    size = max(10, width // 40)
    strip = size + 2 * _MARGIN
    image = Image.new("RGB", (width, (height + strip + 1) // 2 * 2), _BACKGROUND)
    image.paste(Image.fromarray(picture))
    place = (_MARGIN, height + _MARGIN // 2)
    ImageDraw.Draw(image).text(place, text, _INK, ImageFont.load_default(size))
    return np.asarray(image)


def sheet(pictures: Sequence[Picture]) -> Image.Image:
    """Return pictures of one size as an image, row by row, at most three in a row."""
    columns = min(len(pictures), 3)
    rows = math.ceil(len(pictures) / columns)
    height, width, _ = pictures[0].shape
    image = Image.new("RGB", (columns * width, rows * height), _BACKGROUND)
    for place, picture in enumerate(pictures):
        row, column = divmod(place, columns)
        image.paste(Image.fromarray(picture), (column * width, row * height))
    return image


_WRITERS = {".mp4": write_mp4, ".gif": write_gif}
