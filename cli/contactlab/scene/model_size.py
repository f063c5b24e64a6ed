"""Models that are too large to compile, told from their files before memory is asked for."""

import math
import struct
import xml.etree.ElementTree as ET
from pathlib import Path

from contactlab.errors import SceneError

_MOST_VALUES = 1 << 28
"""Heights of a field, or pixels of a texture."""
_MOST_COPIES = 1 << 20
"""Bodies or points that one element makes."""
_VALUES = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
_COPIES = ("flexcomp", "composite", "replicate")
_PNG = struct.Struct(">8s4x4sII")


def check_element(element: ET.Element, file: Path) -> None:
    """Check that an element of a model asks for no absurd number of values or copies.

    Raises:
        SceneError: it does.
    """
    if element.tag in _VALUES:
        _check(file, element, [element.get(key, "1") for key in _VALUES[element.tag]], _MOST_VALUES)
    elif element.tag in _COPIES:
        _check(file, element, element.get("count", "1").split(), _MOST_COPIES)


def check_picture(path: Path) -> None:
    """Check that a PNG file, which may be small, has no absurd number of pixels.

    Raises:
        SceneError: it has.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_PNG.size)
    if len(head) == _PNG.size:
        magic, kind, width, height = _PNG.unpack(head)
        if magic == b"\x89PNG\r\n\x1a\n" and kind == b"IHDR" and width * height > _MOST_VALUES:
            raise SceneError(f"{path}: {width} x {height} pixels are more than {_MOST_VALUES:,}")


def _check(file: Path, element: ET.Element, counts: list[str], most: int) -> None:
    try:
        product = math.prod(float(count) for count in counts)
    except ValueError:
        # Left to the compiler, whose message says what is wrong.
        return
    if product > most:
        name = f" '{element.get('name')}'" if element.get("name") else ""
        size = " x ".join(counts)
        raise SceneError(
            f"{file}: {element.tag}{name} of {size} is more than {most:,}; make it smaller"
        )
