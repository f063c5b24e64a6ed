"""Draw docs/pictures/bounce.svg, a terminal after `contactlab sweep bounce`, and film two grips.

Run by `make picture`.
"""

import io
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image, ImageSequence
from rich.console import Console
from rich.text import Text

import contactlab
from contactlab.view.render import PictureOptions, render_run

_COMMAND = ["contactlab", "sweep", "bounce"]
_WIDTH = 118
# The picture stands by itself: fonts come from whoever looks at it.
_FOREIGN = re.compile(r"@font-face \{.*?\}\s*|<!-- .*? -->\s*", re.DOTALL)
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


def draw_terminal() -> None:
    """Run the sweep and write its output as a picture."""
    environment = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": str(_WIDTH)}
    tool = Path(sys.executable).with_name(_COMMAND[0])
    with TemporaryDirectory() as folder:
        done = subprocess.run(  # noqa: S603 - our own command
            [tool, *_COMMAND[1:]], cwd=folder, env=environment, capture_output=True, check=True
        )
    console = Console(record=True, width=_WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(f"$ {' '.join(_COMMAND)}")
    console.print(Text.from_ansi(done.stdout.decode()))
    picture = console.export_svg(title="contactlab", unique_id="bounce")
    Path("docs/pictures/bounce.svg").write_text(_FOREIGN.sub("", picture), encoding="utf-8")


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


def main() -> None:
    """Draw the pictures of the README that are made of runs."""
    draw_terminal()
    film_grips()


if __name__ == "__main__":
    main()
