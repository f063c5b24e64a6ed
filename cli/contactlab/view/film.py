"""A run as a film or a sheet of pictures."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import av
import numpy as np
from av.video.stream import VideoStream
from PIL import Image, ImageDraw, ImageFont

from contactlab.contact.trace_arrays import Floats
from contactlab.run.stored_runs import PreparedReplay
from contactlab.store.atomic_files import atomic_write
from contactlab.view.drawn_motion import BodyMotion, frame_times, nearest
from contactlab.view.mujoco_pictures import Picture, draw_pictures
from contactlab.view.picture_options import FILMS, SHEET, PictureOptions

_SIZE = (640, 480)
_SHEET_PICTURES = 6
# Half the size of the encoder's default, and no visible difference.
_H264_OPTIONS = {"crf": "20"}
_BACKGROUND, _INK = (255, 255, 255), (40, 44, 52)
_MARGIN = 6


@dataclass(frozen=True)
class RunPictures:
    """The pictures of a run, drawn when they are written.

    Attributes:
        qpos: (F, nq) configurations of the motion's frames.
    """

    replay: PreparedReplay
    motion: BodyMotion
    qpos: Floats
    options: PictureOptions

    def write(self, target: Path) -> None:
        """Write a film or a sheet, as the file's suffix says."""
        suffix = target.suffix.lower()
        if suffix == SHEET:
            write_sheet(target, self.sheet())
        else:
            write_film = write_mp4 if suffix == ".mp4" else write_gif
            write_film(target, self.film(FILMS[suffix]), FILMS[suffix])

    def film(self, rate: float) -> Iterator[Picture]:
        """Yield a film's pictures, `rate` per second of film."""
        times = frame_times(self.motion.time, rate / (self.options.speed or 1.0))
        frames_of_times = nearest(self.motion.time, times)
        repeats = np.bincount(frames_of_times, minlength=len(self.motion.time)).tolist()
        frames = [frame for frame, count in enumerate(repeats) if count]
        for frame, picture in zip(frames, self._draw(frames), strict=True):
            for _ in range(repeats[frame]):
                yield picture

    def sheet(self) -> list[Picture]:
        """Return a sheet's pictures."""
        times = np.array(self.options.at or self._default_times())
        wanted: list[int] = nearest(self.motion.time, times).tolist()
        frames = sorted(set(wanted))
        drawn = dict(zip(frames, self._draw(frames), strict=True))
        return [drawn[frame] for frame in wanted]

    def _default_times(self) -> list[float]:
        """Return six times, evenly over the frames in which a moving body is in view."""
        motion = self.motion
        far = np.linalg.norm(motion.positions[:, motion.moving] - motion.centre, axis=2)
        in_view = motion.time[(far <= motion.radius).any(axis=1)]
        span = in_view if len(in_view) else motion.time
        return np.linspace(span[0], span[-1], _SHEET_PICTURES).tolist()

    def _draw(self, frames: Sequence[int]) -> Iterator[Picture]:
        chosen = {frame: self.qpos[frame] for frame in frames}
        model, size = self.replay.prepared.model, self.options.size or _SIZE
        drawn = draw_pictures(model, self.motion, chosen, size, self.options.camera)
        for frame, picture in zip(frames, drawn, strict=True):
            yield captioned(picture, self._caption(frame))

    def _caption(self, frame: int) -> str:
        record = self.replay.record
        caption = f"{self.motion.time[frame]:.3f} s   {record.scene} {record.run_id[:8]}: "
        scale = f"   1 N is {self.motion.scale:g} m" if len(self.motion.forces.frame) else ""
        return caption + record.label + scale


def write_mp4(target: Path, pictures: Iterator[Picture], rate: int) -> None:
    """Write pictures of one even size as H.264 video, `rate` per second."""
    with atomic_write(target) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream: VideoStream = container.add_stream("libx264", rate=rate, options=_H264_OPTIONS)
        first = next(pictures)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"
        for picture in chain([first], pictures):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def write_gif(target: Path, pictures: Iterator[Picture], rate: int) -> None:
    """Write pictures as an endless animation, `rate` per second."""
    images = (Image.fromarray(picture) for picture in pictures)
    with atomic_write(target) as temporary:
        animation = {"save_all": True, "append_images": images, "duration": 1000 // rate, "loop": 0}
        next(images).save(temporary, format="GIF", **animation)


def captioned(picture: Picture, text: str) -> Picture:
    """Return a picture with a line of text below it; its height is even, as H.264 requires."""
    height, width, _ = picture.shape
    size = max(10, width // 40)
    strip = size + 2 * _MARGIN
    image = Image.new("RGB", (width, (height + strip + 1) // 2 * 2), _BACKGROUND)
    image.paste(Image.fromarray(picture))
    place = (_MARGIN, height + _MARGIN // 2)
    ImageDraw.Draw(image).text(place, text, _INK, ImageFont.load_default(size))
    return np.asarray(image)


def write_sheet(target: Path, pictures: Sequence[Picture]) -> None:
    """Write pictures of one size as one PNG, row by row, at most three in a row."""
    columns = min(len(pictures), 3)
    rows = math.ceil(len(pictures) / columns)
    height, width, _ = pictures[0].shape
    sheet = Image.new("RGB", (columns * width, rows * height), _BACKGROUND)
    for index, picture in enumerate(pictures):
        row, column = divmod(index, columns)
        sheet.paste(Image.fromarray(picture), (column * width, row * height))
    with atomic_write(target) as temporary:
        sheet.save(temporary, format="PNG")
