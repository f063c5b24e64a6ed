"""What a model computes that changes no state: pairs of geoms that never touch."""

from collections.abc import Collection, Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_names import is_address
from contactlab.scene.unreachable import Clearance, GeomPair, filtered_pairs, unreachable_pairs

FEWEST_RUNS = 3
"""Runs from different seeds without which distances decide nothing."""
_BLOCKS = 128
"""How often in a run distances are measured."""
_EXERCISED = 0.25
"""Share of its range that each joint between two geoms must have gone through."""
_ROOM = 0.5
"""Distance that must be left between two geoms, in radii of the smaller one."""


@dataclass(frozen=True)
class UntouchedGeoms:
    """Collisions that need not be looked for, as `ModelEdits` has them.

    Attributes:
        masked: geoms that touch nothing.
        excluded: pairs of bodies of which no geoms touch, but for those that are masked.
        pairs: how many pairs of geoms could touch by their masks.
        proven: how many of them cannot, by proof from joint ranges.
        distant: how many more stayed apart in all runs.
    """

    masked: tuple[str, ...]
    excluded: tuple[tuple[str, str], ...]
    pairs: int
    proven: int
    distant: int


def untouched_geoms(model: mujoco.MjModel, runs: Sequence[Floats]) -> UntouchedGeoms:
    """Return which geoms and pairs of bodies never touch, by proof or else in driven runs.

    Runs are configurations (T, nq) after each step, from different seeds; with fewer than three of
    them, only proofs count.
    """
    pairs = filtered_pairs(model)
    proven = unreachable_pairs(model, pairs)
    rest = [pair for pair in pairs if pair not in proven]
    distant = distant_pairs(model, rest, runs)
    masked = _maskable(model, pairs, proven | distant)
    return UntouchedGeoms(
        masked=tuple(model.geom(geom).name for geom in masked),
        excluded=tuple(_excludable(model, pairs, proven | distant, set(masked))),
        pairs=len(pairs),
        proven=len(proven),
        distant=len(distant),
    )


def _maskable(
    model: mujoco.MjModel, pairs: Collection[GeomPair], apart: Collection[GeomPair]
) -> list[int]:
    """Return the geoms all of whose pairs are apart; none that a flex may touch."""
    flexes = np.bitwise_or.reduce([*model.flex_contype, *model.flex_conaffinity, 0])
    kinds = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    touching = {geom for pair in pairs if pair not in apart for geom in pair}
    geoms = sorted({geom for pair in apart for geom in pair} - touching)
    return [geom for geom in geoms if not kinds[geom] & flexes]


def _excludable(
    model: mujoco.MjModel,
    pairs: Collection[GeomPair],
    apart: Collection[GeomPair],
    masked: AbstractSet[int],
) -> Iterator[tuple[str, str]]:
    """Yield the pairs of bodies with names whose geoms are all apart, but for masked ones."""
    left = [pair for pair in pairs if masked.isdisjoint(pair)]
    bodies = {pair: tuple(sorted(model.geom_bodyid[[*pair]].tolist())) for pair in left}
    touching = {bodies[pair] for pair in left if pair not in apart}
    for each in sorted(set(bodies.values()) - touching):
        first, second = (model.body(body).name for body in each)
        if not is_address(first) and not is_address(second):
            yield first, second


def distant_pairs(
    model: mujoco.MjModel, pairs: Sequence[GeomPair], runs: Sequence[Floats]
) -> set[GeomPair]:
    """Return the pairs that stay apart in all runs, though these moved every joint between them.

    They stay apart by half the radius of the smaller geom, beyond how far joints bring them
    together between two measurements. Bodies that move freely against each other are never among
    them: they may meet in the next run.
    """
    if len(runs) < FEWEST_RUNS or not pairs:
        return set()
    clearance = Clearance(model)
    levers = {pair: each for pair in pairs if (each := clearance.levers(pair)) is not None}
    moved = _exercised(clearance, np.concatenate(runs))
    levers = {pair: each for pair, each in levers.items() if moved[each > 0].all()}
    for run in runs:
        for qpos, ways in _blocks(model, run):
            clearance.place(qpos)
            for pair, lengths in tuple(levers.items()):
                if _is_near(clearance, pair, float(lengths @ ways)):
                    del levers[pair]
    return set(levers)


def _exercised(clearance: Clearance, states: Floats) -> np.ndarray:
    """Return (njnt,) whether each hinge and slide went through enough of its range."""
    travel = np.ptp(states[:, clearance.model.jnt_qposadr], axis=0)
    return travel >= _EXERCISED * np.ptp(clearance.ranges, axis=1)


def _blocks(model: mujoco.MjModel, run: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield configurations of a run, each with how far joints (njnt,) go until the next one."""
    steps = np.abs(np.diff(run[:, model.jnt_qposadr], axis=0, append=run[-1:, model.jnt_qposadr]))
    starts = np.unique(np.linspace(0, len(run), _BLOCKS, endpoint=False).astype(np.intp))
    yield from zip(run[starts], np.add.reduceat(steps, starts, axis=0), strict=True)


def _is_near(clearance: Clearance, pair: GeomPair, ways: float) -> bool:
    radii = clearance.model.geom_rbound[[*pair]]
    # Planes have no radius.
    needed = ways + _ROOM * float(np.min(radii, where=radii > 0, initial=np.inf))
    centres = clearance.data.geom_xpos[[*pair]]
    margin = float(clearance.model.geom_margin[[*pair]].sum())
    apart = float(np.linalg.norm(centres[0] - centres[1]) - radii.sum()) - margin
    if radii.all() and apart > needed:
        return False
    return clearance.distance(pair, needed) < needed
