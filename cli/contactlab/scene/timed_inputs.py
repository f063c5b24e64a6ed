"""Inputs of a scene interpolated between knots, and the time window of a hold."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.expression import Expression, ExpressionError
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.model_names import match_coordinates, name_of, part_starts
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.strict_model import Term


def read_formula(term: Term, where: str, initial: Collection[str]) -> Expression:
    """Parse a number or an expression over initial values. A SceneError locates a mistake."""
    try:
        expression = Expression(str(term))
    except ExpressionError as error:
        raise SceneError(f"{where} to '{term}': {error}") from error
    unknown = ", ".join(sorted(set(expression.names) - set(initial)))
    if unknown:
        accepted_names = (
            f"one of {', '.join(initial)}" if initial else "a number; there are no names here"
        )
        raise SceneError(f"{where} from unknown {unknown}; write {accepted_names}")
    return expression


def evaluate_formula(formula: Expression, initial: Mapping[str, float]) -> float:
    """Return an expression's number for a run's initial values.

    Raises a SceneError if it has none.
    """
    try:
        result = formula.evaluate(initial)
    except ExpressionError as error:
        raise SceneError(f"cannot compute '{formula.text}' for {dict(initial)}: {error}") from error
    if not isinstance(result, float):
        raise SceneError(f"'{formula.text}' is {result!r}, not a number")
    return result


_INPUT_FORMS = "ACTUATOR.ctrl, BODY.fx to .tz, or MOCAP_BODY.x to .qz"


@dataclass(frozen=True)
class ControlProfile:
    """Levels at knots over time of the inputs that match a pattern, which is its name.

    Inputs are indices among those of `InitialStates`.
    """

    name: str
    inputs: tuple[int, ...]
    times: tuple[Expression, ...]
    levels: tuple[Expression, ...]


@dataclass(frozen=True)
class Signals:
    """Levels of P inputs of a run over time: each interpolates linearly between its K knots.

    Before its first knot an input has the first level, after its last knot the last. If two knots
    have the same time, the later one counts.
    """

    places: NDArray[np.intp]  # (P,) indices among the inputs
    times: Floats  # (P, K) times of the knots [s], non-decreasing; (1, K) if all inputs share them
    levels: Floats  # (P, K) values there

    @classmethod
    def no_signals(cls) -> "Signals":
        """Return the signals of a run with constant inputs."""
        return cls(np.empty(0, np.intp), np.empty((0, 0)), np.empty((0, 0)))

    def values_at(self, times: Floats) -> Floats:
        """Return (T, P) the inputs at some times [s]."""
        if len(self.times) == 1:
            before, after, width, along = _bracketing_knots(times.tobytes(), self.times.tobytes())
            first = self.levels.take(before, axis=1)
            return ((self.levels.take(after, axis=1) - first) / width * along + first).T
        lines = zip(self.times, self.levels, strict=True)
        return np.array([np.interp(times, *line) for line in lines]).reshape(-1, len(times)).T

    def at_steps(self, timestep: float) -> "Signals":
        """Return the signals with knots moved onto steps where they differ only by rounding.

        Then every timestep [s] has the same levels, even if a clock accumulates rounding errors.
        """
        steps = np.round(self.times / timestep)
        near = np.abs(self.times / timestep - steps) < COARSE_ROUNDING
        times = np.where(near, steps * timestep, self.times)
        return Signals(self.places, times, self.levels)

    def exclude_inputs(self, excluded: NDArray[np.bool_]) -> "Signals":
        """Return the signals except those that `excluded` (P,) marks."""
        times = self.times if len(self.times) < len(excluded) else self.times[~excluded]
        return Signals(self.places[~excluded], times, self.levels[~excluded])

    def merge_signals(self, other: "Signals") -> "Signals":
        """Return these signals, and others of the same run for inputs that these do not drive."""
        rest = (
            other.exclude_inputs(np.isin(other.places, self.places)) if self.places.size else other
        )
        if not (self.places.size and rest.places.size):
            return self if self.places.size else rest
        most = max(self.levels.shape[1], rest.levels.shape[1])
        both = self._pad_knots(most), rest._pad_knots(most)
        arrays = [(side.places, side.times, side.levels) for side in both]
        return Signals(*(np.concatenate(parts) for parts in zip(*arrays, strict=True)))

    def _pad_knots(self, most: int) -> "Signals":
        """Return the same signals with more knots, all equal to the last one."""
        rest = ((0, 0), (0, most - self.levels.shape[1]))
        times = np.broadcast_to(self.times, self.levels.shape)
        return Signals(self.places, *(np.pad(part, rest, "edge") for part in (times, self.levels)))


@lru_cache(maxsize=8)
def _bracketing_knots(
    times: bytes, knots: bytes
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]:
    """Return (T,) the knots before and after times, the time between them, and since the first [s].

    Times and knots are float64. Runs of a job often share both, so the search result is cached.
    Before the first knot and after the last one, both knots are that one.
    """
    instants, places = np.frombuffer(times), np.frombuffer(knots)
    after = np.searchsorted(places, instants, side="right")
    before, after = np.maximum(after - 1, 0), np.minimum(after, len(places) - 1)
    width = places[after] - places[before]
    return before, after, np.where(after > before, width, 1.0), instants - places[before]


def read_control(
    model: mujoco.MjModel, manifest: SceneManifest | None
) -> tuple[ControlProfile, ...]:
    """Return the profiles of a manifest's `control`. A SceneError names a wrong one."""
    if manifest is None:
        return ()
    profiles: list[ControlProfile] = []
    # Inputs that initial values set; indices of states are negative.
    first = part_starts(model)["ctrl"]
    values = manifest.initial
    occupied = {
        place - first: f"initial value '{name}'"
        for name, entry in values.items()
        for pattern in entry.sets
        for place in match_coordinates(model, pattern)
    }
    for name, entry in manifest.control.items():
        places, first = match_coordinates(model, name, mocap=True), part_starts(model)["ctrl"]
        if min(places) < first:
            raise SceneError(
                f"control '{name}' is part of the state, not an input; write {_INPUT_FORMS}"
            )
        inputs = tuple(place - first for place in places)
        if clash := next((occupied[taking] for taking in inputs if taking in occupied), None):
            raise SceneError(f"control {name}: {clash} sets the same input; keep one of them")
        occupied |= dict.fromkeys(inputs, f"control {name}")
        times, levels = (
            tuple(read_formula(term, f"control {name} sets its {part}", values) for term in terms)
            for part, terms in (("times", entry.at), ("values", entry.to))
        )
        profiles.append(ControlProfile(name, inputs, times, levels))
    return tuple(profiles)


def control_signals(profiles: Sequence[ControlProfile], initial: Mapping[str, float]) -> Signals:
    """Return the signals of profiles for initial values. Raises a SceneError if times decrease."""
    if not profiles:
        return Signals.no_signals()
    most = max(len(profile.times) for profile in profiles)
    places = [place for profile in profiles for place in profile.inputs]
    rows = [_padded_knots(profile, initial, most) for profile in profiles for _ in profile.inputs]
    times, levels = (np.array(part, np.float64) for part in zip(*rows, strict=True))
    return Signals(np.array(places, np.intp), times, levels)


def _padded_knots(
    profile: ControlProfile, initial: Mapping[str, float], most: int
) -> tuple[list[float], list[float]]:
    times = [evaluate_formula(instant, initial) for instant in profile.times]
    if times != sorted(times):
        raise SceneError(
            f"control {profile.name}: times must not decrease, but are "
            f"{', '.join(f'{time:g}' for time in times)} s for {dict(initial)}"
        )
    levels = [evaluate_formula(level, initial) for level in profile.levels]
    rest = most - len(times)
    return times + times[-1:] * rest, levels + levels[-1:] * rest


@dataclass(frozen=True)
class HoldSpec:
    """The body that holds the subject, and the start and end of the hold [s]."""

    subject: str
    holder: str
    start: Expression
    stop: Expression

    def hold_window(self, initial: Mapping[str, float]) -> tuple[float, float]:
        """Return its start and end [s] for initial values. Raises a SceneError if it is empty."""
        start, stop = evaluate_formula(self.start, initial), evaluate_formula(self.stop, initial)
        if not 0 <= start < stop:
            raise SceneError(
                f"hold goes from {start:g} s to {stop:g} s for {dict(initial)}; "
                "write a start of at least 0, and a later end"
            )
        return start, stop


def find_hold(
    model: mujoco.MjModel, manifest: SceneManifest | None, subject: int | None
) -> HoldSpec | None:
    """Return the hold that a manifest declares, if any. Raises a SceneError if it does not fit."""
    if manifest is None or manifest.hold is None:
        return None
    if subject is None:
        raise SceneError("hold needs a subject; name the held body in `subject`")
    holder = manifest.hold.relative_to or "world"
    bodies = [name_of(model, "body", body) for body in range(model.nbody)]
    message = f"hold: relative_to names '{holder}', which is not a body of the model"
    SceneError.unless_known(holder, bodies, message)
    holding = HoldSpec(
        subject=bodies[subject],
        holder=holder,
        start=read_formula(manifest.hold.start, "hold sets its `from`", manifest.initial),
        stop=read_formula(manifest.hold.stop, "hold sets its `to`", manifest.initial),
    )
    _, stop = holding.hold_window(
        {name: setting.default for name, setting in manifest.initial.items()}
    )
    if manifest.duration is not None and stop > manifest.duration:
        raise SceneError(
            f"hold ends at {stop:g} s, after the run, which takes {manifest.duration:g} s"
        )
    return holding
