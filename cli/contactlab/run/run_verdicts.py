"""Hold a run's outcome against what its sweep expects and tolerates."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import ANGULAR_VELOCITY, PairTrace, Trace
from contactlab.scene import NOT_IN_MODEL, PreparedModel
from contactlab.schema import Expectation


@dataclass(frozen=True)
class ExpectationVerdict:
    """What an outcome amounts to.

    Attributes:
        expected: labels of which one was expected, or None.
        met: whether everything expected came out; None if nothing was expected.
        reason: what was missed, or None.
    """

    expected: tuple[str, ...] | None
    met: bool | None
    reason: str | None


def judge(
    picked: Sequence[Expectation],
    labels: Sequence[str],
    metrics: Mapping[str, float | None],
) -> ExpectationVerdict:
    """Return whether a run meets every expectation.

    Args:
        picked: the expectations whose condition picks the run.
        labels: the run's labels, worst first; a run without any is stable.
        metrics: the run's metrics.
    """
    missed = [miss for each in picked for miss in _misses(each, labels, metrics)]
    expected = [label for each in picked for label in each.label or ()]
    return ExpectationVerdict(
        expected=tuple(dict.fromkeys(expected)) or None,
        met=None if not picked else not missed,
        reason="; ".join(missed) or None,
    )


def within_tolerances(
    tolerances: Mapping[str, float], metrics: Mapping[str, float | None]
) -> bool | None:
    """Return whether every tolerated metric was measured and is small enough; None without any.

    What these metrics do not name, errors against a reference, is measured later or was before.
    """
    measured = {name: metrics[name] for name in tolerances if name in metrics}
    if not measured:
        return None
    return all(
        value is not None and abs(value) <= tolerances[name] for name, value in measured.items()
    )


def _misses(
    expectation: Expectation, labels: Sequence[str], metrics: Mapping[str, float | None]
) -> Iterator[str]:
    allowed = expectation.label
    if allowed is not None and not set(allowed) & set(labels or ["stable"]):
        yield f"expected {' or '.join(allowed)}, found {', '.join(labels) or 'stable'}"
    for name, bounds in expectation.metrics.items():
        value = metrics[name]
        if value is None:
            yield f"expected {name}, which could not be measured"
        elif bounds.min is not None and value < bounds.min:
            yield f"expected {name} of at least {bounds.min:g}, found {value:g}"
        elif bounds.max is not None and value > bounds.max:
            yield f"expected {name} of at most {bounds.max:g}, found {value:g}"


# Slower motion is the creep and the rocking of soft contact.
_SLIDE = 5e-3
_TURN = 0.1
Moving = Callable[[PairTrace, int], NDArray[np.float64]]


def missing_effects(trace: Trace, run: int, prepared: PreparedModel) -> dict[str, str]:
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
