"""Textures of a model as a page draws them: small pictures, and mean colors of others."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

_TEXTURE_ROLES = (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA)
_FLAT_TEXTURE = int(mujoco.mjtTexture.mjTEXTURE_2D)


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
    opaque_byte = 255
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
        red, green, blue = (pixels.mean(axis=(0, 1)) / opaque_byte).tolist()
        across, along = model.mat_texrepeat[material].tolist()
        picture = None
        if int(model.tex_type[texture]) == _FLAT_TEXTURE:
            # Blocks of pixels become one, so that a side has at most 256.
            block = -(-max(height, width) // 256)
            rows, columns = max(1, height // block), max(1, width // block)
            cut = pixels[: rows * block, : columns * block]
            size = cut.shape[0] // rows, cut.shape[1] // columns
            blocks = cut.reshape(rows, size[0], columns, size[1], 3)
            picture = np.full((rows, columns, 4), opaque_byte, np.uint8)
            picture[:, :, :3] = blocks.mean(axis=(1, 3)).round()
        yield Texture(
            material,
            (red, green, blue),
            (across, along),
            bool(model.mat_texuniform[material]),
            picture,
        )
