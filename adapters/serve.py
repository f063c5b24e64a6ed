"""The process of an engine: `python serve.py ADAPTER.py`, in the environment that has the engine.

It reads requests from its input and answers on what was its output, both pickled: None whenever
part of the work is done, and in the end a dictionary of arrays, or a sentence that says what went
wrong. It knows nothing of contactlab, and ends with the process that started it.

Adapters import it as `serve`, where they run, for what every engine needs of a request.
"""

import importlib.util
import os
import pickle
import sys
from typing import Any

import mujoco
import numpy as np

_ENERGIES = {
    int(mujoco.mjtSensor.mjSENS_E_POTENTIAL): 0,
    int(mujoco.mjtSensor.mjSENS_E_KINETIC): 1,
}


def model_of(request: dict[str, Any], run: int, *without: str) -> mujoco.MjModel:
    """Return the model of a run, with these flags of MuJoCo as they are by default."""
    model = mujoco.MjModel.from_binary_path("m.mjb", {"m.mjb": request["models"][run]})
    for name in without:
        model.opt.disableflags &= ~int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0))
    return model


def models_of(request: dict[str, Any], *without: str) -> list[mujoco.MjModel]:
    """Return the models of all runs, as `model_of` does; equal ones are one."""
    places = {id(binary): run for run, binary in enumerate(request["models"])}
    made = {key: model_of(request, run, *without) for key, run in places.items()}
    return [made[id(binary)] for binary in request["models"]]


def start_of(request: dict[str, Any], run: int, model: mujoco.MjModel) -> mujoco.MjData:
    """Return the data of a run at its start."""
    data = mujoco.MjData(model)
    for name in ("qpos", "qvel", "ctrl", "act"):
        getattr(data, name)[:] = request[name][run]
    data.xfrc_applied[:] = request["applied"][run].reshape(-1, 6)
    if model.nmocap:
        data.mocap_pos[:], data.mocap_quat[:] = mocap(request["mocap"][run], model.nmocap)
    return data


def inputs_of(
    request: dict[str, Any], run: int, model: mujoco.MjModel
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (N, nu) controls, (N, nbody, 6) forces and (N, 7 nmocap) places in each step."""
    names = ("ctrl", "applied", "mocap")
    values = np.concatenate([request[name][run] for name in names])
    values = np.tile(values, (request["steps"], 1))
    values[:, request["places"]] = request["levels"][run]
    controls, forces, places = np.split(values, [model.nu, model.nu + 6 * model.nbody], axis=1)
    return controls, forces.reshape(len(forces), -1, 6), places


def mocap(row: np.ndarray, bodies: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (nmocap, 3) positions and (nmocap, 4) quaternions of a row of inputs."""
    return row[: 3 * bodies].reshape(-1, 3), row[3 * bodies :].reshape(-1, 4)


# What a state has before it steps, as `forward` of adapters tells it, beside its contacts.
FORWARD = ("xpos", "xquat", "qfrc_bias", "qfrc_passive", "qfrc_actuator", "qacc_smooth",
           "qfrc_constraint", "qacc")  # fmt: skip
_OF_CONTACTS = ("geom", "dist", "includemargin", "friction", "solref", "solimp", "pos")


def contact_rows(contact: Any) -> np.ndarray:
    """Return (K, 19) numbers of contacts.

    They are two geoms, distance, the one below which it acts, friction (5), solref (2), solimp (5)
    and position (3).
    """
    arrays = [np.asarray(getattr(contact, name), np.float64) for name in _OF_CONTACTS]
    return np.hstack([each if each.ndim > 1 else each[:, None] for each in arrays])


def energy_sensors(model: mujoco.MjModel) -> list[int]:
    """Return the sensors of energy, which engines beside MuJoCo's own may lack."""
    return [each for each, kind in enumerate(model.sensor_type.tolist()) if kind in _ENERGIES]


def add_energies(model: mujoco.MjModel, state: np.ndarray, sensors: np.ndarray) -> None:
    """Fill in what sensors of energy measure before each step, of an engine's states."""
    wanted = energy_sensors(model)
    data = mujoco.MjData(model)
    for row in range(len(sensors) if wanted else 0):
        data.qpos[:], data.qvel[:], _ = np.split(state[row], [model.nq, model.nq + model.nv])
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        for each in wanted:
            sensors[row, model.sensor_adr[each]] = data.energy[_ENERGIES[model.sensor_type[each]]]


def main(adapter: str) -> None:
    """Simulate what is asked until the input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what an engine prints is no answer

    def answer(value: object) -> None:
        pickle.dump(value, answers, protocol=5)
        answers.flush()

    sys.modules["serve"] = sys.modules["__main__"]
    spec = importlib.util.spec_from_file_location("adapter", adapter)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)  # noqa: S301 - from the process that started it
        except EOFError:
            return
        try:
            answer(getattr(module, request["operation"])(request, lambda: answer(None)))
        except BrokenPipeError:
            return
        except Exception as error:  # noqa: BLE001 - told where it is known which runs it was
            answer(f"{type(error).__name__}: {' '.join(str(error).split())}")


if __name__ == "__main__":
    main(sys.argv[1])
