"""Drake's CENIC, in continuous time and with error control, whose accuracy is `tolerance`."""

import time
from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

_BESIDE = Path(__file__).parent
_DRAKE, _JOINTS, _CONTACTS = (
    SimpleNamespace(**run_path(str(_BESIDE / name)))
    for name in ("drake.py", "beside/joints.py", "beside/drake_contacts.py")
)
PACKAGE, REQUIREMENTS, ENVIRONMENT = _DRAKE.PACKAGE, _DRAKE.REQUIREMENTS, "drake"
IGNORED = {name: why for name, why in _DRAKE.IGNORED.items() if name != "tolerance"}
CONTROLS_ERROR = True
_LONGEST = 0.1  # step [s]


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    if not model.opt.tolerance:
        return "its tolerance is an accuracy; set one above 0"
    springs = model.jnt_stiffness.any() and not model.opt.disableflags & _JOINTS.OFF.mjDSBL_SPRING
    if not _DRAKE.touches(model) and (springs or model.nu or model.dof_armature.any()):
        return (
            "its joints have no springs, actuators and armature; take a model that gravity alone "
            "moves, or the drake engine"
        )
    return _DRAKE.refusal(model)


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other."""
    import serve

    return {name: np.array(rows) for name, rows in serve.of_each(request, _run, tick).items()}


def _run(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import serve

    model = serve.model_of(request, run)
    controls, applied, _ = serve.inputs_of(request, run, model)
    touches = _DRAKE.touches(model)
    if applied.any() and not touches:
        raise NotImplementedError("no forces are applied to bodies here")
    plant = _CONTACTS.Contacts(model, 0.0) if touches else _DRAKE.Arm(model, 0.0)
    qpos, qvel = request["qpos"][run], request["qvel"][run]
    plant.put(qpos, qvel)
    times, owns, cost = _integrated(plant, model, applied)
    clock = model.opt.timestep * np.arange(len(applied) + 1)
    states = [np.concatenate([qpos, qvel])]
    for own in _between(plant, times, owns, clock):
        states.append(np.concatenate(plant.take(own, states[-1][: model.nq])))
    tick()
    state = np.array([states[0], *states[2:]])  # the start is told as it was given
    if touches:
        sensors = plant.measured(state, controls)
    else:
        sensors = np.zeros((len(controls), model.nsensordata))
        serve.add_energies(model, state, sensors)
    steps = np.histogram(times[1:], clock)[0]
    return {"state": state, "sensors": sensors, "cost": cost, "iterations": steps}


def _integrated(
    plant: Any, model: mujoco.MjModel, applied: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the times (K,) of the integrator's own steps, states there, and CPU time.

    It stops where the (N, nbody, 6) forces on bodies change, and nowhere else.
    """
    from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

    simulator = Simulator(plant.diagram, plant.root)
    config = SimulatorConfig(
        integration_scheme="cenic", accuracy=model.opt.tolerance, use_error_control=True,
        max_step_size=_LONGEST,
    )  # fmt: skip
    ApplySimulatorConfig(config, simulator)
    times, owns = list[float](), list[np.ndarray]()

    def note(root: Any) -> None:
        times.append(root.get_time())
        owns.append(plant.own(root))

    simulator.set_monitor(note)
    simulator.Initialize()
    begin = time.process_time()
    changed = np.flatnonzero((np.diff(applied, axis=0) != 0).any(axis=(1, 2))) + 1
    for first, last in zip([0, *changed], [*changed, len(applied)], strict=True):
        plant.apply(applied[first])
        simulator.AdvanceTo(last * model.opt.timestep)
    return np.array(times), np.array(owns), time.process_time() - begin


def _between(plant: Any, times: np.ndarray, owns: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """Return states at the times of a clock: coordinates by Hermite's cubics, speeds by chords."""
    place = np.clip(np.searchsorted(times, clock) - 1, 0, len(times) - 2)
    span = (times[place + 1] - times[place])[:, None]
    share = np.clip((clock - times[place])[:, None] / span, 0.0, 1.0)
    rates = np.array([plant.rates(own) for own in owns])
    count = rates.shape[1]
    told = owns[place] * (1 - share) + owns[place + 1] * share
    chord = owns[place + 1, :count] - owns[place, :count]
    bend = (1 - share) * (span * rates[place] - chord) - share * (span * rates[place + 1] - chord)
    told[:, :count] += share * (1 - share) * bend
    return told
