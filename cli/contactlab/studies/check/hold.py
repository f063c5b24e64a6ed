"""Check 4: do the pairs that carry force hold, and what mends them if not."""

from dataclasses import dataclass

import numpy as np

from contactlab.schema import CheckResult, Measure
from contactlab.studies.check.bench import Bench, Tried
from contactlab.studies.check.findings import at_most, below, inapplicable, noted, result
from contactlab.studies.check.hold_remedies import mend, verdict_on_chatter
from contactlab.studies.check.target import Target
from contactlab.studies.check.window import Held, held_pairs

NAME = "hold"
SWITCHES = 5.0
"""Mode switches a second from which practice calls a pad chattering."""

DEPTH = 1e-3
"""Mean depth [m] under which practice calls a grasp plausible."""

SLIP = 1e-4
"""Distance [m] by which what is held may slip."""

LOOSE = 0.5
"""Share of the time in which nothing may bear force where a scene says that it holds."""

_BANDS = ((5e-3, "broken"), (3e-3, "exploited"), (DEPTH, "a compromise"))
_UNITS = {"m": (1e3, " mm"), "1": (1.0, "")}
_WINDOW = 0.5
_ASKS = "what is held stays: below 5 mode switches a second, 1 mm of mean depth, 0.1 mm of slip"


@dataclass(frozen=True)
class Grip:
    """What is held in a window of a run.

    Attributes:
        window: its start and end [s].
        pairs: the pairs that bear force in it.
        measures: what was measured.
    """

    window: tuple[float, float]
    pairs: tuple[Held, ...]
    measures: tuple[Measure, ...]


def check_hold(bench: Bench) -> CheckResult:
    """Look at the pairs that carry force in the window of a hold; if they do not, try remedies."""
    target, own = bench.target, bench.own
    grip = grip_of(target, own)
    if not grip.measures:
        return inapplicable(NAME, _ASKS, _nothing(grip), stores=bench.stores("run"))
    changes = mend(bench, grip.measures, lambda tried: grip_of(target, tried).measures)
    return result(
        NAME,
        _ASKS,
        "; ".join([_reason(grip, own), *verdict_on_chatter(changes)]),
        grip.measures,
        changes=changes,
        stores=bench.stores("run", "hold_remedies"),
    )


def grip_of(target: Target, tried: Tried) -> Grip:
    """Return what is held in a run of the model."""
    end, declared = tried.record.duration, target.hold_window
    window = declared or (max(0.0, end - _WINDOW), end)
    if not tried.whole:
        lost = tried.record.steps_asked - tried.record.steps
        return Grip(window, (), (below("steps_lost", lost, "1", 1),))
    bearing = tuple(each for each in held_pairs(target, tried, *window) if each.share > 0)
    kept = bearing if declared else tuple(each for each in bearing if each.holds)
    measures = [measure for each in kept for measure in _measures(each)]
    if declared:
        measures += _declared(tried)
    return Grip(window, bearing, tuple(measures))


def _measures(held: Held) -> list[Measure]:
    return [
        below("mode_switches", held.switches, "1/s", SWITCHES, held.name),
        below("penetration_mean", held.depth, "m", DEPTH, held.name),
        below("slip", held.slip, "m", SLIP, held.name),
        noted("force_mean", held.force, "N", held.name),
    ]


def _declared(tried: Tried) -> list[Measure]:
    """Return what says of a scene that declares its hold whether it still holds, and how well."""
    contact, drop = (tried.record.metrics.get(name) for name in ("hold_contact", "hold_drop"))
    share = np.nan if contact is None else contact
    more = [] if drop is None else [noted("drop", drop, "m")]
    return [at_most("loose_share", 1 - share, "1", LOOSE), *more]


def _nothing(grip: Grip) -> str:
    start, stop = grip.window
    span = f"from {start:g} to {stop:g} s"
    loose = [each.name for each in grip.pairs]
    if not loose:
        return f"no graded pair carries force {span}: nothing is held"
    return (
        f"{span} {', '.join(loose[:3])} carry force, but now and then or only as they slide: "
        "nothing is held; a scene that holds something says so under `hold`"
    )


def _reason(grip: Grip, own: Tried) -> str:
    """Say the worst value of each measure, those that miss their limit first."""
    if not own.whole:
        return f"the model's run does not get to its end: {own.record.status_reason}"
    worst = {each.name: each for each in sorted(grip.measures, key=_size)}
    limited = [worst[name] for name in dict.fromkeys(each.name for each in grip.measures)]
    told = sorted(
        (each for each in limited if each.limit is not None), key=lambda each: bool(each.holds)
    )
    start, stop = grip.window
    return f"from {start:g} to {stop:g} s: {', '.join(_said(each) for each in told)}"


def _size(measure: Measure) -> float:
    return np.inf if measure.value is None else measure.value


def _said(measure: Measure) -> str:
    words = measure.name.replace("_", " ")
    if measure.value is None:
        return f"{words} cannot be measured, for nothing holds"
    scale, unit = _UNITS.get(measure.unit, (1.0, f" {measure.unit}"))
    value, limit = measure.value * scale, (measure.limit or 0) * scale
    band = next((word for least, word in _BANDS if measure.value >= least), "")
    banded = f", {band}" if band and measure.name == "penetration_mean" else ""
    return f"{words} {value:.3g}{unit} (limit {limit:g}{banded})"
