"""Forces at rest, judged by the weight of what they press."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.context import Context, cached, runs_where, worst_pair
from contactlab.measure.entries import Finding, Found, MeasuredRuns, Threshold, label, metric

PRESSED = Threshold(
    "weights_borne",
    10.0,
    "1",
    "Of a pair that presses half as hard when nothing but contact has acted for a while. Towers "
    "and motors reach thousands, and relax; wedges reach ten.",
)
_ALONE = 0.5


@cached
def _borne(context: Context) -> list[Floats]:
    """Return for each pair (n,) the median of its normal force in the last fifth, in weights."""
    pairs = zip(context.series, context.setup.weights, strict=True)
    return [np.median(each.normal[:, context.last_fifth], axis=1) / own for each, own in pairs]


@metric("1", "lower", 1e-6, kind="detail")
def weights_borne(context: Context) -> Floats:
    """Median normal force of a pair in the last fifth over the weight of the lighter side, worst.

    Weights are those at 9.81 m/s^2 of the trees of bodies that the pair's sides belong to. Not
    defined under a drive that keeps changing the controls.
    """
    return context.undefined() if context.setup.steered else worst_pair(context, _borne(context))


@label(50, (PRESSED,))
def squeezed(runs: MeasuredRuns) -> Found:
    """Bodies at rest press each other with many times their weight, by nothing but overlap."""
    context, checks = runs.context, runs.context.checks
    if checks is None:
        return
    for run, _, limit in runs.over(PRESSED.name):
        weights, borne = context.setup.weights, [each[run] for each in _borne(context)]
        alone = checks.squeeze[run] / weights >= _ALONE * np.array(borne)
        for pair in runs_where(alone & (np.array(borne) > limit)):
            amount = f"{borne[pair]:.3g} times the weight of the lighter (limit {limit:g})"
            reason = f"{context.series[pair].name} is squeezed by {amount}"
            yield run, Finding(reason, context.last_fifth.start)
