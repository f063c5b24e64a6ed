"""Contact forces of a stored run, thinned to frames so that the peaks are kept."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import FORCE, NORMAL, POSITION, TANGENT, ContactForces, Floats
from contactlab.store.mcap import StoredPair

Rows = NDArray[np.intp]


def frame_rows(time: Floats, rate: float, moments: Sequence[float] = ()) -> Rows:
    """Return the state rows nearest to frames at a rate and to moments, and the last row.

    Args:
        time: (N + 1,) time of the states, growing [s].
        rate: frames per simulated second.
        moments: further times [s].
    """
    wanted = np.append(frame_times(time, rate), moments)
    return np.unique(np.append(nearest(time, wanted), len(time) - 1))


def frame_times(time: Floats, rate: float) -> Floats:
    """Return the times of frames at a rate, from the first state to the last at most [s]."""
    # Rounding must not cost the frame of the last state.
    count = int((time[-1] - time[0]) * rate * (1 + 1e-9)) + 1
    return time[0] + np.arange(count) / rate


def nearest(time: Floats, wanted: Floats) -> Rows:
    """Return the index of the time nearest to each wanted one, the earlier of two."""
    return np.searchsorted((time[1:] + time[:-1]) / 2, wanted)


def peak_forces(pairs: Sequence[StoredPair], rows: Rows) -> ContactForces:
    """Return, for each frame and pair, the contact forces of the step with the largest net force.

    A frame stands for the steps from its state to the next frame's, so that an impact of one step
    is seen at any rate; the last frame for the step that leads to it.

    Args:
        pairs: what each pair did.
        rows: (F,) state row of each frame, ascending.
    """
    parts = [_of_pair(pair, index, rows) for index, pair in enumerate(pairs)]
    nothing = ContactForces(
        frame=np.empty(0, np.intp),
        pair=np.empty(0, np.intp),
        mode=np.empty(0, np.int8),
        position=np.empty((0, 3)),
        force=np.empty((0, 3)),
    )
    columns = {
        name: np.concatenate([getattr(each, name) for each in (nothing, *parts)])
        for name in vars(nothing)
    }
    order = np.argsort(columns["frame"], kind="stable")
    return ContactForces(**{name: column[order] for name, column in columns.items()})


def _of_pair(pair: StoredPair, index: int, rows: Rows) -> ContactForces:
    entries, frames = _strongest(pair, rows)
    counts = pair.contacts[entries]
    ends = np.cumsum(pair.contacts)[entries]
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    points = pair.points[np.repeat(ends - counts, counts) + within]
    force = world_force(points)
    sound = np.isfinite(force).all(axis=1) & np.isfinite(points[:, POSITION]).all(axis=1)
    return ContactForces(
        frame=np.repeat(frames, counts)[sound],
        pair=np.full(int(sound.sum()), index),
        mode=np.repeat(pair.mode[entries], counts)[sound],
        position=points[sound, POSITION],
        force=force[sound],
    )


def _strongest(pair: StoredPair, rows: Rows) -> tuple[Rows, Rows]:
    """Return the entry of the step with the largest net force in each frame, and the frames."""
    final = np.flatnonzero(pair.steps == rows[-1] - 1)
    entries = np.append(np.arange(len(pair.steps)), final)
    frames = np.searchsorted(rows, pair.steps, side="right") - 1
    frames = np.append(frames, np.full(len(final), len(rows) - 1))
    strength = np.nan_to_num(np.hypot(pair.normal, pair.tangential))[entries]
    order = np.lexsort((strength, frames))
    last = np.flatnonzero(np.diff(frames[order], append=len(rows)))
    chosen = order[last]
    return entries[chosen], frames[chosen]


def world_force(points: Floats) -> Floats:
    """Return (K, 3) forces on the second side [N], world frame, of (K, 23) contact slots."""
    normal, tangent = points[:, NORMAL], points[:, TANGENT]
    axes = np.stack([normal, tangent, np.cross(normal, tangent)], axis=1)
    return np.einsum("ki,kij->kj", points[:, FORCE], axes)
