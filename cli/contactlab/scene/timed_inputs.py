"""What depends on time in a scene: controls and forces along knots, and when something is held."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.expression import Expression, ExpressionError
from contactlab.scene.model_joints import StateCoordinate, match_coordinates
from contactlab.schema.scene_manifest import SceneManifest, Term


def read_formula(term: Term, where: str, manifest: SceneManifest) -> Expression:
    """Parse a number or an expression of a manifest.

    Args:
        term: as written.
        where: what sets it, for messages.
        manifest: declares the initial values.

    Raises:
        SceneError: it is not an expression, or names something other than initial values.
    """
    try:
        expression = Expression(str(term))
    except ExpressionError as error:
        raise SceneError(f"{where} to '{term}': {error}") from error
    unknown = ", ".join(sorted(set(expression.names) - set(manifest.initial)))
    if unknown:
        known = ", ".join(manifest.initial) or "a number: the scene has no initial values"
        raise SceneError(f"{where} from unknown {unknown}; write one of {known}")
    return expression


def computed(formula: Expression, initial: Mapping[str, float]) -> float:
    """Return an expression's value for the initial values of a run.

    Raises:
        SceneError: it cannot be computed, or is not a number.
    """
    try:
        result = formula.evaluate(initial)
    except ExpressionError as error:
        raise SceneError(f"cannot compute '{formula.text}' for {dict(initial)}: {error}") from error
    if not isinstance(result, float):
        raise SceneError(f"'{formula.text}' is {result!r}, not a number")
    return result


_INPUTS = "ACTUATOR.ctrl, or BODY.fx, .fy, .fz, .tx, .ty, .tz"


@dataclass(frozen=True)
class ControlProfile:
    """What the inputs that match one pattern do over time.

    Attributes:
        name: the pattern, for messages.
        inputs: indices among the controls followed by the forces on bodies.
        times: of its knots [s].
        levels: values at its knots.
    """

    name: str
    inputs: tuple[int, ...]
    times: tuple[Expression, ...]
    levels: tuple[Expression, ...]


class ControlKnots(NamedTuple):
    """Control profiles computed for n runs; see `InitialStates`."""

    driven: np.ndarray
    knots: Floats
    levels: Floats


def read_control(
    model: mujoco.MjModel, manifest: SceneManifest | None
) -> tuple[ControlProfile, ...]:
    """Return the profiles of a manifest's `control`.

    Raises:
        SceneError: a name is not an input of the model, an input is set twice, or an expression is
            invalid.
    """
    if manifest is None:
        return ()
    profiles = [_profile(model, manifest, name) for name in manifest.control]
    taken: dict[int, str] = _set_at_start(model, manifest)
    for profile in profiles:
        for place in profile.inputs:
            if place in taken:
                raise SceneError(
                    f"control {profile.name}: {taken[place]} sets the same input; keep one of them"
                )
            taken[place] = f"control {profile.name}"
    return tuple(profiles)


def control_knots(
    profiles: Sequence[ControlProfile], runs: Sequence[Mapping[str, float]]
) -> ControlKnots:
    """Return the knots of profiles for each run's initial values.

    Raises:
        SceneError: a knot cannot be computed, or times decrease.
    """
    most = max((len(each.times) for each in profiles), default=0)
    driven = [place for each in profiles for place in each.inputs]
    shape = (len(runs), len(driven), most)
    lines = ControlKnots(np.tile(np.array(driven, np.intp), (len(runs), 1)), *np.zeros((2, *shape)))
    for run, initial in enumerate(runs):
        rows = [_knots(each, initial, most) for each in profiles for _ in each.inputs]
        for place, (times, levels) in enumerate(rows):
            lines.knots[run, place], lines.levels[run, place] = times, levels
    return lines


def _profile(model: mujoco.MjModel, manifest: SceneManifest, name: str) -> ControlProfile:
    entry = manifest.control[name]

    def formulas(terms: Sequence[Term], part: str) -> tuple[Expression, ...]:
        return tuple(
            read_formula(term, f"control {name} sets its {part}", manifest) for term in terms
        )

    return ControlProfile(
        name, _inputs(model, name), formulas(entry.at, "times"), formulas(entry.to, "values")
    )


def _inputs(model: mujoco.MjModel, pattern: str) -> tuple[int, ...]:
    inputs = [_input_index(model, each) for each in match_coordinates(model, pattern)]
    if None in inputs:
        raise SceneError(f"control '{pattern}' is part of the state, not an input; write {_INPUTS}")
    return tuple(index for index in inputs if index is not None)


def _set_at_start(model: mujoco.MjModel, manifest: SceneManifest) -> dict[int, str]:
    """Return the inputs that initial values set already, with what sets them."""
    return {
        index: f"initial value '{name}'"
        for name, entry in manifest.initial.items()
        for pattern in entry.sets
        for each in match_coordinates(model, pattern)
        if (index := _input_index(model, each)) is not None
    }


def _input_index(model: mujoco.MjModel, coordinate: StateCoordinate) -> int | None:
    """Return a coordinate's index among the controls followed by forces; None for the state."""
    offset = {"ctrl": 0, "xfrc_applied": model.nu}.get(coordinate.field)
    return None if offset is None else offset + coordinate.index


def _knots(
    profile: ControlProfile, initial: Mapping[str, float], most: int
) -> tuple[list[float], list[float]]:
    """Return a profile's knots, padded with the last one."""
    times = [computed(each, initial) for each in profile.times]
    if times != sorted(times):
        raise SceneError(
            f"control {profile.name}: times must not decrease, but are "
            f"{', '.join(f'{time:g}' for time in times)} s for {dict(initial)}"
        )
    levels = [computed(each, initial) for each in profile.levels]
    rest = most - len(times)
    return times + times[-1:] * rest, levels + levels[-1:] * rest


_WORLD = "world"


@dataclass(frozen=True)
class HoldSpec:
    """Which body holds the subject, and when.

    Attributes:
        subject: the held body.
        holder: the holding body.
        start: start of the window [s].
        stop: end of the window [s].
    """

    subject: str
    holder: str
    start: Expression
    stop: Expression

    def window(self, initial: Mapping[str, float]) -> tuple[float, float]:
        """Return the start and end [s] of the window in a run of these initial values.

        Raises:
            SceneError: the window is empty or starts before 0.
        """
        start, stop = computed(self.start, initial), computed(self.stop, initial)
        if not 0 <= start < stop:
            raise SceneError(
                f"hold goes from {start:g} s to {stop:g} s for {dict(initial)}; "
                "write a time from 0 on, and a later one"
            )
        return start, stop


def find_hold(
    model: mujoco.MjModel, manifest: SceneManifest | None, subject: int | None
) -> HoldSpec | None:
    """Return the hold that a manifest declares, if it does.

    Raises:
        SceneError: there is no subject, no such holder, or the window does not fit the run.
    """
    if manifest is None or manifest.hold is None:
        return None
    if subject is None:
        raise SceneError("hold needs a subject; name the held body in `subject`")
    holder = manifest.hold.relative_to or _WORLD
    bodies = [model.body(each).name for each in range(model.nbody)]
    if holder not in bodies:
        hint = did_you_mean(holder, bodies)
        raise SceneError(
            f"hold: relative_to names '{holder}', which is not a body of the model{hint}"
        )
    holding = HoldSpec(
        subject=bodies[subject],
        holder=holder,
        start=read_formula(manifest.hold.start, "hold sets its `from`", manifest),
        stop=read_formula(manifest.hold.stop, "hold sets its `to`", manifest),
    )
    _, stop = holding.window({name: each.default for name, each in manifest.initial.items()})
    if stop > manifest.duration:
        raise SceneError(
            f"hold ends at {stop:g} s, after the run, which takes {manifest.duration:g} s"
        )
    return holding
