"""`contactlab render`: a stored run in 3D, and traces as messages."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command
from contactlab.command_line.report_formats import formats_by_type, report_formats
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo
from contactlab.errors import OutputError, StoreError

if TYPE_CHECKING:
    from contactlab.schema.store_reports import ExpandedTraces
    from contactlab.store.finished_store import Store


def _print_path(result: Any, arguments: Arguments) -> None:  # noqa: ANN401 - a path, or None
    del arguments
    if result is not None:
        echo(result)


@command(
    "read",
    keeps="nothing",
    examples=(
        "render results/grasp 3ead3115 -o run.mcap",
        "render results/grasp 3ead3115            # in MuJoCo's viewer",
        "render results/grasp -o messages         # all traces, as plain MCAP messages",
    ),
    formats=formats_by_type(
        {
            "ExpandedTraces": report_formats(),
            **{name: {"text": _print_path} for name in ("NoneType", "PosixPath", "WindowsPath")},
        }
    ),
)
def render(
    store: opt.StoreArgument,
    run: Annotated[
        str | None,
        Argument("RUN", "Run id, or its first digits; all runs if traces go to a folder."),
    ] = None,
    *,
    output: Annotated[
        str | Path | None,
        Option(
            "FILE|FOLDER",
            "File to write: .mcap (Foxglove, Lichtblick), .rrd (Rerun), .mp4, .gif, .png or "
            ".svg; or a folder for traces as messages. MuJoCo's viewer by default.",
            kind=Path,
            short="-o",
        ),
    ] = None,
    at: Annotated[
        Sequence[float],
        Option("SECONDS", "Time of a .png or .svg; may be repeated.", kind=list[float]),
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
) -> "Path | ExpandedTraces | None":
    """Render a stored run in 3D with forces: viewer, film, pictures.

    The file's path is returned, or None once the viewer is closed. A folder gets the trace of the
    run, or of all runs, as messages that any reader of MCAP opens, with every bit of a compact
    trace.

    Raises:
        OutputError: the kind of file is unknown, its extra is not installed, or it cannot be
            written.
        StoreError: there is no such store or run, or it has no trace.
    """
    from contactlab.plugins import find_extensions
    from contactlab.store.finished_store import Store

    viewers, target = find_extensions("viewer"), None if output is None else Path(output)
    suffix = target.suffix.lower().removeprefix(".") if target else ""
    if suffix and suffix not in viewers.keys() - {"window"}:
        endings = ", ".join(f".{name}" for name in viewers if name != "window")
        raise OutputError(f"cannot write {target}: end its name in {endings}")
    opened = Store.open(opt.address_of(store))
    if target is not None and not suffix:
        return _write_messages(opened, run, target)
    if run is None:
        raise OutputError("name a run of the store, or a folder for all traces: -o FOLDER")
    if target is None:
        from contactlab.run.stored_runs import prepare_replay

        start = prepare_replay(opened, run)
        viewers["window"].load()(start.prepared_model.model, start.runs.starts)
        return None
    write = viewers[suffix].load()
    if isinstance(size, str):
        wide, cross, high = size.partition("x")
        if not (cross and wide.isdecimal() and high.isdecimal()):
            raise OutputError(f"--size {size}: write width and height, as in 640x480")
        size = int(wide), int(high)
    if note := write(
        opened,
        run,
        target,
        size=size,
        camera=camera,
        speed=speed,
        at=at,
        other_run=side_by_side,
    ):
        say(note)
    return target


def _write_messages(store: "Store", run: str | None, folder: Path) -> "ExpandedTraces":
    from contactlab.schema.store_reports import ExpandedTraces
    from contactlab.step_progress import count_steps
    from contactlab.store.atomic_files import atomic_write, write_errors

    records = [store.record(run)] if run else [one for one in store.records() if one.trace]
    if not records:
        raise StoreError(
            f"{store.address} has no traces; sweep again with --set trace=all elsewhere"
        )
    if isinstance(store.address, Path) and folder.resolve().is_relative_to(store.address.resolve()):
        raise OutputError(f"{folder} is in the store; name another folder")
    size = 0
    for record in count_steps(records, "traces", len(records)):
        content = store.trace_messages(record)
        with write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / f"{record.run_id}.mcap") as temporary:
            temporary.write_bytes(content)
        size += len(content)
    return ExpandedTraces(folder=folder, traces=len(records), bytes=size)
