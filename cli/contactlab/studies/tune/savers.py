"""What a model computes that changes no state: pairs of geoms that never touch."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_names import is_address
from contactlab.scene.unreachable import Clearance, GeomPair, filtered_pairs, unreachable_pairs

FEWEST_RUNS = 3  # runs from different seeds without which distances decide nothing
_BLOCKS = 2048  # how often in a run distances are measured at most
_EXERCISED = 0.25  # share of its range that each joint between two geoms must have gone through
_POSTURES = 1024  # random ones, in which two geoms must stay apart as well
_ROOM = 0.5  # distance that must be left between two geoms, in radii of the smaller one


@dataclass(frozen=True)
class UntouchedGeoms:
    """Collisions that need not be looked for, as `ModelEdits` has them."""

    masked: tuple[str, ...]  # geoms that can touch nothing
    # Pairs of bodies of which no geoms can touch, but for those that are masked.
    excluded: tuple[tuple[str, str], ...]
    # Pairs of bodies of which some geoms were only watched: they stayed apart.
    watched: tuple[tuple[str, str], ...]
    pairs: int  # how many pairs of geoms could touch by their masks
    proven: int  # how many of them cannot, by proof from joint ranges
    distant: int  # how many more stayed apart wherever they were seen


def untouched_geoms(model: mujoco.MjModel, runs: Sequence[Floats]) -> UntouchedGeoms:
    """Return which geoms and pairs of bodies can never touch, and which were never seen to.

    Runs are configurations (T, nq) after each step, from different seeds; with fewer than three of
    them, only proofs count. A masked geom touches nothing that is added to the model later either,
    so that masks take proofs. Geoms that a flex may touch stay, and so do bodies without names.
    """
    pairs = filtered_pairs(model)
    proven = unreachable_pairs(model, pairs, runs)
    distant = distant_pairs(model, [pair for pair in pairs if pair not in proven], runs)
    open_ = [pair for pair in pairs if pair not in proven]
    flexes = np.bitwise_or.reduce([*model.flex_contype, *model.flex_conaffinity, 0])
    kinds = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    masked = {geom for geom in set(chain(*pairs)) - set(chain(*open_)) if not kinds[geom] & flexes}
    left = _bodies(model, [pair for pair in pairs if masked.isdisjoint(pair)])
    unproven = _bodies(model, open_)
    touching = _bodies(model, [pair for pair in open_ if pair not in distant])
    return UntouchedGeoms(
        masked=tuple(model.geom(geom).name for geom in sorted(masked)),
        excluded=_names(model, left - unproven),
        watched=_names(model, left & unproven - touching),
        pairs=len(pairs),
        proven=len(proven),
        distant=len(distant),
    )


def _names(model: mujoco.MjModel, pairs: set[tuple[int, int]]) -> tuple[tuple[str, str], ...]:
    names = [(model.body(first).name, model.body(second).name) for first, second in sorted(pairs)]
    return tuple(each for each in names if not any(map(is_address, each)))


def _bodies(model: mujoco.MjModel, pairs: Sequence[GeomPair]) -> set[tuple[int, int]]:
    places = np.sort(model.geom_bodyid[np.array(pairs, np.intp).reshape(-1, 2)], axis=1)
    return {(first, second) for first, second in places.tolist()}


def distant_pairs(
    model: mujoco.MjModel,
    pairs: Sequence[GeomPair],
    runs: Sequence[Floats],
    postures: int = _POSTURES,
) -> set[GeomPair]:
    """Return the pairs that stay apart in all runs, though these moved every joint between them.

    And in as many random postures, anywhere in the ranges of joints. They stay apart by half the
    radius of the smaller geom, beyond how far joints bring them together between two measurements.
    Bodies that move freely against each other are never among them: they may meet in the next run.
    """
    clearance = Clearance(model, runs)
    bounded = [(pair, each) for pair in pairs if (each := clearance.levers(pair)) is not None]
    if len(runs) < FEWEST_RUNS or not bounded:
        return set()
    moved = _exercised(clearance, np.concatenate(runs))
    apart, levers = (np.array(each) for each in zip(*bounded, strict=True))
    exercised = ((levers == 0) | moved).all(axis=1)
    apart, levers = apart[exercised], levers[exercised]
    radii = np.asarray(model.geom_rbound)[apart]
    # Planes have no radius.
    room = _ROOM * np.min(radii, axis=1, where=radii > 0, initial=np.inf)
    reach = np.where(radii.all(axis=1), radii.sum(axis=1) + clearance.margins(apart), np.inf)
    still = np.zeros(model.njnt)
    random = ((qpos, still) for qpos in clearance.postures(postures))
    for qpos, ways in chain(random, *(_blocks(model, run) for run in runs)):
        clearance.place(qpos)
        needed, centres = levers @ ways + room, clearance.data.geom_xpos[apart]
        distances = np.linalg.norm(centres[:, 0] - centres[:, 1], axis=1) - reach
        for place in np.flatnonzero(distances < needed):
            first, second = apart[place].tolist()
            distances[place] = clearance.distance(first, second, needed[place])
        far = distances >= needed
        apart, levers, room, reach = (each[far] for each in (apart, levers, room, reach))
    return {(first, second) for first, second in apart.tolist()}


def _exercised(clearance: Clearance, states: Floats) -> np.ndarray:
    """Return (njnt,) whether each hinge and slide went through enough of its range."""
    travel = np.ptp(states[:, clearance.model.jnt_qposadr], axis=0)
    return travel >= _EXERCISED * np.ptp(clearance.ranges, axis=1)


def _blocks(model: mujoco.MjModel, run: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield configurations of a run, each with how far joints (njnt,) go until the next one."""
    places = run[:, model.jnt_qposadr]
    steps = np.abs(np.diff(places, axis=0, append=places[-1:]))
    starts = np.unique(np.linspace(0, len(run), _BLOCKS, endpoint=False).astype(np.intp))
    yield from zip(run[starts], np.add.reduceat(steps, starts, axis=0), strict=True)
