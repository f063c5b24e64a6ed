"""What is written below a picture, and pictures side by side."""

import math
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from contactlab.view import Picture

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
