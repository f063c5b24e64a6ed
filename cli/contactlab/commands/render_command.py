"""`contactlab render`: a stored run as a file to look at."""

from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.options import StoreArgument
from contactlab.commands.terminal import say
from contactlab.errors import OutputError


def render(  # noqa: PLR0913, PLR0917 - one argument an option
    store: StoreArgument,
    run: Annotated[str, typer.Argument(help="The run's id, or the start of it.")],
    target: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="The file: .mcap (Foxglove, Lichtblick), .rrd (Rerun), .mp4, .gif or .png.",
        ),
    ],
    at: Annotated[
        list[float] | None, typer.Option(help="A moment [s] for a .png; repeat for more.")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Speed of a film; 0.1 is slow motion.")
    ] = None,
    size: Annotated[str | None, typer.Option(help="Pixels of a picture: 640x480.")] = None,
    camera: Annotated[str | None, typer.Option(help="A camera of the model.")] = None,
) -> None:
    """Show a stored run in 3D with its contact forces: for a viewer, as a film or as pictures."""
    from contactlab.store import Store
    from contactlab.view import PictureOptions
    from contactlab.view import render as write

    look = PictureOptions(_size(size), camera, speed, tuple(at or ()))
    motion = write(Store.open(store), run, target, look)
    if len(motion.forces.frame):
        say(
            f"an arrow is the force on the second side of a pair, {motion.scale:g} m long for 1 N "
            f"and cut at {motion.longest:.3g} m"
        )
    typer.echo(target)


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise OutputError(f"--size {text}: write width and height, as in 640x480")
    return int(width), int(height)
