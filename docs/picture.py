"""Film the two grips of the README, docs/pictures/grips.webp. Run by `make picture`."""

from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image, ImageSequence

import contactlab
from contactlab.view.render import PictureOptions, render_run

# Two grips on a mug that differ in one number; they fail and hold with and without checks.
_GRIPS = """
version: 1
scene: grasp_mug
trace: all
checks: none
axes:
  solref: ["0.005 1", "0.02 0.2"]
  timestep: [4.0e-3]
  cone: [pyramidal]
  solimp: ["0.9 0.95 0.001 0.5 2"]
"""
_SIZE, _SPEED, _QUALITY = (320, 300), 0.6, 75


def film_grips() -> None:
    """Film a grip that holds beside one that fails, as a WebP, which keeps all colours."""
    with TemporaryDirectory() as folder:
        sweep, film = Path(folder) / "grips.yaml", Path(folder) / "grips.gif"
        sweep.write_text(_GRIPS, encoding="utf-8")
        store = contactlab.sweep(sweep, output=Path(folder) / "grips")
        holds, fails = store.table["run_id"].to_pylist()
        render_run(store, holds, film, PictureOptions(_SIZE, speed=_SPEED, beside=fails))
        with Image.open(film) as animation:
            lasting = animation.info["duration"]
            first, *others = (each.convert("RGB") for each in ImageSequence.Iterator(animation))
    first.save(
        "docs/pictures/grips.webp",
        save_all=True,
        append_images=others,
        duration=lasting,
        loop=0,
        quality=_QUALITY,
    )


if __name__ == "__main__":
    film_grips()
