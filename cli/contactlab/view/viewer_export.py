"""A run for viewers; what they need beyond the store's own means is loaded when asked for."""

from pathlib import Path

from contactlab.errors import optional
from contactlab.store.mcap import StoredTrace
from contactlab.view.animation import BodyMotion


def export_mcap(source: Path, target: Path, motion: BodyMotion) -> None:
    """Write a stored trace file once more, with a 3D layer for Foxglove and Lichtblick.

    Args:
        source: a sound trace file of ours.
        target: the file to make or replace.
        motion: what is drawn of its run.

    Raises:
        OutputError: the file cannot be written, or the message schemas are not installed.
    """
    with optional("view", f"{target.suffix} with a 3D layer"):
        from contactlab.view.foxglove_layer import write_with_layer  # noqa: PLC0415 - an extra
    write_with_layer(source, target, motion)


def export_rrd(target: Path, trace: StoredTrace, motion: BodyMotion) -> None:
    """Write a run as a Rerun recording.

    Args:
        target: the file to make or replace.
        trace: the run's trace.
        motion: what is drawn of it.

    Raises:
        OutputError: the file cannot be written, or Rerun is not installed.
    """
    with optional("rerun", target.suffix):
        from contactlab.view.rerun_export import write_rrd  # noqa: PLC0415 - an extra
    write_rrd(target, trace, motion)
