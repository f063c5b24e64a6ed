"""The process of an engine: `python serve.py ADAPTER.py`, in the environment that has the engine.

It reads requests from its input and answers on what was its output, both pickled: None whenever
part of the work is done, and in the end a dictionary of arrays, or a sentence that says what went
wrong. It knows nothing of contactlab, and ends with the process that started it, at once.

Adapters import it as `serve`, where they run, for what every engine needs of a request.
"""

import importlib.util
import os
import pickle
import re
import sys
from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
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


def of_each(
    request: dict[str, Any], tell: Callable[..., dict[str, Any]], tick: Callable[[], None]
) -> dict[str, list[Any]]:
    """Return by name what is told of each run, one after the other: `tell(request, run, tick)`."""
    runs = [tell(request, run, tick) for run in range(len(request["models"]))]
    return {name: [each[name] for each in runs] for name in runs[0]}


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


def peaks(
    request: dict[str, Any], models: list[mujoco.MjModel], runs: list[int]
) -> tuple[int, int]:
    """Return the most contacts and constraint rows that MuJoCo itself has in these runs."""
    contacts, rows = 8, 32
    for model, run in zip(models, runs, strict=True):
        data = start_of(request, run, model)
        for controls in inputs_of(request, run, model)[0]:
            data.ctrl[:] = controls
            mujoco.mj_step(model, data)
            contacts, rows = max(contacts, data.ncon), max(rows, data.nefc)
    return contacts, rows


def mocap(row: np.ndarray, bodies: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (nmocap, 3) positions and (nmocap, 4) quaternions of a row of inputs."""
    return row[: 3 * bodies].reshape(-1, 3), row[3 * bodies :].reshape(-1, 4)


# What an element of a model has, under names that its specification and the compiled model share.
_OPTIONS = ("timestep", "gravity", "wind", "magnetic", "density", "viscosity", "impratio",
            "tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance", "integrator", "cone",
            "jacobian", "solver", "iterations", "ls_iterations", "noslip_iterations",
            "ccd_iterations", "disableflags", "enableflags")  # fmt: skip
_BODY = ("pos", "quat", "ipos", "iquat", "mass", "inertia", "gravcomp")
_JOINT = ("type", "pos", "axis", "limited", "range", "margin", "solref_limit", "solimp_limit",
          "actfrclimited", "actfrcrange", "actgravcomp")  # fmt: skip
_GEOM = ("type", "size", "pos", "quat", "contype", "conaffinity", "condim", "priority", "friction",
         "solmix", "solref", "solimp", "margin", "gap")  # fmt: skip
_PAIR = ("friction", "solref", "solreffriction", "solimp", "margin", "gap")
_ACTUATOR = ("gaintype", "gainprm", "biastype", "biasprm", "dyntype", "dynprm", "gear",
             "ctrllimited", "ctrlrange", "forcelimited", "forcerange", "actlimited",
             "actrange")  # fmt: skip
_CALLED = {"solref_limit": "solref", "solimp_limit": "solimp"}  # otherwise in the compiled model
_PHYSICS = ("body_", "jnt_", "dof_", "geom_", "pair_", "actuator_", "eq_", "tendon_", "exclude_")
_BESIDE = ("user", "rgba", "matid", "group", "plugin", "sameframe", "bvh", "aabb", "ctrlspec")


def mjcf_of(model: mujoco.MjModel) -> str:
    """Return MJCF of a compiled model, flat: no classes, no files, every inertia as a number.

    A ValueError names what of the model it would not say.
    """
    if (model.geom_dataid >= 0).any() or (model.actuator_trntype > 1).any():
        raise ValueError("it cannot say meshes, height fields, and actuators but those of joints")
    spec = mujoco.MjSpec()
    spec.compiler.degree, spec.compiler.autolimits = False, False
    if hasattr(spec.compiler, "savecompiled"):  # else numbers are rounded, versions before 4.0 do
        spec.compiler.savecompiled = False
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    for name in _OPTIONS:
        setattr(spec.option, name, getattr(model.opt, name))
    _add_bodies(spec, model)
    _add_rest(spec, model)
    text = re.sub(r"<(geom|pair|joint) [^>]*>", _in_full, spec.to_xml())
    _check(mujoco.MjModel.from_xml_string(text), model)
    return text


def _in_full(element: re.Match[str]) -> str:
    """Return an element with all numbers of attributes, of which MuJoCo leaves out the last ones.

    It does if they are as by default, which other importers may take for 0.
    """
    sliding = (1, 1, 0.005, 0.0001, 0.0001)
    defaults = {"friction": sliding if element[1] == "pair" else sliding[1:4]}
    defaults |= {"solref": (0.02, 1), "solimp": (0.9, 0.95, 0.001, 0.5, 2)}

    def filled(attribute: re.Match[str]) -> str:
        given = attribute[3].split()
        rest = map(str, defaults[attribute[2]][len(given) :])
        return f'{attribute[1]}="{" ".join([*given, *rest])}"'

    return re.sub(r'\b((friction|solref|solimp)(?!loss)\w*)="([^"]*)"', filled, element[0])


def _add_bodies(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    made = {0: spec.worldbody}
    for body in range(1, model.nbody):
        parent = made[int(model.body_parentid[body])]
        made[body] = parent.add_body(name=_name(model, "body", body), **_row(model, "body", body))
        made[body].explicitinertial = bool(model.body_mass[body])
        made[body].mocap = bool(model.body_mocapid[body] >= 0)
    for joint, body in enumerate(model.jnt_bodyid):
        made[int(body)].add_joint(name=_name(model, "joint", joint), **_joint(model, joint))
    for geom, body in enumerate(model.geom_bodyid):
        made[int(body)].add_geom(name=_name(model, "geom", geom), **_row(model, "geom", geom))


def _add_rest(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    for pair in range(model.npair):
        ends = (_name(model, "geom", end[pair]) for end in (model.pair_geom1, model.pair_geom2))
        given = dict(zip(("geomname1", "geomname2"), ends, strict=True))
        spec.add_pair(**given, condim=int(model.pair_dim[pair]), **_row(model, "pair", pair))
    for signature in model.exclude_signature.tolist():
        ends = (_name(model, "body", each) for each in (signature >> 16, signature & 0xFFFF))
        spec.add_exclude(**dict(zip(("bodyname1", "bodyname2"), ends, strict=True)))
    for each in range(model.nu):
        target = _name(model, "joint", model.actuator_trnid[each, 0])
        given = {"target": target, "trntype": int(model.actuator_trntype[each])}
        name = _name(model, "actuator", each)
        spec.add_actuator(name=name, **given, **_row(model, "actuator", each))


def _name(model: mujoco.MjModel, kind: str, index: int) -> str:
    return getattr(model, kind)(int(index)).name or f"{kind}_{index}"


def _row(model: mujoco.MjModel, kind: str, index: int) -> dict[str, Any]:
    names = {"body": _BODY, "jnt": _JOINT, "geom": _GEOM, "pair": _PAIR, "actuator": _ACTUATOR}
    rows = {
        name: getattr(model, f"{kind}_{_CALLED.get(name, name)}")[index] for name in names[kind]
    }
    return {name: each.tolist() for name, each in rows.items()}


def _joint(model: mujoco.MjModel, joint: int) -> dict[str, Any]:
    """Return what a joint's element says: of its degrees of freedom, and where it is at rest."""
    dof, place, told = model.jnt_dofadr[joint], model.jnt_qposadr[joint], _row(model, "jnt", joint)
    for name in ("damping", "armature", "frictionloss"):
        told[name] = float(getattr(model, f"dof_{name}")[dof])
    told["stiffness"] = float(model.jnt_stiffness[joint])
    for name in ("solref", "solimp"):
        told[f"{name}_friction"] = getattr(model, f"dof_{name}")[dof]
    if model.jnt_type[joint] in (2, 3):
        told |= {"ref": model.qpos0[place], "springref": model.qpos_spring[place]}
    return told


def _check(made: mujoco.MjModel, meant: mujoco.MjModel) -> None:
    """Refuse a model that differs from another in what decides its motion."""
    names = [each for each in dir(meant) if each.startswith(_PHYSICS) and not _is_beside(each)]
    for name in (*names, "qpos0", "qpos_spring"):
        old, new = (getattr(each, name) for each in (meant, made))
        if not isinstance(old, np.ndarray):
            continue
        if old.shape != new.shape or not np.allclose(old, new, rtol=1e-9, atol=1e-12):
            raise ValueError(f"its MJCF cannot say {name}")


def _is_beside(name: str) -> bool:
    return any(each in name for each in _BESIDE)


# What a state has before it steps, as `forward` of adapters tells it, beside its contacts.
FORWARD = ("xpos", "xquat", "qfrc_bias", "qfrc_passive", "qfrc_actuator", "qacc_smooth",
           "qfrc_constraint", "qacc")  # fmt: skip
OF_CONTACTS = ("geom", "dist", "includemargin", "friction", "solref", "solimp", "pos")


def contact_rows(contact: Any) -> np.ndarray:
    """Return (K, 19) numbers of contacts.

    They are two geoms, distance, the one below which it acts, friction (5), solref (2), solimp (5)
    and position (3).
    """
    arrays = [np.asarray(getattr(contact, name), np.float64) for name in OF_CONTACTS]
    return np.hstack([each if each.ndim > 1 else each[:, None] for each in arrays])


def measured(model: mujoco.MjModel, state: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """Return (N, nsensordata) what MuJoCo measures in an engine's states before N steps."""
    data, sensors = mujoco.MjData(model), np.zeros((len(controls), model.nsensordata))
    for row, control in enumerate(controls):
        data.qpos[:], data.qvel[:], _ = np.split(state[row], [model.nq, model.nq + model.nv])
        data.ctrl[:] = control
        mujoco.mj_forward(model, data)
        sensors[row] = data.sensordata
    return sensors


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


def _pass_on(requests: SimpleQueue[dict[str, Any]]) -> None:
    """Pass on what is asked until the input ends, then end this process, whatever it computes.

    The input ends with the process that started this one, however that ended.
    """
    try:
        while True:
            requests.put(pickle.load(sys.stdin.buffer))  # noqa: S301 - from who started this
    finally:
        os._exit(0)


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
    requests = SimpleQueue[dict[str, Any]]()
    Thread(target=_pass_on, args=(requests,), daemon=True).start()
    while True:
        request = requests.get()
        try:
            answer(getattr(module, request["operation"])(request, lambda: answer(None)))
        except BrokenPipeError:
            return
        except Exception as error:  # noqa: BLE001 - told where it is known which runs it was
            answer(f"{type(error).__name__}: {' '.join(str(error).split())}")


if __name__ == "__main__":
    main(sys.argv[1])
