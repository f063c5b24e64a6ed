"""`contactlab sweeps`: the shipped sweeps."""

from hashlib import sha256
from pathlib import Path

from contactlab.command_line.declaration import command
from contactlab.command_line.listing import LISTED, Listing


@command("list", formats=LISTED)
def sweeps() -> Listing:
    """List the shipped sweeps."""
    from contactlab import resources

    # To count the runs of a file that is not indexed takes the engine.
    index = resources.sweep_index()
    files = map(resources.sweep_file, resources.sweep_names())
    rows = [index.get(sha256(path.read_bytes()).hexdigest()) or sweep_row(path) for path in files]
    return Listing(("sweep", "scene", "runs", "description"), rows)


def sweep_row(path: Path) -> tuple[str, str, int, str]:
    """Return name, scene, number of runs and description of a sweep file."""
    from contactlab.plan.sweep_file import read_sweep
    from contactlab.run.sweep_request import SceneLoader

    read = read_sweep(path, SceneLoader(path.parent).vocabulary)
    return path.stem, read.sweep.scene, read.plan.count, read.sweep.description or ""
