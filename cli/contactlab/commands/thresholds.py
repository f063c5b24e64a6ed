"""`contactlab thresholds`: where labels begin."""

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import command
from contactlab.command_line.listing import LISTED, Listing


@command("list", formats=LISTED)
def thresholds(*, plugin: opt.Plugins = ()) -> Listing:
    """List every threshold that a scene or a sweep may set: its default, unit and source."""
    from contactlab.measure import THRESHOLDS

    opt.load_plugins(plugin)
    rows = [
        (threshold.name, threshold.default, threshold.unit, threshold.source)
        for threshold in THRESHOLDS.values()
    ]
    return Listing(("threshold", "default", "unit", "source"), rows)
