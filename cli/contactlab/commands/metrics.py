"""`contactlab metrics`: all that is measured of a run."""

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import command
from contactlab.command_line.listing import LISTED, Listing


@command("list", formats=LISTED)
def metrics(*, plugin: opt.Plugins = ()) -> Listing:
    """List every metric: unit, direction, version and definition."""
    from contactlab.measure import METRICS

    opt.load_plugins(plugin)
    rows = [
        (metric.name, metric.unit, metric.better, metric.version, metric.definition)
        for metric in METRICS.values()
    ]
    return Listing(("metric", "unit", "better", "version", "definition"), rows)
