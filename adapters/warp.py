"""MuJoCo Warp in single precision, many worlds at once."""

import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

PACKAGE = "mujoco-warp"
REQUIREMENTS = ("mujoco-warp=={mujoco}", "mujoco=={mujoco}", "numpy")
OWN_LAWS = False
# What warp has no switch for: it stops at nothing, and looks at every pair.
_SWITCHES = ("AUTORESET", "MIDPHASE")
# What worlds may differ in: of a model's options, and of its arrays.
_OPTIONS = ("timestep", "tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance", "gravity",
            "wind", "density", "viscosity")  # fmt: skip
# What overflows of warp are called in MuJoCo's warnings; the others are of iterations.
_CONSTRAINTS = ("NEFC", "NJMAX_NNZ", "NVMAX")
_CONTACTS = ("BROADPHASE", "NARROWPHASE", "CCD", "HFIELD", "CONTACT_MATCH", "EPA_HORIZON")
DEVICES = ("cpu", "cuda")
_HEADROOM = 2  # buffers over MuJoCo's own peak, as its documentation advises


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    enabled, solver = int(model.opt.enableflags), int(model.opt.solver)
    for name in ("OVERRIDE", "FWDINV", "DIAGEXACT", "SPECULATIVE"):
        if enabled & getattr(mujoco.mjtEnableBit, f"mjENBL_{name}", 0):
            return f"it has no {name.lower()}; turn that off"
    if solver == mujoco.mjtSolver.mjSOL_PGS:
        return "it has no PGS; set solver to Newton or CG"
    discrete = getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", None)
    if model.opt.noslip_iterations and model.opt.integrator == discrete:
        return "it has no noslip with the discrete integrator; set noslip_iterations to 0"
    if model.nplugin:
        return "it runs no plug-ins of MuJoCo"
    return None


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs: as worlds of one launch where warp can tell them apart, else one by one."""
    return {name: np.stack(rows) for name, rows in _told(request, _launch, tick).items()}


def forward(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Tell what warp computes of the starts before it steps."""
    return _told(request, _forward, tick)


def _told(
    request: dict[str, Any], launch: Callable[..., dict[str, Any]], tick: Callable[[], None]
) -> dict[str, Any]:
    """Return what launches tell of all runs, each of those that may be worlds of one."""
    import serve
    import warp

    warp.config.quiet = True
    models = serve.models_of(request, *_SWITCHES)
    shared = {id(model): _shared(model) for model in _distinct(models)}
    launches: dict[bytes, list[int]] = {}
    for run, model in enumerate(models):
        launches.setdefault(shared[id(model)], []).append(run)
    found: dict[int, dict[str, Any]] = {}
    with warp.ScopedDevice(request["device"] or None):
        for runs in launches.values():
            told = launch(request, [models[run] for run in runs], runs, tick)
            found |= {run: {key: told[key][row] for key in told} for row, run in enumerate(runs)}
    return {key: [found[run][key] for run in range(len(models))] for key in found[0]}


def _distinct(models: list[mujoco.MjModel]) -> list[mujoco.MjModel]:
    return list({id(model): model for model in models}.values())


def _arrays(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    found = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {name: each for name, each in found.items() if isinstance(each, np.ndarray)}


def _options(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    opt = model.opt
    return {
        name: np.asarray(getattr(opt, name))
        for name in dir(opt)
        if not name.startswith("_") and isinstance(getattr(opt, name), (int, float, np.ndarray))
    }


def _batched() -> frozenset[str]:
    """Return the arrays of a model that each world may have for itself."""
    from mujoco_warp import Model

    notes = Model.__annotations__
    return frozenset(
        name for name, note in notes.items() if getattr(note, "shape", ())[:1] == ("*",)
    )


def _shared(model: mujoco.MjModel) -> bytes:
    """Return what all worlds of a launch must have in common, as bytes to compare."""
    own, options = _batched(), {*_OPTIONS, "impratio"}
    parts = {name: each for name, each in _arrays(model).items() if name not in own}
    parts |= {name: each for name, each in _options(model).items() if name not in options}
    return b"".join(
        name.encode() + np.ascontiguousarray(parts[name]).tobytes() for name in sorted(parts)
    )


def _launch(
    request: dict[str, Any], models: list[mujoco.MjModel], runs: list[int], tick: Callable[[], None]
) -> dict[str, np.ndarray]:
    """Simulate runs as the worlds of one launch."""
    import mujoco_warp

    first, count, steps = models[0], len(models), request["steps"]
    on_device, data, inputs = _worlds(request, models, runs)
    width = first.nq + first.nv + first.na
    state = np.empty((count, steps + 1, width))
    sensors = np.empty((count, steps, first.nsensordata))
    iterations, overflow = np.empty((count, steps), np.int32), np.zeros(count, np.int32)
    state[:, 0] = np.concatenate([request[name][runs] for name in ("qpos", "qvel", "act")], axis=1)
    begin, done = time.process_time(), 0
    for step in range(steps):
        inputs.set(data, step)
        mujoco_warp.step(on_device, data)
        parts = [each.numpy() for each in (data.qpos, data.qvel, data.act) if each.shape[1]]
        state[:, step + 1] = np.concatenate(parts, axis=1)
        sensors[:, step] = data.sensordata.numpy()
        iterations[:, step] = data.solver_niter.numpy()
        overflow |= data.overflow.numpy()
        if step == 0:
            # All before was compiling.
            begin = time.process_time()
            tick()
        elif (step + 1) * count // steps > done:
            done = (step + 1) * count // steps
            tick()
    cost = np.full(count, (time.process_time() - begin) / count)
    return {
        "state": state,
        "sensors": sensors,
        "iterations": iterations,
        "cost": cost,
        "contactfull": _any(overflow, _CONTACTS),
        "cnstrfull": _any(overflow, _CONSTRAINTS),
    }


def _forward(
    request: dict[str, Any], models: list[mujoco.MjModel], runs: list[int], tick: Callable[[], None]
) -> dict[str, Any]:
    """Compute the starts of runs as the worlds of one launch."""
    import mujoco_warp
    import serve
    from mujoco_warp._src.types import ContactType

    on_device, data, inputs = _worlds(request, models, runs)
    inputs.set(data, 0)
    mujoco_warp.forward(on_device, data)
    tick()
    told: dict[str, Any] = {name: getattr(data, name).numpy() for name in serve.FORWARD}
    # Beyond these there is what an earlier step, or a sensor, left.
    counted = np.arange(data.naconmax) < data.nacon.numpy()[0]
    acting = counted & ((data.contact.type.numpy() & ~int(ContactType.SENSOR)) != 0)
    rows, worlds = serve.contact_rows(_Numpy(data.contact)), data.contact.worldid.numpy()
    told["contacts"] = [rows[acting & (worlds == world)] for world in range(len(models))]
    return told


class _Numpy:
    """Arrays of the device, as NumPy's."""

    def __init__(self, arrays: Any) -> None:
        self._arrays = arrays

    def __getattr__(self, name: str) -> np.ndarray:
        return getattr(self._arrays, name).numpy()


def _worlds(
    request: dict[str, Any], models: list[mujoco.MjModel], runs: list[int]
) -> "tuple[Any, Any, _Inputs]":
    """Return the models and data of worlds on the device at their start, and what drives them."""
    import mujoco_warp
    import serve
    import warp

    first, (contacts, rows) = models[0], serve.peaks(request, models, runs)
    on_device = _put(mujoco_warp, warp, models)
    data = mujoco_warp.make_data(
        first, nworld=len(models), nconmax=_HEADROOM * contacts, njmax=_HEADROOM * rows
    )
    for name in ("qpos", "qvel", "ctrl", "act"):
        if request[name].shape[1]:
            getattr(data, name).assign(request[name][runs].astype(np.float32))
    return on_device, data, _Inputs(first, request, runs)


def _any(overflow: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return (n,) whether any of these overflowed in each world."""
    from mujoco_warp._src.types import OverflowType

    return (overflow & sum(OverflowType[name].value for name in names)) != 0


def _put(mujoco_warp: Any, warp: Any, models: list[mujoco.MjModel]) -> Any:
    """Return models on the device as one, with what they differ in for each world."""
    count, arrays = len(models), {id(each): _arrays(each) for each in _distinct(models)}
    first = arrays[id(models[0])]
    differing = {
        name: np.stack([arrays[id(each)][name] for each in models])
        for name in _batched() & first.keys()
        if any((each[name] != first[name]).any() for each in arrays.values())
    }
    made = mujoco_warp.put_model(models[0], batch_sizes=dict.fromkeys(differing, count))
    for name, values in differing.items():
        getattr(made, name).assign(values.astype(np.float32))
    for name in _OPTIONS:
        values = np.array([getattr(each.opt, name) for each in models], np.float32)
        if (values != values[0]).any():
            kind = warp.vec3 if values.ndim == 2 else float
            setattr(made.opt, name, warp.array(values, dtype=kind))
    ratios = np.array([each.opt.impratio for each in models])
    if (ratios != ratios[0]).any():
        made.opt.impratio_invsqrt = warp.array(
            (1 / np.sqrt(ratios)).astype(np.float32), dtype=float
        )
    return made


class _Inputs:
    """What drives the worlds: controls, forces on bodies and places of mocap bodies."""

    def __init__(self, model: mujoco.MjModel, request: dict[str, Any], runs: list[int]) -> None:
        names = ("ctrl", "applied", "mocap")
        self._values = np.concatenate([request[name][runs] for name in names], axis=1)
        self._places, self._levels = request["places"], request["levels"]
        self._runs, self._nu, self._bodies, self._mocap = runs, model.nu, model.nbody, model.nmocap

    def set(self, data: Any, step: int) -> None:
        """Set the inputs of a step; those that do not change are set at the first one."""
        if step and not len(self._places):
            return
        if len(self._places):
            self._values[:, self._places] = self._levels[self._runs, step]
        values, count = self._values.astype(np.float32), len(self._values)
        places = self._nu + 6 * self._bodies
        if self._nu:
            data.ctrl.assign(np.ascontiguousarray(values[:, : self._nu]))
        forces = values[:, self._nu : places]
        if forces.any() or step:
            data.xfrc_applied.assign(np.ascontiguousarray(forces.reshape(count, self._bodies, 6)))
        if self._mocap:
            split = places + 3 * self._mocap
            positions, turns = values[:, places:split], values[:, split:]
            data.mocap_pos.assign(np.ascontiguousarray(positions.reshape(count, -1, 3)))
            data.mocap_quat.assign(np.ascontiguousarray(turns.reshape(count, -1, 4)))
