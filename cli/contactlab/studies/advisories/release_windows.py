"""Computes quantities of states of a model, and windows of steps from them."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import EngineError
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.studies.parity.forward import read_forward_quantities

State = Mapping[str, Floats]
"""Parts of a state by their names in mjData, without the start of the solver."""
_PARTS = ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat")
WINDOW_STEPS = 10
"""Steps of a window: long enough for an integrator's fault, short enough that chaos is small."""
_COMPILED = (
    *("body_mass", "body_inertia", "body_ipos", "body_pos", "geom_size", "geom_pos"),
    *("geom_friction", "jnt_range", "dof_M0", "qpos0"),
)
"""Fields of a compiled model that are compared, besides quantities that are computed from them."""


class Windows(NamedTuple):
    """Quantities of K states of a model: exact ones, and those rounded to single precision.

    Attributes:
        compiled: fields of the compiled model.
        saved: the same of the model that was saved and loaded; or why it was refused.
        exact, rounded: quantities of a forward computation by name, one array for each state.
        sensors, rounded_sensors: sensordata of each state.
        tight: qacc of each state by a dense Newton solver without tolerance.
        ends, rounded_ends: qpos and qvel after a window of steps.
        fine_ends: the same by shorter steps.
    """

    compiled: Mapping[str, Floats]
    saved: Mapping[str, Floats] | str
    exact: Mapping[str, Sequence[Floats]]
    rounded: Mapping[str, Sequence[Floats]]
    sensors: Sequence[Floats]
    rounded_sensors: Sequence[Floats]
    tight: Sequence[Floats]
    ends: Sequence[Floats]
    rounded_ends: Sequence[Floats]
    fine_ends: Sequence[Floats]


Evaluate = Callable[[str, Sequence[State]], Windows]
"""Returns the windows of a model, as MJCF, from states; an EngineError says that it is refused."""


def record_states(text: str, start: State, steps: Sequence[int]) -> list[State]:
    """Return states after some steps from a start, under random controls within their ranges."""
    model = compile_text(text)
    data = mujoco.MjData(model)
    _set_state(model, data, start)
    draw, states = np.random.default_rng(0), list[State]()
    limited = np.asarray(model.actuator_ctrllimited).astype(bool)
    low, high = np.where(limited[:, None], model.actuator_ctrlrange, [-0.1, 0.1]).T
    hold_steps = 50  # steps between new controls
    for step in range(max(steps) + 1):
        if step in steps:
            states.append({name: np.array(getattr(data, name)) for name in _PARTS})
        if step % hold_steps == hold_steps - 1 and len(data.ctrl) == len(low):
            data.ctrl[:] = draw.uniform(low, high)
        mujoco.mj_step(model, data)
    return [state for state in states if all(np.isfinite(part).all() for part in state.values())]


def evaluate_windows(text: str, states: Sequence[State]) -> Windows:
    """Return the windows of a model from states, under the MuJoCo of this process."""
    model, fine = compile_text(text), compile_text(text)
    finer = 8  # steps of a finer window in one step
    fine.opt.timestep /= finer
    rows_by_field: dict[str, list[Any]] = {name: [] for name in Windows._fields}
    data = mujoco.MjData(model)
    for state in states:
        single = {name: part.astype(np.float32).astype(np.float64) for name, part in state.items()}
        for each, prefix, forward in ((state, "", "exact"), (single, "rounded_", "rounded")):
            _set_state(model, data, each)
            rows_by_field[forward].append(read_forward_quantities(model, data))
            rows_by_field[f"{prefix}sensors"].append(np.array(data.sensordata))
            rows_by_field[f"{prefix}ends"].append(_step_window(model, each, WINDOW_STEPS))
        rows_by_field["tight"].append(_solve_tightly(model, state))
        rows_by_field["fine_ends"].append(_step_window(fine, state, finer * WINDOW_STEPS))
    by_name: dict[str, Any] = {
        name: {
            field: [one[field] for one in rows_by_field[name]] for field in rows_by_field[name][0]
        }
        for name in ("exact", "rounded")
    }
    own = {"compiled": _read_compiled(model), "saved": _read_saved(text)}
    fields: dict[str, Any] = {**rows_by_field, **by_name, **own}
    return Windows(**fields)


def compile_text(text: str) -> mujoco.MjModel:
    """Return a compiled model; an EngineError says that this MuJoCo refuses it.

    Collisions of smooth shapes are iterated to rounding, since a loose tolerance is not a fault.
    """
    silence_mujoco()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = mujoco.MjModel.from_xml_string(text)
    except (ValueError, mujoco.FatalError) as error:
        raise EngineError(f"MuJoCo {mujoco.__version__} refuses it: {error}") from error
    model.opt.ccd_tolerance = min(model.opt.ccd_tolerance, 1e-12)
    model.opt.ccd_iterations = max(model.opt.ccd_iterations, 500)
    return model


def _read_compiled(model: mujoco.MjModel) -> Mapping[str, Floats]:
    return {name: np.array(getattr(model, name)) for name in _COMPILED}


def _read_saved(text: str) -> Mapping[str, Floats] | str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            spec = mujoco.MjSpec.from_string(text)
            spec.compile()
            return _read_compiled(mujoco.MjModel.from_xml_string(spec.to_xml()))
        except (ValueError, mujoco.FatalError) as error:
            return str(error) or type(error).__name__


def _step_window(model: mujoco.MjModel, state: State, steps: int) -> Floats:
    data = mujoco.MjData(model)
    _set_state(model, data, state)
    mujoco.mj_step(model, data, nstep=steps)
    return np.concatenate([data.qpos, data.qvel])


def _set_state(model: mujoco.MjModel, data: mujoco.MjData, state: State) -> None:
    mujoco.mj_resetData(model, data)
    for name, part in state.items():
        getattr(data, name)[:] = part


def _solve_tightly(model: mujoco.MjModel, state: State) -> Floats:
    option = model.opt
    own = option.solver, option.jacobian, option.tolerance, option.iterations
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.tolerance, option.iterations = 0.0, 1000
    data = mujoco.MjData(model)
    _set_state(model, data, state)
    mujoco.mj_forward(model, data)
    option.solver, option.jacobian, option.tolerance, option.iterations = own
    return np.array(data.qacc)
