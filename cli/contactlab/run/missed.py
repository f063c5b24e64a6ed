"""Effects that were left out of a run which, as it turned out, called for them."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import ANGULAR_VELOCITY, PairTrace, Trace
from contactlab.scene import NOT_IN_MODEL, PreparedModel

# Slower motion is the creep and the rocking of soft contact.
_SLIDE = 5e-3
_TURN = 0.1
Moving = Callable[[PairTrace, int], NDArray[np.float64]]


def missed_effects(trace: Trace, run: int, prepared: PreparedModel) -> dict[str, str]:
    """Return the effects that are off although the bodies called for them, with what was seen.

    Only effects that the model has and that were left out are looked for: friction against what
    bodies in contact do, and limits that joints pass.

    Args:
        trace: the arrays of a group of runs.
        run: the run's place in it.
        prepared: the run's model, with its effects.
    """
    off = {name for name, each in prepared.effects.items() if not each.on}
    left_out = {name for name in off if prepared.effects[name].reason != NOT_IN_MODEL}
    seen = {name: _motion(trace, run, name) for name in _MOTIONS if name in left_out}
    if "limit" in left_out:
        seen["limit"] = _limit(trace, run, prepared)
    return {name: text for name, text in seen.items() if text is not None}


def _motion(trace: Trace, run: int, name: str) -> str | None:
    """Return the first motion in a contact that a friction effect would act against."""
    word, unit, least, measure = _MOTIONS[name]
    first: tuple[int, str, float] | None = None
    for pair in trace.pairs:
        bearing = pair.touching[run] & (pair.force[run, ..., 0] > 0)
        speed = np.where(bearing, measure(pair, run), 0.0).max(axis=-1, initial=0.0)
        steps = np.flatnonzero(speed > least)
        if len(steps) and (first is None or steps[0] < first[0]):
            first = int(steps[0]), pair.name, float(speed.max())
    if first is None:
        return None
    return f"{first[1]} {word} from step {first[0]}, at up to {first[2]:.3g} {unit}"


def _sliding(pair: PairTrace, run: int) -> NDArray[np.float64]:
    return np.linalg.norm(pair.velocity[run, ..., 1:], axis=-1)


def _spinning(pair: PairTrace, run: int) -> NDArray[np.float64]:
    return np.abs(pair.slots[run, ..., ANGULAR_VELOCITY][..., 0])


def _rolling(pair: PairTrace, run: int) -> NDArray[np.float64]:
    return np.linalg.norm(pair.slots[run, ..., ANGULAR_VELOCITY][..., 1:], axis=-1)


_MOTIONS: Mapping[str, tuple[str, str, float, Moving]] = {
    "tangential_friction": ("slides", "m/s", _SLIDE, _sliding),
    "torsional_friction": ("spins", "rad/s", _TURN, _spinning),
    "rolling_friction": ("rolls", "rad/s", _TURN, _rolling),
}


def _limit(trace: Trace, run: int, prepared: PreparedModel) -> str | None:
    """Return the first joint that passes its limit."""
    model = prepared.model
    first: tuple[int, str] | None = None
    for joint in np.flatnonzero(np.asarray(model.jnt_limited)).tolist():
        low, high = model.jnt_range[joint]
        # Of joints with one coordinate: a ball joint's limit is on its angle.
        if model.jnt_type[joint] >= _SLIDE_JOINT:
            place = trace.qpos[run, :, int(model.jnt_qposadr[joint])]
            steps = np.flatnonzero((place < low) | (place > high))
            if len(steps) and (first is None or steps[0] < first[0]):
                first = int(steps[0]), model.joint(joint).name or f"joint {joint}"
    return None if first is None else f"{first[1]} passes its limit from step {first[0]}"


# As the engine numbers kinds of joints: free, ball, slide, hinge.
_SLIDE_JOINT = 2
