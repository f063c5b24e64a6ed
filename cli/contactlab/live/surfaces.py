"""Textures of a model as a page draws them: small pictures, and mean colors of others."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

_TEXTURE_ROLES = (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA)
_FLAT_TEXTURE = int(mujoco.mjtTexture.mjTEXTURE_2D)
_OPAQUE_BYTE = 255


@dataclass(frozen=True, eq=False)
class Texture:
    """The look of a material, in addition to its colour."""

    material: int
    mean: tuple[float, float, float]  # red, green and blue, 0 to 1
    repeat: tuple[float, float]
    uniform: bool  # repeated over lengths [m], not over a geom
    picture: NDArray[np.uint8] | None  # (height, width, 4); None for textures around a body


def textures_of(model: mujoco.MjModel) -> Iterator[Texture]:
    """Yield the textures of a model's materials; a side of a picture has at most 256 pixels."""
    for material, textures in enumerate(model.mat_texid):
        texture = max(int(textures[role]) for role in _TEXTURE_ROLES)
        if texture < 0:
            continue
        # A single channel is grey.
        height, width, channels = (
            int(field[texture]) for field in (model.tex_height, model.tex_width, model.tex_nchannel)
        )
        first = int(model.tex_adr[texture])
        pixels = model.tex_data[first : first + height * width * channels]
        pixels = np.broadcast_to(
            pixels.reshape(height, width, channels)[:, :, :3], (height, width, 3)
        ).astype(np.uint8)
        red, green, blue = (pixels.mean(axis=(0, 1)) / _OPAQUE_BYTE).tolist()
        across, along = model.mat_texrepeat[material].tolist()
        flat = int(model.tex_type[texture]) == _FLAT_TEXTURE
        yield Texture(
            material,
            (red, green, blue),
            (across, along),
            bool(model.mat_texuniform[material]),
            _shrink_picture(pixels) if flat else None,
        )


def _shrink_picture(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    most_pixels = 256  # pixels of a side
    block = -(-max(pixels.shape[:2]) // most_pixels)
    height, width = (max(1, side // block) for side in pixels.shape[:2])
    cut = pixels[: height * block, : width * block]
    rows, columns = cut.shape[0] // height, cut.shape[1] // width
    means = cut.reshape(height, rows, width, columns, 3).mean(axis=(1, 3))
    opaque = np.full((height, width, 4), _OPAQUE_BYTE, np.uint8)
    opaque[:, :, :3] = means.round()
    return opaque
