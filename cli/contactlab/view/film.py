"""Pictures as files: films, and sheets of moments."""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import av
from av.video.stream import VideoStream
from PIL import Image

from contactlab.store import replacing
from contactlab.view import Picture
from contactlab.view.caption import sheet

_MILLISECONDS = 1000
# Half as large as encoders' usual best, and no difference to the eye.
_QUALITY = {"crf": "20"}


def write_mp4(target: Path, pictures: Iterator[Picture], rate: int) -> None:
    """Write pictures of one even size as H.264 video, `rate` a second."""
    with replacing(target) as temporary, av.open(str(temporary), "w", format="mp4") as container:
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
    with replacing(target) as temporary:
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
    with replacing(target) as temporary:
        sheet(pictures).save(temporary, format="PNG")
