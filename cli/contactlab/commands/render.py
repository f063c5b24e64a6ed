"""`contactlab render`: a stored run in 3D."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Given, Option, command
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo
from contactlab.errors import OutputError


def _text(path: Path, given: Given) -> None:
    del given
    echo(path)


@command("read", examples=("render results/grasp 3ead3115 -o run.mcap",), formats={"text": _text})
def render(
    store: opt.StoreArgument,
    run: opt.Run,
    *,
    output: Annotated[
        str | Path,
        Option(
            "FILE",
            "File to write: .mcap (Foxglove, Lichtblick), .rrd (Rerun), .mp4, .gif or .png.",
            kind=Path,
            short="-o",
        ),
    ],
    at: Annotated[
        Sequence[float],
        Option("SECONDS", "Time of a .png; may be repeated.", kind=list[float]),
    ] = (),
    speed: Annotated[
        float | None, Option(None, "Playback speed of a film; 0.1 is slow motion.")
    ] = None,
    size: Annotated[
        str | tuple[int, int] | None,
        Option("WIDTHxHEIGHT", "Size in pixels: 640x480.", kind=str),
    ] = None,
    camera: Annotated[str | None, Option(None, "Camera of the model.")] = None,
    side_by_side: Annotated[
        str | None, Option("RUN", "Another run of the store, drawn next to it.")
    ] = None,
) -> Path:
    """Render a stored run in 3D with forces: viewer, film, pictures.

    The file's path is returned.

    Raises:
        OutputError: the kind of file is unknown, or its extra is not installed.
        StoreError: there is no such store or run, or it has no trace.
    """
    from contactlab.plugins import extensions
    from contactlab.store.finished_store import Store

    found, target = extensions("viewer"), Path(output)
    suffix = target.suffix.lower().removeprefix(".")
    if suffix not in found.keys() - {"window"}:
        known = ", ".join(f".{name}" for name in found if name != "window")
        raise OutputError(f"cannot write {target}: end its name in {known}")
    write = found[suffix].load()
    if note := write(
        Store.open(opt.address_of(store)),
        run,
        target,
        size=_size(size) if isinstance(size, str) else size,
        camera=camera,
        speed=speed,
        at=at,
        beside=side_by_side,
    ):
        say(note)
    return target


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise OutputError(f"--size {text}: write width and height, as in 640x480")
    return int(width), int(height)
