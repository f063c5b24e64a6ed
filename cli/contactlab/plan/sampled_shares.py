"""`until` of a sweep file: the runs that are draws of one configuration."""

from collections.abc import Collection, Mapping

from contactlab.plan.rows import SweepContext
from contactlab.plan.sides import FAILED, check_limit


def configuration_of(
    values: Mapping[str, object], drawn_axes: Collection[str]
) -> tuple[tuple[str, object], ...]:
    """Return the shared values of the draws of a configuration: those of the other axes."""
    return tuple((name, value) for name, value in values.items() if name not in drawn_axes)


def check_until(context: SweepContext) -> None:
    """Add the mistakes of the stop condition: draws must be independent of each other."""
    sweep, document = context.sweep, context.document
    if sweep.until is None:
        return
    place = document.key_place(("until",))
    drawn_axes = sweep.drawn_axes
    if not drawn_axes and len(sweep.seed_values) == 1:
        hint = "add seeds: 1000, or an axis as {uniform: [low, high]}"
        document.add_mistake("until-no-draws", place, "the sweep draws nothing at random", hint)
    if drawn_axes and len(sweep.seed_values) > 1:
        message = "runs that share a draw of the axes are not independent"
        document.add_mistake(
            "until-seeds", document.key_place(("seeds",)), message, "write seeds: 1"
        )
    if sweep.sample and drawn_axes and sweep.sample.method != "random":
        message = f"points of '{sweep.sample.method}' are not independent, so none may stop early"
        method = document.key_place(("sample", "method"))
        document.add_mistake("until-method", method, message, "write method: random")
    labels = context.vocabulary.labels
    check_limit(context, sweep.until.share, ("until", "share"), [FAILED, "must", *labels])
