"""`contactlab labels`: all that a run can be called."""

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import command
from contactlab.command_line.listing import LISTED, Listing


@command("list", formats=LISTED)
def labels(*, plugin: opt.Plugins = ()) -> Listing:
    """List every label, worst first: its meaning and the thresholds that it depends on."""
    from contactlab.measure import LABELS

    opt.load_plugins(plugin)
    rows = [
        (label.name, label.meaning, ", ".join(limit.name for limit in label.thresholds))
        for label in LABELS.values()
    ]
    return Listing(("label", "meaning", "thresholds"), rows)
