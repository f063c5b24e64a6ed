"""Newton's importer of MJCF and its MuJoCo solver, in single precision."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

PACKAGE = "newton"
REQUIREMENTS = ("newton>=1.8,<2", "mujoco-warp=={mujoco}", "mujoco=={mujoco}", "numpy")
OWN_LAWS = False
DEVICES = ("cpu", "cuda")
_FREE, _BALL, _SLIDE, _HINGE = range(4)
_HEADROOM = 2  # memory over MuJoCo's own peak, as its documentation advises
_SWITCHES = ("AUTORESET", "MIDPHASE")  # which it does not have, and needs none of
_INTEGRATORS = ("EULER", "IMPLICIT", "IMPLICITFAST")


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    return next((why for applies, why in _refusals(model) if applies), None)


def _refusals(model: mujoco.MjModel) -> list[tuple[Any, str]]:
    """Return what it cannot do, each with whether a model needs it."""
    opt, kinds = model.opt, model.jnt_type
    integrators = [getattr(mujoco.mjtIntegrator, f"mjINT_{name}") for name in _INTEGRATORS]
    own = [int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0)) for name in _SWITCHES]
    later = (kinds[:-1] == _HINGE) & (kinds[1:] == _SLIDE) if model.njnt else np.zeros(0, bool)
    same = model.jnt_bodyid[:-1] == model.jnt_bodyid[1:]
    return [
        (
            opt.integrator not in integrators,
            "it integrates by Euler, implicit or implicitfast; set integrator to one of them",
        ),
        (
            opt.solver == mujoco.mjtSolver.mjSOL_PGS,
            "it has no PGS; set solver to Newton or CG",
        ),
        (
            opt.noslip_iterations,
            "it drops noslip; set noslip_iterations to 0",
        ),
        (
            opt.gravity[:2].any() or opt.gravity[2] > 0,
            "it has gravity along -z only; tilt the scene instead",
        ),
        (
            opt.disableflags & ~sum(own) or opt.enableflags,
            "it takes no flags of MuJoCo; leave them as they are by default",
        ),
        (
            (kinds == _BALL).any() or (later & same).any(),
            "it has other coordinates for ball joints, and for hinges before slides of a body",
        ),
        (
            (model.geom_dataid >= 0).any() or model.nflex or model.nplugin,
            "it gets no meshes, height fields, flexes and plug-ins here; take primitive shapes",
        ),
        (
            model.neq or model.ntendon or model.nmocap or model.na,
            "it gets no equalities, tendons, mocap bodies and activations here",
        ),
        (
            (model.actuator_trntype != int(mujoco.mjtTrn.mjTRN_JOINT)).any(),
            "it gets only actuators of joints here",
        ),
    ]


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other."""
    import serve

    return {name: np.array(rows) for name, rows in serve.of_each(request, _run, tick).items()}


def forward(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Tell what Newton's model computes of the starts before it steps."""
    import serve

    return serve.of_each(request, _forward, tick)


def _run(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import serve

    model = serve.model_of(request, run)
    controls = serve.inputs_of(request, run, model)[0]
    twin, begin = _twin(request, run), time.process_time()
    qpos, qvel, full = twin.run(request["qpos"][run], request["qvel"][run], controls)
    cost = time.process_time() - begin
    tick()
    state = np.hstack([qpos, qvel])
    sensors = serve.measured(model, state, controls)
    return {"state": state, "sensors": sensors, "cost": cost, "cnstrfull": full}


def _forward(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import mujoco_warp
    import serve

    model = serve.model_of(request, run)
    control = serve.inputs_of(request, run, model)[0][0]
    twin = _twin(request, run)
    solver, data = twin.solver, twin.solver.mjw_data
    for name, values in (("qpos", request["qpos"][run]), ("qvel", request["qvel"][run])):
        getattr(data, name).assign(values[None].astype(np.float32))
    if len(control):
        data.ctrl.assign(control[None].astype(np.float32))
    data.qacc_warmstart.zero_()
    mujoco_warp.forward(solver.mjw_model, data)
    tick()
    # On a CPU these are views of what the next state overwrites.
    told = {name: getattr(data, name).numpy()[0].copy() for name in serve.FORWARD}
    contacts = {name: getattr(data.contact, name).numpy() for name in serve.OF_CONTACTS}
    rows = serve.contact_rows(type("Contacts", (), contacts))[: data.nacon.numpy()[0]]
    rows[:, :2] = _geoms(model, solver.mj_model)[rows[:, :2].astype(int)]
    return {**told, "contacts": rows[rows[:, 2] < rows[:, 3]]}


_TWINS: dict[Any, Any] = {}


def _twin(request: dict[str, Any], run: int) -> Any:
    """Return Newton's model of a run, made once for runs that share one."""
    import serve
    import warp

    folder = str(Path(__file__).parent / "bundle")
    if folder not in sys.path:
        sys.path.append(folder)
    import check_newton

    if request["applied"][run].any() or len(request["mocap"][run]):
        raise NotImplementedError("no forces are applied to bodies here; drive by actuators")
    key = request["models"][run], request["device"]
    if key not in _TWINS:
        warp.config.quiet = True
        model = serve.model_of(request, run, *_SWITCHES)
        room = [_HEADROOM * each for each in serve.peaks(request, [model], [run])]
        mjcf, step = serve.mjcf_of(model), float(model.opt.timestep)
        device = request["device"] or None
        _TWINS.clear()
        # Several contacts of convex shapes: on by default in MuJoCo 4, off in Newton.
        many = hasattr(mujoco.mjtDisableBit, "mjDSBL_MULTICCD")
        _TWINS[key] = check_newton.Twin(mjcf, step, room, device, enable_multiccd=many)
    return _TWINS[key]


def _geoms(model: mujoco.MjModel, other: mujoco.MjModel) -> np.ndarray:
    """Return (ngeom,) the geom of a model that each of Newton's is, which has a number after it."""
    named = {model.geom(each).name or f"geom_{each}": each for each in range(model.ngeom)}
    names = [other.geom(each).name for each in range(other.ngeom)]
    return np.array([named[each.rpartition("/")[2].rpartition("_")[0]] for each in names])
