"""Check 4: do the pairs that carry force hold, and what changes help if not."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from contactlab.contact.trace_arrays import SLIDE, SLOT_WIDTH, Floats, PairTrace, Trace
from contactlab.contact.trace_setup import HoldWindow, Setup
from contactlab.measure import assess
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.run_setup import make_setup
from contactlab.scene.setting_values import as_number
from contactlab.schema.check_report import Change, CheckResult, Measure
from contactlab.store.mcap.stored_trace import StoredTrace
from contactlab.studies.check.check_results import (
    change,
    check_result,
    informative,
    mjcf_text,
    not_applicable,
    strict_limit,
    upper_limit,
    violated,
)
from contactlab.studies.check.checked_model import CheckedModel, CheckRun, CheckRunner
from contactlab.studies.session import Values

_HELD = 0.5
"""Fraction of steps with force from which a pair counts as held; chattering pairs lose it."""

_SLIDES = 0.9
"""Fraction of these steps with sliding from which a pair just slides."""


@dataclass(frozen=True)
class HeldPair:
    """One pair in a time window.

    Attributes:
        name: the pair's name.
        share: fraction of steps in which it carries force.
        sliding: fraction of these in which it slides.
        force: mean net normal force over the window [N].
        switches: changes between stick and slide, and losses of contact while sticking [1/s].
        depth: mean penetration [m].
        slip: largest slip from its place at the start of the window [m].
    """

    name: str
    share: float
    sliding: float
    force: float
    switches: float
    depth: float
    slip: float

    @property
    def holds(self) -> bool:
        """Whether it carries force, and does not just slide."""
        return self.share >= _HELD and self.sliding < _SLIDES


def held_pairs(checked: CheckedModel, tried: CheckRun, start: float, stop: float) -> list[HeldPair]:
    """Return every monitored pair between two times [s] of a run of the model."""
    scene = checked.scene
    resolved = scene.resolve(tried.values, 0, tried.record.duration)
    base = scene.base(resolved.structure)
    model = base.prepare(resolved.edits()).model
    setup = make_setup(base, None, [resolved], [model], {})
    steps = slice(*(round(time / resolved.timestep) for time in (start, stop)))
    return list(_held(base.pairs, tried, steps, setup))


def _held(
    pairs: tuple[MonitoredPair, ...], tried: CheckRun, steps: slice, setup: Setup
) -> Iterator[HeldPair]:
    trace = tried.trace
    seconds = (steps.stop - steps.start) * np.diff(trace.time[:2])
    whole = HoldWindow(np.zeros(1), seconds)
    for index, pair in enumerate(pairs):
        friction = tried.record.pairs[pair.name].friction
        slots = PairTrace(pair.name, slots_of(trace, pair, steps), np.array([friction]))
        alone = replace(
            setup,
            thickness=setup.thickness[[index]],
            slots=setup.slots[[index]],
            barriers=(),
            hold=whole,
        )
        found = assess(part_of(trace, steps, (slots,)), alone)
        series, metrics = found.series[0], found.metrics
        bearing = series.normal[0] > 0
        yield HeldPair(
            name=pair.name,
            share=float(bearing.mean()),
            sliding=float((series.mode[0] == SLIDE)[bearing].mean()) if bearing.any() else 0.0,
            force=float(series.normal[0].mean()),
            switches=float(metrics["hold_switches"][0]),
            depth=float(metrics["penetration_mean"][0]),
            slip=float(metrics["hold_slip"][0]),
        )


def slots_of(trace: StoredTrace, pair: MonitoredPair, steps: slice) -> Floats:
    """Return the stored contact points of a pair as slots (1, N, S, 23) of some steps."""
    stored = next(each for each in trace.pairs if each.name == pair.name)
    slots = np.zeros((1, steps.stop - steps.start, pair.slots, SLOT_WIDTH))
    first = np.cumsum(stored.contacts) - stored.contacts
    place = np.arange(len(stored.points)) - np.repeat(first, stored.contacts)
    step = stored.point_steps
    inside = (step >= steps.start) & (step < steps.stop)
    slots[0, step[inside] - steps.start, place[inside]] = stored.points[inside]
    return slots


def part_of(trace: StoredTrace, steps: slice, pairs: tuple[PairTrace, ...]) -> Trace:
    """Return some steps of a stored run as the trace of one run, without momenta."""
    states = slice(steps.start, steps.stop + 1)
    return Trace(
        timestep=np.diff(trace.time[:2]),
        steps_asked=steps.stop - steps.start,
        time=trace.time[None, states],
        qpos=trace.qpos[None, states],
        qvel=trace.qvel[None, states],
        kinetic=trace.kinetic[None, steps],
        potential=trace.potential[None, steps],
        contacts=trace.contacts[None, steps],
        least_distance=trace.least_distance[None, steps],
        iterations=trace.iterations[None, steps],
        iterations_most=trace.iterations_most[None, steps],
        momentum=None,
        angular_momentum=None,
        pairs=pairs,
        warnings=({},),
    )


STORE = "hold_remedies"
_CHATTER = {"mode_switches"}
_LOST = "steps_lost"
_HARD: dict[str, object] = {"solimp": (0.99, 0.999, 0.001, 0.5, 2.0)}
_SHARES = (0.5, 0.25)
_FIRM: dict[str, object] = {"cone": "elliptic", "impratio": 10.0}
_FIRMEST: dict[str, object] = {**_FIRM, "solref": (0.005, 1.0)}


def try_remedies(
    runner: CheckRunner,
    measures: Sequence[Measure],
    measured: Callable[[CheckRun], Sequence[Measure]],
) -> list[Change]:
    """Try changes against the measures that miss their limits.

    Args:
        runner: runs the model.
        measures: of the model as it is.
        measured: returns the same measures of another run.

    Returns:
        The changes that were tried, those that help first.
    """
    failed = {each.name for each in violated(measures)}
    rows = list(_remedies(runner.checked, failed))
    if not rows:
        return []
    runs = runner.run(STORE, "What should mend the hold", rows, checks="none")
    tried = [_outcome(runner.checked, failed, each, measured(each)) for each in runs]
    return sorted(tried, key=lambda each: not each.cures)


def verdict_on_chatter(changes: Sequence[Change]) -> Iterator[str]:
    """Yield which of the guideline's two remedies against chatter helped, if they were tried."""
    hard = [each for each in changes if each.settings.keys() == _HARD.keys()]
    shorter = [each for each in changes if each.settings.keys() == {"timestep"}]
    if not hard:
        return
    longest = max((_timestep(each) for each in shorter if each.cures), default=None)
    yield (
        f"solimp {mjcf_text(_HARD['solimp'])} at the same timestep "
        f"{'cures' if hard[0].cures else 'does not cure'} the chatter, a smaller timestep "
        + ("does not" if longest is None else f"does, {longest * 1e3:g} ms")
    )


def _timestep(change: Change) -> float:
    return as_number(change.settings["timestep"])


def _remedies(checked: CheckedModel, failed: set[str]) -> Iterator[Values]:
    """Yield settings: a harder impedance or smaller timestep against chatter, else more friction.

    An incomplete run may complete with a smaller timestep.
    """
    if failed & _CHATTER:
        yield _HARD
    if failed & {*_CHATTER, _LOST}:
        shorter = [checked.resolved.timestep * share for share in _SHARES]
        yield from ({"timestep": each} for each in shorter if checked.fits(each, checked.duration))
    if failed - {*_CHATTER, _LOST}:
        yield _FIRM
        yield _FIRMEST


def _outcome(
    checked: CheckedModel, failed: set[str], tried: CheckRun, measures: Sequence[Measure]
) -> Change:
    """Return a change with whether it helps against its aim: chatter, or all other failures."""
    firm = _FIRM.keys() <= tried.row.keys()
    aimed = failed - _CHATTER if firm else failed & {*_CHATTER, _LOST}
    left = [each for each in violated(measures) if each.name in {*aimed, _LOST}]
    found = {each.name for each in measures}
    cures = not left and aimed - {_LOST} <= found
    said = " and ".join(f"{name} {mjcf_text(value)}" for name, value in tried.row.items())
    what = ", ".join(sorted(name.replace("_", " ") for name in aimed))
    numbers = ", ".join(_worst(measures, name) for name in sorted(aimed))
    verb = "cures" if cures else "does not cure"
    return change(checked, tried.row, cures=cures, shown=f"{said} {verb} {what}: {numbers}")


def _worst(measures: Sequence[Measure], name: str) -> str:
    values = [each for each in measures if each.name == name]
    if name == _LOST and not values:
        return "none"
    if not values or any(each.value is None for each in values):
        return "not held"
    worst = max(each.value or 0.0 for each in values)
    return f"{worst:.3g} {values[0].unit}"


NAME = "hold"
SWITCHES = 5.0
"""Mode switches a second from which a pad chatters."""

DEPTH = 1e-3
"""Mean penetration [m] below which a grasp is plausible."""

SLIP = 1e-4
"""Largest accepted slip of a held pair [m]."""

LOOSE = 0.5
"""Largest accepted fraction of a declared hold without contact force."""

_BANDS = ((5e-3, "broken"), (3e-3, "exploited"), (DEPTH, "a compromise"))
_UNITS = {"m": (1e3, " mm"), "1": (1.0, "")}
_WINDOW = 0.5
_ASKS = "what is held stays: below 5 mode switches a second, 1 mm of mean depth, 0.1 mm of slip"


@dataclass(frozen=True)
class HoldMeasurement:
    """What a run holds in a time window.

    Attributes:
        window: its start and end [s].
        pairs: the pairs that carry force in it.
        measures: the measures of what is held.
    """

    window: tuple[float, float]
    pairs: tuple[HeldPair, ...]
    measures: tuple[Measure, ...]


def check_hold(runner: CheckRunner) -> CheckResult:
    """Measure the pairs that carry force in the window of a hold; if they fail, try remedies."""
    checked, nominal = runner.checked, runner.nominal
    hold = hold_of(checked, nominal)
    if not hold.measures:
        return not_applicable(NAME, _ASKS, _nothing(hold), stores=runner.stores("run"))
    changes = try_remedies(runner, hold.measures, lambda tried: hold_of(checked, tried).measures)
    return check_result(
        NAME,
        _ASKS,
        "; ".join([_reason(hold, nominal), *verdict_on_chatter(changes)]),
        hold.measures,
        changes=changes,
        stores=runner.stores("run", "hold_remedies"),
    )


def hold_of(checked: CheckedModel, tried: CheckRun) -> HoldMeasurement:
    """Return what a run of the model holds."""
    end, declared = tried.record.duration, checked.hold_window
    window = declared or (max(0.0, end - _WINDOW), end)
    if not tried.is_complete:
        lost = tried.record.steps_asked - tried.record.steps
        return HoldMeasurement(window, (), (strict_limit("steps_lost", lost, "1", 1),))
    bearing = tuple(each for each in held_pairs(checked, tried, *window) if each.share > 0)
    kept = bearing if declared else tuple(each for each in bearing if each.holds)
    measures = [measure for each in kept for measure in _measures(each)]
    if declared:
        measures += _declared(tried)
    return HoldMeasurement(window, bearing, tuple(measures))


def _measures(held: HeldPair) -> list[Measure]:
    return [
        strict_limit("mode_switches", held.switches, "1/s", SWITCHES, held.name),
        strict_limit("penetration_mean", held.depth, "m", DEPTH, held.name),
        strict_limit("slip", held.slip, "m", SLIP, held.name),
        informative("force_mean", held.force, "N", held.name),
    ]


def _declared(tried: CheckRun) -> list[Measure]:
    """Return the measures of a hold that the scene declares."""
    contact, drop = (tried.record.metrics.get(name) for name in ("hold_contact", "hold_drop"))
    share = np.nan if contact is None else contact
    more = [] if drop is None else [informative("drop", drop, "m")]
    return [upper_limit("loose_share", 1 - share, "1", LOOSE), *more]


def _nothing(hold: HoldMeasurement) -> str:
    start, stop = hold.window
    span = f"from {start:g} to {stop:g} s"
    loose = [each.name for each in hold.pairs]
    if not loose:
        return f"no monitored pair carries force {span}: nothing is held"
    return (
        f"{span} {', '.join(loose[:3])} carry force, but intermittently or while sliding: "
        "nothing is held; a scene that holds something declares it under `hold`"
    )


def _reason(hold: HoldMeasurement, nominal: CheckRun) -> str:
    """Return the worst value of each measure as text, those beyond their limit first."""
    if not nominal.is_complete:
        return f"the run is not complete: {nominal.record.status_reason}"
    worst = {each.name: each for each in sorted(hold.measures, key=_size)}
    limited = [worst[name] for name in dict.fromkeys(each.name for each in hold.measures)]
    told = sorted(
        (each for each in limited if each.limit is not None), key=lambda each: bool(each.holds)
    )
    start, stop = hold.window
    return f"from {start:g} to {stop:g} s: {', '.join(_said(each) for each in told)}"


def _size(measure: Measure) -> float:
    return np.inf if measure.value is None else measure.value


def _said(measure: Measure) -> str:
    words = measure.name.replace("_", " ")
    if measure.value is None:
        return f"{words} cannot be measured, since nothing is held"
    scale, unit = _UNITS.get(measure.unit, (1.0, f" {measure.unit}"))
    value, limit = measure.value * scale, (measure.limit or 0) * scale
    band = next((word for least, word in _BANDS if measure.value >= least), "")
    banded = f", {band}" if band and measure.name == "penetration_mean" else ""
    return f"{words} {value:.3g}{unit} (limit {limit:g}{banded})"
