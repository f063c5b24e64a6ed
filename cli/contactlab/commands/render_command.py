"""`contactlab render`: a stored run for a 3D viewer, as a film or as pictures."""

from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.options import RunArgument, StoreArgument
from contactlab.commands.terminal import echo, say
from contactlab.errors import OutputError


def render(
    store: StoreArgument,
    run: RunArgument,
    target: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File to write: .mcap (Foxglove, Lichtblick), .rrd (Rerun), .mp4, .gif or .png.",
        ),
    ],
    at: Annotated[
        list[float] | None, typer.Option(metavar="SECONDS", help="Time of a .png; may be repeated.")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Playback speed of a film; 0.1 is slow motion.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WIDTHxHEIGHT", help="Size in pixels: 640x480.")
    ] = None,
    camera: Annotated[str | None, typer.Option(help="Camera of the model.")] = None,
) -> None:
    """Render a stored run in 3D with its contact forces: for a viewer, as a film or pictures."""
    from contactlab.store.finished_store import Store
    from contactlab.view.picture_options import PictureOptions
    from contactlab.view.render import render as write

    options = PictureOptions(_size(size), camera, speed, tuple(at or ()))
    motion = write(Store.open(store), run, target, options)
    if len(motion.forces.frame):
        say(
            f"an arrow is the force on the second side of a pair: {motion.scale:g} m long for 1 N, "
            f"at most {motion.longest:.3g} m"
        )
    echo(target)


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise OutputError(f"--size {text}: write width and height, as in 640x480")
    return int(width), int(height)
