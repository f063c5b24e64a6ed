"""`contactlab shrink`: the smallest model that fails as a stored run does."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Option, command
from contactlab.command_line.quantities import read_seconds
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say

if TYPE_CHECKING:
    from contactlab.schema.shrink_report import ShrinkReport


@command(
    "read",
    keeps="nothing",
    examples=("shrink results/grasp 3ead3115", "shrink results/pile 1fef82b1 -o pile-small"),
    formats=report_formats(),
)
def shrink(
    store: opt.StoreArgument,
    run: opt.Run,
    *,
    output: Annotated[
        str | Path | None,
        Option("FOLDER", "Output folder; default results/shrink/RUN.", kind=Path, short="-o"),
    ] = None,
    max_time: opt.MaxTime = "60s",
    plugin: opt.Plugins = (),
) -> "ShrinkReport":
    """Find the smallest model that fails as a stored run does.

    Bodies, geoms, joints, actuators, options and vertices are removed while label and pair stay.
    The folder gets the model with its start, the sweep that runs it, and an issue text.

    Raises:
        StoreError: there is no such store or run, or it is stable.
        SceneError: its model cannot be written as one file, or does not fail alone.
        OutputError: the folder cannot be written, or is not empty.
    """
    from contactlab import resources
    from contactlab.errors import OutputError
    from contactlab.store.finished_store import Store
    from contactlab.studies.shrink.shrinking import ShrinkRequest
    from contactlab.studies.shrink.shrinking import shrink_run as shrunk

    opt.load_plugins(plugin)
    opened = Store.open(opt.address_of(store))
    folder = Path(output) if output else resources.RESULTS / "shrink" / opened.record(run).run_id
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder} is not empty; choose another folder with -o")
    request = ShrinkRequest(opened, run, folder, read_seconds(max_time))
    return shrunk(request, say)
