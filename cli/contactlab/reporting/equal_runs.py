"""Values of an axis that give the same run, so that no result can depend on them."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.contact_laws import refsafe_solref
from contactlab.reporting.report_columns import SEED, Codes, GridAxis, number_with_unit
from contactlab.store.run_columns import RunColumns


@dataclass(frozen=True)
class _EqualRuns:
    """The g groups of runs that differ in one axis alone, and are equal.

    Attributes:
        first: (g) the first run of each group.
        last: (g) a run of each with another value of the axis.
        values: (g) the values of the axis in each group as a bit mask.
        cases: number of combinations of the other axes.
    """

    first: NDArray[np.integer]
    last: NDArray[np.integer]
    values: NDArray[np.int64]
    cases: int


def describe_equal_runs(axes: Sequence[GridAxis], columns: RunColumns) -> Iterator[str]:
    """Yield a sentence for each axis that has values with the same run, bit for bit.

    Runs are equal if time, positions, velocities and activations of all their steps are; runs
    without a trajectory equal no other. Stores with an axis in bins are skipped: hardly two of
    their runs differ in one axis alone. So are large ones, which sorting would slow down.
    """
    most_bits = 63  # of a mask in 64 bits with a sign
    most_runs = 200_000  # a summary of as many takes a second, and sorting their hashes another
    if columns.runs > most_runs:
        return
    if any(axis.numbers is not None or len(axis.ticks) > most_bits for axis in axes):
        return
    hashes, trajectories = np.unique(columns.byte_strings("trajectory_hash"), return_inverse=True)
    is_unknown = hashes[trajectories] == b""
    trajectories = np.where(is_unknown, len(hashes) + np.arange(columns.runs), trajectories)
    if not (np.bincount(trajectories) > 1).any():
        return
    for axis in axes:
        if axis.name == SEED:
            continue
        equal = _find_equal_runs(axis, axes, trajectories)
        if len(equal.first):
            yield _describe_axis(axis, equal, columns)


def _find_equal_runs(axis: GridAxis, axes: Sequence[GridAxis], trajectories: Codes) -> _EqualRuns:
    cases = np.zeros(len(trajectories), np.int64)
    for other in axes:
        if other is not axis:
            # Renumbered after each axis, so that no product of many axes overflows.
            _, cases = np.unique(cases * len(other.ticks) + other.codes, return_inverse=True)
    order = np.lexsort((axis.codes, trajectories, cases))
    new = (np.diff(cases[order]) != 0) | (np.diff(trajectories[order]) != 0)
    starts = np.concatenate([[0], np.flatnonzero(new) + 1])
    ends = np.concatenate([starts[1:], [len(order)]]) - 1
    values = np.bitwise_or.reduceat(np.int64(1) << axis.codes[order].astype(np.int64), starts)
    several = axis.codes[order[starts]] != axis.codes[order[ends]]
    first, last = order[starts[several]], order[ends[several]]
    return _EqualRuns(first, last, values[several], int(cases.max()) + 1)


def _describe_axis(axis: GridAxis, equal: _EqualRuns, columns: RunColumns) -> str:
    every, count = (1 << len(axis.ticks)) - 1, len(equal.first)
    if count == equal.cases and (equal.values == every).all():
        return f"{axis.name} changes no run: all its values give the same motion, bit for bit"
    most_examples = 3
    masks = np.unique(equal.values).tolist()
    examples = [
        " = ".join(
            number_with_unit(tick, axis.amount_unit)
            for code, tick in enumerate(axis.ticks)
            if mask >> code & 1
        )
        for mask in masks[:most_examples]
    ]
    examples += ["..."] if len(masks) > most_examples else []
    why = ": refsafe raises time constants to 2 timesteps"
    return (
        f"in {count:,} of {equal.cases:,} cases, values of {axis.name} give the same run, bit for "
        f"bit ({'; '.join(examples)}){why if _refsafe_makes_equal(axis, equal, columns) else ''}"
    )


def _refsafe_makes_equal(axis: GridAxis, equal: _EqualRuns, columns: RunColumns) -> bool:
    if not axis.name.startswith("solref"):
        return False
    # Rows are decoded one by one, and a rule that explains 50 groups explains the others.
    most_groups = 50
    stride = -(-len(equal.first) // most_groups)
    for rows in zip(equal.first[::stride].tolist(), equal.last[::stride].tolist(), strict=True):
        written, acting = list[object](), list[object]()
        for run in columns.select_values(["pairs", "timestep", "effects"], rows):
            if not run["effects"].get("refsafe"):
                return False
            solrefs = [tuple(pair["solref"]) for pair in json.loads(run["pairs"]).values()]
            written.append(solrefs)
            acting.append([refsafe_solref(solref, run["timestep"]) for solref in solrefs])
        if acting[0] != acting[1] or written[0] == written[1]:
            return False
    return True
