"""What depends on time in a scene: controls and forces along knots, and when something is held."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.expression import Expression, ExpressionError
from contactlab.scene.model_joints import match_coordinates
from contactlab.schema import SceneManifest, Term


def read_formula(term: Term, where: str, manifest: SceneManifest) -> Expression:
    """Return a number or an expression of a manifest, ready to compute.

    Args:
        term: as written.
        where: where it stands, for messages.
        manifest: names the initial values.

    Raises:
        SceneError: it is no expression, or reads what is not an initial value.
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
        SceneError: it has none, or none that is a number.
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
    """What inputs of one pattern do over time.

    Attributes:
        name: the pattern, for messages.
        inputs: places among the controls followed by the forces on bodies.
        times: of its knots [s].
        levels: at its knots.
    """

    name: str
    inputs: tuple[int, ...]
    times: tuple[Expression, ...]
    levels: tuple[Expression, ...]


class ControlKnots(NamedTuple):
    """Programmes computed for n runs; see `InitialStates`."""

    driven: np.ndarray
    knots: Floats
    levels: Floats


def read_control(
    model: mujoco.MjModel, manifest: SceneManifest | None
) -> tuple[ControlProfile, ...]:
    """Return what a manifest's `control` says.

    Raises:
        SceneError: it names what the model lacks or what is no input, or one input twice, or
            holds what cannot be computed.
    """
    if manifest is None:
        return ()
    found = [_programme(model, manifest, name) for name in manifest.control]
    taken: dict[int, str] = _set_at_start(model, manifest)
    for programme in found:
        for place in programme.inputs:
            if place in taken:
                raise SceneError(
                    f"control {programme.name}: {taken[place]} sets the same; keep one of them"
                )
            taken[place] = f"control {programme.name}"
    return tuple(found)


def control_knots(
    programmes: Sequence[ControlProfile], runs: Sequence[Mapping[str, float]]
) -> ControlKnots:
    """Return the lines that programmes draw for each run's initial values.

    Raises:
        SceneError: a knot cannot be computed, or times decrease.
    """
    most = max((len(each.times) for each in programmes), default=0)
    driven = [place for each in programmes for place in each.inputs]
    shape = (len(runs), len(driven), most)
    lines = ControlKnots(np.tile(np.array(driven, np.intp), (len(runs), 1)), *np.zeros((2, *shape)))
    for run, initial in enumerate(runs):
        rows = [_knots(each, initial, most) for each in programmes for _ in each.inputs]
        for place, (times, levels) in enumerate(rows):
            lines.knots[run, place], lines.levels[run, place] = times, levels
    return lines


def _programme(model: mujoco.MjModel, manifest: SceneManifest, name: str) -> ControlProfile:
    entry = manifest.control[name]

    def formulas(terms: Sequence[Term], part: str) -> tuple[Expression, ...]:
        return tuple(
            read_formula(term, f"control {name} sets its {part}", manifest) for term in terms
        )

    return ControlProfile(
        name, _inputs(model, name), formulas(entry.at, "times"), formulas(entry.to, "values")
    )


def _inputs(model: mujoco.MjModel, pattern: str) -> tuple[int, ...]:
    offsets = {"ctrl": 0, "xfrc_applied": model.nu}
    found = match_coordinates(model, pattern)
    if any(each.field not in offsets for each in found):
        raise SceneError(f"control '{pattern}' is no input, but part of the state; write {_INPUTS}")
    return tuple(offsets[each.field] + each.index for each in found)


def _set_at_start(model: mujoco.MjModel, manifest: SceneManifest) -> dict[int, str]:
    """Return the inputs that initial values set already, and which does."""
    offsets = {"ctrl": 0, "xfrc_applied": model.nu}
    return {
        offsets[each.field] + each.index: f"initial value '{name}'"
        for name, entry in manifest.initial.items()
        for pattern in entry.sets
        for each in match_coordinates(model, pattern)
        if each.field in offsets
    }


def _knots(
    programme: ControlProfile, initial: Mapping[str, float], most: int
) -> tuple[list[float], list[float]]:
    """Return a programme's knots, the last one repeated to fill up."""
    times = [computed(each, initial) for each in programme.times]
    if times != sorted(times):
        raise SceneError(
            f"control {programme.name}: times must not decrease, but are "
            f"{', '.join(f'{time:g}' for time in times)} s for {dict(initial)}"
        )
    levels = [computed(each, initial) for each in programme.levels]
    rest = most - len(times)
    return times + times[-1:] * rest, levels + levels[-1:] * rest


_WORLD = "world"


@dataclass(frozen=True)
class HoldSpec:
    """What a manifest's `hold` says.

    Attributes:
        subject: the body that is held.
        holder: the body that holds it.
        start: from when [s].
        stop: to when [s].
    """

    subject: str
    holder: str
    start: Expression
    stop: Expression

    def window(self, initial: Mapping[str, float]) -> tuple[float, float]:
        """Return when a run of these initial values should hold, from and to [s].

        Raises:
            SceneError: that is no stretch of time.
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
    """Return what a manifest says of the subject's hold, if it does.

    Raises:
        SceneError: there is no subject or no such holder, or the times are wrong.
    """
    if manifest is None or manifest.hold is None:
        return None
    if subject is None:
        raise SceneError("hold needs to know what is held; name it in `subject`")
    holder = manifest.hold.relative_to or _WORLD
    bodies = [model.body(each).name for each in range(model.nbody)]
    if holder not in bodies:
        hint = did_you_mean(holder, bodies)
        raise SceneError(f"hold: '{holder}' in relative_to is no body of the model{hint}")
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
