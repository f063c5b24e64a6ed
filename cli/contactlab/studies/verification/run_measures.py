"""Compares the states of both models in one run, measure by measure."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np

from contactlab.budget.motion import Motion
from contactlab.budget.restarts import reference_motion
from contactlab.budget.windows import body_name, judged_bodies
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_names import name_of
from contactlab.schema.verification import VerifiedMeasure
from contactlab.studies.verification.runs import PairedRun, nudge_start
from contactlab.studies.verification.state_tables import (
    EXTREME_UNITS,
    LIMIT_EXCESSES,
    SAMPLES,
    StateTable,
)

RELATIVE_TOLERANCE = 0.05
"""Share that a measure may grow by: friction and masses are not known to 5 %."""
LENGTH_TOLERANCE = 1e-3
"""Share of the mean size of a body that lengths may differ by: a tenth of a millimeter for a body
of 10 cm, finer than a robot's own encoders and calibration resolve."""
ANGLE_TOLERANCE = 1e-3
"""rad: .06 degrees, the same for angles."""
CREEP_TOLERANCE = 1e-4
"""m/s, for a body of 10 cm: a millimeter in the ten seconds that a pick and place takes. From this
limit on, `grip` says that a grip creeps."""
CREEP_SIZE = 0.1
"""m, of the body that `CREEP_TOLERANCE` and `RESTING_SPEED` are stated for."""
ENERGY_TOLERANCE = 0.01
"""Share of a run's energy. A smaller gain is not reported as a failure either."""
TRACKING_TOLERANCE = 1e-3
"""Share of the reference's excursion that a tracking error may grow by."""
ENCODER_ANGLE, ENCODER_LENGTH = 1e-4, 1e-4
"""rad, and share of the mean size of a body: a turn in 65,536 counts of an encoder. A tracking
error may grow by as much, however little an actuator moves."""
SOFT_LIMIT_SHARE = 0.05
"""Share of a joint's range, up to which a joint that hits its soft limit passes it."""
RESTING_SPEED = 5e-3
"""m/s, for a body of 10 cm: below it, a body of the reference counts as resting at its end."""
PLACE_TOLERANCE = 1.0
"""Share of the original's own distance from the reference. The end position of a body sums
the errors of steps, of any sign, and contacts amplify them: with few seeds, twice the distance is
within chance. The numerical error compares the same errors before they are amplified."""
CHANCE = 1e-3
"""Probability that an equal motion exceeds the tolerance of a measure of chaotic motion. A
verification compares about a hundred measures."""
CHAOTIC_PATH = 3.0
"""Distance of two paths of a chaotic motion, in multiples of the distance of others."""
_REST_BEGIN = 0.8  # share of a run; the rest of it counts as settled
_FEWEST_SAMPLES = 3  # of a path, before the first impact
STANDARD_ERRORS = 2.0
"""A spread is the half-width of a 95 % interval of the mean over seeds."""


@dataclass(frozen=True)
class Tables:
    """The states of a run's four motions."""

    original: StateTable
    changed: StateTable
    reference: StateTable
    twin: StateTable

    @property
    def in_order(self) -> tuple[StateTable, StateTable, StateTable, StateTable]:
        """The tables of the original, the changed model, the twin and the reference."""
        return self.original, self.changed, self.twin, self.reference

    @property
    def good(self) -> np.ndarray:
        """(S,) seeds that neither both models nor the twin failed in."""
        return ~np.any([table.failures for table in self.in_order[:3]], axis=0)

    @property
    def comparable(self) -> np.ndarray:
        """(S,) those of them that the reference did not fail in either."""
        return self.good & ~self.reference.failures

    def values_of(self, read: Callable[[StateTable], Floats]) -> list[Callable[[], Floats]]:
        """Return functions that return values of the good seeds, one for each motion in order.

        The reference has those of the original in seeds that it failed in.
        """

        def read_reference() -> Floats:
            failed = self.reference.failures
            return np.where(failed, read(self.original), read(self.reference))[self.good]

        own = (lambda table=table: read(table)[self.good] for table in self.in_order[:3])
        return [*own, read_reference]


def tabulate_run(
    run: PairedRun,
    workers: int,
    known_tables: dict[tuple[str, float], tuple[StateTable, StateTable, StateTable]],
) -> Tables:
    """Return the tables of all four motions of a run, sampled at the same times.

    Each is run when a measure first needs it.

    `known_tables` are those of the original, the reference and the twin by the name of the run
    and the reference's timestep [s]; missing ones are added. They are the same for every change of
    one model.
    """
    tabulate = partial(StateTable, extremes_too=not run.unconstrained)
    key = run.name, float(run.reference.model.opt.timestep)
    if key not in known_tables:
        length = run.original.steps * float(run.original.model.opt.timestep)
        times = np.linspace(0.0, length, SAMPLES + 1)
        known_tables[key] = (
            tabulate(run.original, workers, times),
            tabulate(run.reference, workers, times),
            tabulate(run.twin, workers, times),
        )
    original, reference, twin = known_tables[key]
    changed = tabulate(run.changed, workers, original.times, demands=run.original.model)
    return Tables(original, changed, reference, twin)


def compare_run(
    run: PairedRun,
    tables: Tables,
    allowed: float,
    *,
    keeps_motion: bool = True,
    keeps_start: bool = True,
    chaotic_bodies: np.ndarray | None = None,
    find_unresolved: Callable[[], np.ndarray] | None = None,
) -> Iterator[VerifiedMeasure]:
    """Yield the measures of a run.

    If the twin ends elsewhere, the motion is chaotic. Then a measure is worse only if it is larger
    than an equal motion's would be, except by chance.

    Args:
        run: the experiment.
        tables: its states.
        allowed: error that the change may cost, as a share of each motion; 0 by default.
        keeps_motion: False if the change is meant to move bodies otherwise; then ends of bodies,
            energies, and lengths of actuators in a loop are not compared. Errors of other actuators
            are compared up to the first contact or stop that the start does not have: from there
            on, a fall decides.
        keeps_start: False if the change only begins elsewhere. Then joint limits, rest, energy and
            tracking are not compared: the model is the same, and comes to rest in another place.
        chaotic_bodies: (B,) judged bodies that end elsewhere if the task repeats, so that their
            ends are not compared in shorter runs either; all are compared by default.
        find_unresolved: returns (B,) judged bodies to leave out, too: the reference does not
            resolve their ends. It is called only if an end is worse.
    """
    model = run.original.model
    scale = float(model.stat.meansize)
    before, after = (float(table.failures.sum()) for table in (tables.original, tables.changed))
    yield _build_measure(
        "runs that the engine gave up", run.name, "1", before, after,
        spread=0.0, tolerance=0.0, place="",
    )  # fmt: skip
    if tables.original.failures.all() or tables.changed.failures.all():
        return
    if not tables.good.any():
        return
    chaotic = is_chaotic(run, tables)
    yield from _compare_extremes(
        run, tables, chaotic=chaotic, keeps_start=keeps_start, keeps_motion=keeps_motion
    )
    # Besides the extremes, a run has measures of its motion, its rest, its energy or its tracking.
    has_more = keeps_motion or run.at_rest or run.passive or run.actuators
    if not keeps_start or not has_more:
        return
    good = tables.comparable
    if not good.any():
        return
    if run.at_rest:
        values = tables.values_of(lambda table: table.resting_depth)
        if any(each().any() for each in values[:2]):
            floor = LENGTH_TOLERANCE * scale
            place = tables.changed.extremes["depth"].place
            yield average_measure(
                "resting depth", run.name, "m", values, floor, place, chaotic=chaotic
            )
        yield from _compare_creep(run, tables, good, chaotic=chaotic)
    if run.passive:
        yield from _compare_energy(run, tables, good, chaotic=chaotic, keeps_motion=keeps_motion)
    if run.in_loop and keeps_motion:
        yield from _compare_loop_tracking(run, tables, good, allowed)
    if run.actuators:
        yield from _compare_tracking(run, tables, good, allowed, keeps_motion=keeps_motion)
    elif keeps_motion:
        left_out = np.False_ if chaotic_bodies is None else chaotic_bodies
        place_measures = [*_compare_places(run, tables, allowed, left_out, chaotic=chaotic)]
        if find_unresolved and any(measure.worse for measure in place_measures):
            left_out = left_out | find_unresolved()
            place_measures = [*_compare_places(run, tables, allowed, left_out, chaotic=chaotic)]
        yield from place_measures


def find_unresolved_bodies(run: PairedRun, tables: Tables, workers: int) -> np.ndarray:
    """Return (B,) which judged bodies end elsewhere if the step of the reference is halved.

    The ends of a body that meets an edge or tips over depend on the step, however fine it is: then
    the distance from the reference measures chance. The error of a regular motion at the
    reference's step is at most a third of the original's.
    """
    model = run.original.model
    finer = round(2 * run.reference.steps / run.original.steps)
    ends = tables.original.times[-1:]
    table = StateTable(reference_motion(run.original, finer), workers, ends, extremes_too=False)
    bodies, good = judged_bodies(model), tables.comparable & ~table.failures
    own, fine, finest = (
        each.positions[good][:, -1, bodies] for each in (tables.original, tables.reference, table)
    )
    finer_distance, before = (np.linalg.norm(each - fine, axis=-1) for each in (finest, own))
    most = np.maximum(before, LENGTH_TOLERANCE * float(model.stat.meansize)) / 2
    return np.asarray((finer_distance > most).any(axis=0))


def find_chaotic_bodies(motion: Motion, workers: int) -> np.ndarray:
    """Return (B,) which judged bodies end elsewhere after a nudge of the start, in any seed."""
    model = motion.model
    ends = np.array([motion.steps * float(model.opt.timestep)])
    own, twin = (
        StateTable(each, workers, ends, extremes_too=False)
        for each in (motion, nudge_start(motion))
    )
    good, bodies = ~(own.failures | twin.failures), judged_bodies(model)
    apart = np.linalg.norm((twin.positions - own.positions)[good][:, -1, bodies], axis=-1)
    return apart.max(axis=0, initial=0.0) > LENGTH_TOLERANCE * float(model.stat.meansize)


def is_chaotic(run: PairedRun, tables: Tables) -> bool:
    """Return whether the twin ends elsewhere than the original."""
    # The end of a body says whether it repeats: whoever was hit differs there.
    bodies = judged_bodies(run.original.model)
    both = tables.original, tables.twin
    own, twin = (table.positions[tables.good][:, -1, bodies] for table in both)
    apart = np.linalg.norm(twin - own, axis=-1).max(initial=0.0)
    return bool(apart > LENGTH_TOLERANCE * float(run.original.model.stat.meansize))


def _compare_extremes(
    run: PairedRun,
    tables: Tables,
    *,
    chaotic: bool,
    keeps_start: bool,
    keeps_motion: bool,
) -> Iterator[VerifiedMeasure]:
    model = run.original.model
    scale = float(model.stat.meansize)
    for name, unit in EXTREME_UNITS.items():
        values = tables.values_of(lambda table, name=name: table.extremes[name].values)
        if (name in LIMIT_EXCESSES and not keeps_start) or not any(
            each().any() for each in values[:2]
        ):
            continue
        floor = LENGTH_TOLERANCE * scale if unit == "m" else ANGLE_TOLERANCE
        place = tables.changed.extremes[name].place
        if name in LIMIT_EXCESSES and not keeps_motion:
            # A body that is meant to move otherwise may meet a limit as hard as any soft limit is.
            names = [name_of(model, "joint", each) for each in range(model.njnt)]
            if place in names:
                way = float(np.ptp(model.jnt_range[names.index(place)]))
                floor = max(floor, SOFT_LIMIT_SHARE * way)
        yield average_measure(name, run.name, unit, values, floor, place, chaotic=chaotic)


def _build_measure(
    name: str,
    run: str,
    unit: str,
    before: float,
    after: float,
    *,
    spread: float,
    tolerance: float,
    place: str,
) -> VerifiedMeasure:
    return VerifiedMeasure(
        name=name,
        run=run,
        unit=unit,
        before=before,
        after=after,
        spread=spread if math.isfinite(spread) else 0.0,
        tolerance=tolerance if math.isfinite(tolerance) else 0.0,
        place=place,
        worse=math.isfinite(before) and not after <= before + tolerance,
    )


def average_measure(
    name: str,
    run: str,
    unit: str,
    values: Sequence[Callable[[], Floats]],
    floor: float,
    place: str,
    *,
    chaotic: bool,
) -> VerifiedMeasure:
    """Return a measure of the means over S seeds, with their spread as part of its tolerance.

    `values` return (S,) those of the original, the changed model, the twin and the reference. The
    twin and the reference only allow more: they are asked where the measure changes by more than
    the tolerance without them, and the reference of regular motion where it grows.
    """
    own, other = values[0](), values[1]()
    before, after, spread = float(np.mean(own)), float(np.mean(other)), 0.0
    if len(own) > 1:
        spread = STANDARD_ERRORS * float(np.std(own, ddof=1)) / math.sqrt(len(own))
    tolerance = max(spread, RELATIVE_TOLERANCE * before, floor)
    if abs(after - before) > tolerance:
        twin = values[2]()
        spread += abs(float(np.mean(twin)) - before)
        if chaotic:
            samples = [own, other, twin, values[3]()]
            spread = max(spread, float(largest_by_chance(samples)) - before)
        tolerance = max(tolerance, spread)
    if after > before + tolerance:
        # A more accurate run may reach as far as the reference does.
        tolerance += max(0.0, float(np.mean(values[3]())) - before)
    return _build_measure(
        name, run, unit, before, after, spread=spread, tolerance=tolerance, place=place
    )


def largest_by_chance(values: Sequence[Floats]) -> Floats:
    """Return the largest mean that the changed motion has if it only moves by chance otherwise.

    The original, its twin and its reference are three samples of each seed's chaotic motion. The
    result is the upper bound of Student's prediction interval of another one's mean over seeds.
    The first axis of each array of `values` is the seed.
    """
    from scipy.special import stdtrit  # noqa: PLC0415 - it takes a while to load

    samples = np.stack([values[0], values[2], values[3]])
    count, seeds = samples.shape[:2]
    deviation = np.sqrt(np.var(samples, axis=0, ddof=1).mean(axis=0) / seeds)
    factor = float(stdtrit((count - 1) * seeds, 1 - CHANCE)) * math.sqrt(1 + 1 / count)
    return np.asarray(samples.mean(axis=(0, 1)) + factor * deviation)


def _compare_creep(
    run: PairedRun, tables: Tables, good: np.ndarray, *, chaotic: bool
) -> Iterator[VerifiedMeasure]:
    # Only bodies that rest at the end of the reference can creep.
    bodies = judged_bodies(run.original.model)
    limit = float(run.original.model.stat.meansize) / CREEP_SIZE
    speeds = [
        measure_end_speeds(table)[good][:, bodies]
        for table in (tables.original, tables.changed, tables.twin, tables.reference)
    ]
    resting = (speeds[3] < RESTING_SPEED * limit).all(axis=0)
    resting &= (np.abs(speeds[2] - speeds[0]) < CREEP_TOLERANCE * limit).all(axis=0)
    if not resting.any():
        return
    before, after, twin, fine = (each[:, resting].mean(axis=0) for each in speeds)
    tolerances = np.maximum(CREEP_TOLERANCE * limit, RELATIVE_TOLERANCE * before)
    # A more accurate run may creep as fast as the reference does.
    tolerances += np.maximum(0.0, fine - before)
    if chaotic:
        largest = largest_by_chance([each[:, resting] for each in speeds])
        tolerances = np.maximum(tolerances, largest - before)
    worst = int(np.argmax(after - before - tolerances))
    yield _build_measure(
        "creep",
        run.name,
        "m/s",
        float(before[worst]),
        float(after[worst]),
        spread=abs(float(twin[worst] - before[worst])),
        tolerance=float(tolerances[worst]),
        place=body_name(run.original.model, int(bodies[resting][worst])),
    )


def measure_end_speeds(table: StateTable) -> Floats:
    """Return (S, nbody) mean speeds of bodies over the last fifth [m/s]."""
    first = int(_REST_BEGIN * (len(table.times) - 1))
    way = table.positions[:, -1] - table.positions[:, first]
    return np.linalg.norm(way, axis=-1) / (table.times[-1] - table.times[first])


def _compare_energy(
    run: PairedRun, tables: Tables, good: np.ndarray, *, chaotic: bool, keeps_motion: bool
) -> Iterator[VerifiedMeasure]:
    whole = [
        table.energies[good]
        for table in (tables.original, tables.changed, tables.twin, tables.reference)
    ]
    gravity = float(np.linalg.norm(run.original.model.opt.gravity))
    model = run.original.model
    moving = float(model.body_mass[model.body_weldid > 0].sum())
    weight = moving * gravity * float(model.stat.meansize)
    # The energy that the reference exchanges between potential and kinetic, at least the weight
    # lifted by the size of a body: a share of a vanishing energy would mean nothing.
    scale = np.maximum(np.ptp(whole[3], axis=1), weight) + 1e-300
    gains = [(each.max(axis=1) - each[:, 0]) / scale for each in whole]
    yield average_measure(
        "energy gain", run.name, "1", _as_known(gains), ENERGY_TOLERANCE, "", chaotic=chaotic
    )
    if keeps_motion:
        ends = [np.abs(each[:, -1] - whole[3][:, -1]) / scale for each in whole]
        yield average_measure(
            "energy error", run.name, "1", _as_known(ends), ENERGY_TOLERANCE, "", chaotic=chaotic
        )


def _as_known(values: Sequence[Floats]) -> list[Callable[[], Floats]]:
    return [lambda each=each: each for each in values]


def _compare_tracking(
    run: PairedRun, tables: Tables, good: np.ndarray, allowed: float, *, keeps_motion: bool
) -> Iterator[VerifiedMeasure]:
    model = run.original.model
    names = [model.actuator(each).name or f"actuator[{each}]" for each in range(model.nu)]
    for row in np.flatnonzero(good):
        actuator = names.index(run.actuators[row])
        hits = [table.impacts[row] for table in (tables.original, tables.changed)]
        compared = ~np.logical_or(*hits) | keeps_motion
        if compared.sum() < _FEWEST_SAMPLES:
            continue
        ways = [
            table.lengths[row, compared, actuator]
            for table in (tables.original, tables.changed, tables.twin, tables.reference)
        ]
        before, after = (_root_mean_square(way - ways[3]) for way in ways[:2])
        spread = _root_mean_square(ways[2] - ways[0])
        excursion = float(np.ptp(ways[3]))
        yield _build_tracking(run, actuator, before, after, spread, excursion, allowed)


def _build_tracking(
    run: PairedRun,
    actuator: int,
    before: float,
    after: float,
    spread: float,
    excursion: float,
    allowed: float,
) -> VerifiedMeasure:
    # The excursion is that of the actuator in the reference.
    model = run.original.model
    on_joint = model.actuator_trntype[actuator] == int(mujoco.mjtTrn.mjTRN_JOINT)
    joint = int(model.actuator_trnid[actuator, 0])
    turns = on_joint and model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE)
    unit = "rad" if turns else "m"
    floor = ENCODER_ANGLE if unit == "rad" else ENCODER_LENGTH * float(model.stat.meansize)
    share = max(TRACKING_TOLERANCE, allowed)
    return _build_measure(
        "tracking error",
        run.name,
        unit,
        before,
        after,
        spread=spread,
        tolerance=max(CHAOTIC_PATH * spread, RELATIVE_TOLERANCE * before, share * excursion, floor),
        place=model.actuator(actuator).name or f"actuator[{actuator}]",
    )


def _compare_loop_tracking(
    run: PairedRun, tables: Tables, good: np.ndarray, allowed: float
) -> Iterator[VerifiedMeasure]:
    # (S, K, nu) lengths of actuators that a policy moves, against those of its loop at a fine step.
    model = run.original.model
    ways = [table.lengths[good] for table in tables.in_order]
    for actuator in range(model.nu):
        own, other, twin, fine = (way[..., actuator] for way in ways)
        before, after, spread = (
            _root_mean_square(first - second)
            for first, second in ((own, fine), (other, fine), (twin, own))
        )
        excursion = float(np.ptp(fine, axis=1).mean())
        yield _build_tracking(run, actuator, before, after, spread, excursion, allowed)


def _root_mean_square(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _compare_places(
    run: PairedRun,
    tables: Tables,
    allowed: float,
    left_out: np.ndarray | np.bool,
    *,
    chaotic: bool,
) -> Iterator[VerifiedMeasure]:
    # A body is chaotic if its twin ends elsewhere: its end says nothing, and is left out.
    good = tables.comparable
    bodies, scale = judged_bodies(run.original.model), float(run.original.model.stat.meansize)
    floor = LENGTH_TOLERANCE * scale
    places = [
        table.positions[good][:, :, bodies]
        for table in (tables.original, tables.changed, tables.twin, tables.reference)
    ]
    ends = [np.linalg.norm(each[:, -1] - places[3][:, -1], axis=-1) for each in places[:3]]
    twins = np.linalg.norm(places[2][:, -1] - places[0][:, -1], axis=-1)
    ways = [np.linalg.norm(each - each[:, :1], axis=-1).max(axis=1) for each in places]
    repeatable = (twins < floor) & ~left_out
    if not repeatable.any():
        return
    repeat_counts = repeatable.sum(axis=0)
    means = [
        np.where(repeatable, each, 0.0).sum(axis=0) / np.maximum(repeat_counts, 1)
        for each in ends[:2]
    ]
    before, after = means
    noise = np.where(repeatable, twins, 0.0).max(axis=0)
    factor = CHAOTIC_PATH if chaotic else PLACE_TOLERANCE
    tolerances = np.maximum(floor, factor * before) + noise
    tolerances += allowed * ways[3].mean(axis=0)
    worst = int(np.argmax(np.where(repeat_counts > 0, after - before - tolerances, -np.inf)))
    yield _build_measure(
        "end position",
        run.name,
        "m",
        float(before[worst]),
        float(after[worst]),
        spread=float(noise[worst]),
        tolerance=float(tolerances[worst]),
        place=body_name(run.original.model, int(bodies[worst])),
    )
    counts = [
        np.count_nonzero(repeatable & _find_other_moves(way, ways[3], scale)) for way in ways[:2]
    ]
    yield _build_measure(
        "bodies that move otherwise", run.name, "1", float(counts[0]), float(counts[1]),
        spread=0.0, tolerance=0.0, place="",
    )  # fmt: skip


_MOVES = 0.1  # of the mean size of a body
_RATIO = 3.0  # of ways; above it, one body moves and the other does not


def _find_other_moves(ways: Floats, reference: Floats, scale: float) -> np.ndarray:
    # True if a body moves and the reference does not, or the other way around.
    larger, smaller = np.maximum(ways, reference), np.minimum(ways, reference)
    return (larger > _MOVES * scale) & (larger > _RATIO * smaller)
