"""Finds the first stage of a step that differs between two releases, and a small model of it."""

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import EngineError
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.timed_inputs import Signals
from contactlab.studies.advisories.release_windows import Evaluate, State, Windows
from contactlab.studies.parity.forward import FLOOR_FACTOR, ForwardStates
from contactlab.studies.shrink.failing_model import FailingModel, Start
from contactlab.studies.shrink.shrinking import remove_unneeded_parts

COMPILER, SENSORS, INTEGRATION = "compiler", "sensors", "integration"
SAVED = "saved model"
STAGES = {
    COMPILER: "compiler",
    "kinematics": "kinematics",
    "contacts": "collision",
    "forces": "forces",
    "smooth acceleration": "forces",
    "constraint forces": "constraints",
    "acceleration": "solver",
    SENSORS: "sensors",
    INTEGRATION: "integration",
}
"""Stages of a step as parity names them, and as this report does."""
_INDEX = re.compile(r"\[[\d, ]+\]")
_ADDRESS = re.compile(r"geom\[(\d+)\]")
_SOLVED = ("constraints", "solver")


class Difference(NamedTuple):
    """The first difference of two releases in a model.

    Attributes:
        stage: the first stage of a step that differs.
        quantity: the field with its index, or the differing quantity of a pair of geoms.
        kind: the same without indices, and with kinds of geoms.
        place: index of the state.
        first, second: values under the two releases.
    """

    stage: str
    quantity: str
    kind: str
    place: int
    first: float
    second: float

    @property
    def key(self) -> tuple[str, str]:
        """Stage and kind, which a cause is known by."""
        return self.stage, self.kind


def list_differences(
    model: mujoco.MjModel, first: Windows, second: Windows
) -> Iterator[Difference]:
    """Yield the first difference of windows from common states, and those of other causes.

    A saved model says nothing about the steps of the original one. A solution of constraints is
    compared with that of the same release, so contacts may differ before.
    """
    if difference := _find_compiled_difference(first.compiled, second.compiled, ""):
        yield difference
        return
    if isinstance(first.saved, str) or isinstance(second.saved, str):
        refused = isinstance(first.saved, str), isinstance(second.saved, str)
        if refused[0] != refused[1]:
            yield Difference(COMPILER, SAVED, f"{SAVED} is refused", 0, *map(float, refused))
    elif difference := _find_compiled_difference(first.saved, second.saved, SAVED):
        yield difference
    states = ForwardStates(model, range(len(first.ends)), first.exact, second.exact, first.rounded)
    solved = _find_solver_difference(first, second)
    if difference := states.first_divergence():
        kind = _name_kind(model, difference.quantity)
        values = (
            np.nan if value is None else value for value in (difference.mujoco, difference.engine)
        )
        stage = STAGES[difference.stage]
        yield Difference(stage, difference.quantity, kind, difference.step, *values)
        if solved and stage not in _SOLVED:
            yield solved
        return
    skipped = states.ambiguous_steps()
    if (
        last := solved
        or _find_sensor_difference(model, first, second, skipped)
        or _find_integration_difference(model, first, second, skipped)
    ):
        yield last


def _find_solver_difference(first: Windows, second: Windows) -> Difference | None:
    # Each release is compared with its own tight solution, since rounding may change contacts.
    for place in range(len(first.ends)):
        errors = _solver_error(first, place), _solver_error(second, place)
        if _differ_clearly(errors):
            ours, theirs = (np.asarray(one.exact["qacc"][place]) for one in (first, second))
            worst = int(np.abs(ours - theirs).argmax())
            values = float(ours[worst]), float(theirs[worst])
            return Difference("solver", f"qacc[{worst}]", "qacc", place, *values)
    return None


def _find_compiled_difference(
    first: Mapping[str, Floats], second: Mapping[str, Floats], prefix: str
) -> Difference | None:
    # MJCF with six digits loses this share of the largest number.
    share = 1e-5 if prefix else COARSE_ROUNDING
    for name, ours in first.items():
        theirs, kind = second[name], f"{name} of the {prefix}" if prefix else name
        if ours.shape != theirs.shape:
            return Difference(COMPILER, name, kind, 0, len(ours), len(theirs))
        gap = np.abs(ours - theirs) - share * (np.abs(ours) + np.abs(ours).max(initial=0))
        if (gap > 0).any():
            worst = np.unravel_index(int(gap.argmax()), gap.shape)
            place = f"{name}[{', '.join(map(str, worst))}]"
            return Difference(COMPILER, place, kind, 0, float(ours[worst]), float(theirs[worst]))
    return None


def _find_sensor_difference(
    model: mujoco.MjModel, first: Windows, second: Windows, skipped: set[int]
) -> Difference | None:
    for place, (ours, theirs) in enumerate(zip(first.sensors, second.sensors, strict=True)):
        if place in skipped or ours.shape != theirs.shape or not ours.size:
            continue
        floor = np.abs(ours - first.rounded_sensors[place])
        allowed = COARSE_ROUNDING * (1 + np.abs(ours)) + FLOOR_FACTOR * floor
        worst = int((np.abs(ours - theirs) / allowed).argmax())
        if np.abs(ours - theirs)[worst] > allowed[worst]:
            sensor = int(np.searchsorted(model.sensor_adr, worst, "right")) - 1
            kind = mujoco.mjtSensor(int(model.sensor_type[sensor])).name.removeprefix("mjSENS_")
            values = float(ours[worst]), float(theirs[worst])
            return Difference(SENSORS, f"sensordata[{worst}]", kind.lower(), place, *values)
    return None


def _find_integration_difference(
    model: mujoco.MjModel, first: Windows, second: Windows, skipped: set[int]
) -> Difference | None:
    for place, (ours, theirs) in enumerate(zip(first.ends, second.ends, strict=True)):
        if place in skipped:
            continue
        floor = np.abs(ours - first.rounded_ends[place]).max()
        excess = np.abs(ours - theirs) / (
            COARSE_ROUNDING * (1 + np.abs(ours)) + FLOOR_FACTOR * floor
        )
        excess[~np.isfinite(theirs)] = np.inf
        worst = int(excess.argmax())
        if excess[worst] > 1:
            name = f"qpos[{worst}]" if worst < model.nq else f"qvel[{worst - model.nq}]"
            values = float(ours[worst]), float(theirs[worst])
            return Difference(INTEGRATION, name, _INDEX.sub("", name), place, *values)
    return None


def _name_kind(model: mujoco.MjModel, quantity: str) -> str:
    what, of, pair = quantity.partition(" of ")
    if not of:
        return _INDEX.sub("", quantity)
    kinds = [_kind_of_geom(model, name) for name in pair.split(" - ")]
    return f"{what} of {' - '.join(sorted(kinds))}"


def _kind_of_geom(model: mujoco.MjModel, name: str) -> str:
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if geom < 0 and (address := _ADDRESS.fullmatch(name)):
        geom = int(address[1])
    if geom < 0:
        return name
    return mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()


def decide_fault(
    difference: Difference, releases: tuple[str, str], first: Windows, second: Windows
) -> tuple[str, str]:
    """Return the release at fault and the computation that decides; "" and why if none does.

    Each release is compared with itself: a model that was saved with the model as compiled, a
    solution of constraints with that of a dense Newton solver without tolerance, and a window with
    one of shorter steps.
    """
    if SAVED in difference.kind:
        reference, measure = "the model before it was saved", _saving_error
    elif difference.stage in _SOLVED:
        reference, measure = "a dense Newton solver without tolerance", _solver_error
    elif difference.stage == INTEGRATION:
        reference, measure = "shorter steps", _step_error
    else:
        return "", "no closed form or independent computation is known for this stage"
    errors = [measure(windows, difference.place) for windows in (first, second)]
    worse = int(errors[1] > errors[0])
    if _differ_clearly(errors):
        return releases[worse], (
            f"the difference to {reference} is a share of {errors[worse]:.2g} under "
            f"{releases[worse]}, and of {errors[1 - worse]:.2g} under {releases[1 - worse]}"
        )
    return "", f"both releases agree with {reference} alike"


def _differ_clearly(errors: Sequence[float]) -> bool:
    ordinary_error = 1e-4  # of a solver, of steps or of saved text, as a share
    clear_ratio = 30.0  # of the errors of a wrong and a right release
    return max(errors) > max(ordinary_error, clear_ratio * min(errors))


def _saving_error(windows: Windows, place: int) -> float:
    del place
    if isinstance(windows.saved, str):
        return np.inf
    return max(
        np.inf
        if windows.saved[name].shape != values.shape
        else _relative_error(windows.saved[name], values)
        for name, values in windows.compiled.items()
    )


def _solver_error(windows: Windows, place: int) -> float:
    # At rest all accelerations are small against those that constraints balance.
    free = np.abs(np.asarray(windows.exact["qacc_smooth"][place])).max(initial=0)
    return _relative_error(np.asarray(windows.exact["qacc"][place]), windows.tight[place], free)


def _step_error(windows: Windows, place: int) -> float:
    return _relative_error(windows.ends[place], windows.fine_ends[place])


def _relative_error(values: Floats, right: Floats, least_scale: float = 0.0) -> float:
    scale = max(np.abs(right).max(initial=0), least_scale) or 1.0
    error = float(np.abs(values - right).max(initial=0) / scale)
    return error if np.isfinite(error) else np.inf


@dataclass
class DifferenceTrials:
    """Tries smaller models, which have to differ in the same way from the same start.

    Attributes:
        first, second: compute the windows under the two releases.
        key: stage and kind of the difference.
        end: by the monotonic clock; no trial begins later [s].
    """

    first: Evaluate
    second: Evaluate
    key: tuple[str, str]
    end: float
    _answers: dict[str, bool] = field(default_factory=dict[str, bool])

    @property
    def over(self) -> bool:
        """Whether the time for trials is over."""
        return time.monotonic() > self.end

    def still_fails(self, model: FailingModel) -> bool:
        """Return whether the releases differ in this model in the same way."""
        if model.text not in self._answers and not self.over:
            self._answers[model.text] = self.compare_releases(model) is not None
        return self._answers.get(model.text, False)

    def compare_releases(self, model: FailingModel) -> tuple[Difference, Windows, Windows] | None:
        """Return the difference of the key in a model from its start, with the windows."""
        try:
            compiled = model.compile_spec()
            states = [state_of(model.start, compiled)]
            windows = self.first(model.text, states), self.second(model.text, states)
        except (EngineError, ValueError, mujoco.FatalError):
            return None
        same_differences = (
            each for each in list_differences(compiled, *windows) if each.key == self.key
        )
        return next(((each, *windows) for each in same_differences), None)


def state_of(start: Start, model: mujoco.MjModel) -> State:
    """Return the start of the parts of a model as a state."""
    values = dict(start.keyframe_values(model))
    poses = values.pop("mpos").reshape(-1, 3), values.pop("mquat").reshape(-1, 4)
    return {**values, "mocap_pos": poses[0], "mocap_quat": poses[1]}


def start_at(model: mujoco.MjModel, state: State) -> Start:
    """Return a state as the start of the parts of a model."""
    poses = np.hstack([state["mocap_pos"].ravel(), state["mocap_quat"].ravel()])
    rows: Mapping[str, Floats] = {
        name: state[name][None] for name in ("qpos", "qvel", "act", "ctrl")
    }
    applied = np.zeros((1, 6 * model.nbody))
    still = InitialStates(
        **rows, applied=applied, mocap=poses[None], signals=(Signals.no_signals(),)
    )
    return Start.of(model, still, None)


def state_at(model: mujoco.MjModel, start: InitialStates) -> State:
    """Return the first of some initial states."""
    poses = start.mocap[0]
    parts = {name: getattr(start, name)[0] for name in ("qpos", "qvel", "act", "ctrl")}
    turns = 3 * model.nmocap
    return {
        **parts,
        "mocap_pos": poses[:turns].reshape(-1, 3),
        "mocap_quat": poses[turns:].reshape(-1, 4),
    }


def shrink_difference(model: FailingModel, trials: DifferenceTrials) -> FailingModel:
    """Return a smaller model that differs in the same way from its start."""
    return remove_unneeded_parts(model, trials) if trials.still_fails(model) else model


def measure_of(model: mujoco.MjModel, quantity: str) -> str:
    """Return the expression of an advisory that measures a quantity."""
    what, of, pair = quantity.partition(" of ")
    if of:
        one, _, other = pair.partition(" - ")
        functions = {"count": "contacts", "distance": "depth"}
        if what in functions:
            return f"{functions[what]}('{one}', '{other}')"
        columns = {"normal": "contact.frame[2]", "points": "contact.pos[2]"}
        return f"sum({columns.get(what, f'contact.{what}[0]')})"
    name, _, index = quantity.removesuffix("]").partition("[")
    places = list(map(int, index.split(", "))) if index else []
    if len(places) != len(("row", "column")):
        return f"{name}[{places[0]}]" if places else f"sum({name})"
    kind = "geom" if name.startswith("geom_") else "body"
    return f"{name}['{getattr(model, kind)(places[0]).name}', {places[1]}]"
