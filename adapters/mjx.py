"""MuJoCo MJX, in double precision."""

import os
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

PACKAGE = "mujoco-mjx"
REQUIREMENTS = ("mujoco-mjx>=3.17,<5", "mujoco=={mujoco}", "jax[cpu]", "numpy")
OWN_LAWS = False
_SWITCHES = ("AUTORESET", "MIDPHASE")  # which it does not have, and needs none of
_INTEGRATORS = ("EULER", "RK4", "IMPLICITFAST")
_SOLVERS = ("CG", "NEWTON")
_SHORTEST, _SAME = 0.1, 1e-6  # substep over a step; share of a step that is none


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    opt = model.opt
    integrators = [getattr(mujoco.mjtIntegrator, f"mjINT_{name}") for name in _INTEGRATORS]
    if opt.integrator not in integrators:
        return "it integrates by Euler, RK4 or implicitfast; set integrator to one of them"
    if opt.solver not in [getattr(mujoco.mjtSolver, f"mjSOL_{name}") for name in _SOLVERS]:
        return "it has no PGS; set solver to Newton or CG"
    if opt.noslip_iterations:
        return "it has no noslip; set noslip_iterations to 0"
    for name in ("OVERRIDE", "FWDINV", "SLEEP", "DIAGEXACT", "SPECULATIVE", "IPC"):
        if opt.enableflags & getattr(mujoco.mjtEnableBit, f"mjENBL_{name}", 0):
            return f"it has no {name.lower()}; turn that off"
    if model.nplugin or model.nflex:
        return "it simulates neither plug-ins of MuJoCo nor flexes"
    return None


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other."""
    return {name: np.array(rows) for name, rows in _told(request, _run, tick).items()}


def forward(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Tell what MJX computes of the starts before it steps."""
    return _told(request, _forward, tick)


def derivative(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Tell how the end of each third run changes, by automatic differentiation in forward mode.

    The two after it are the run with a parameter above and below, `spread` apart: how models,
    starts and inputs change with it is their difference. With an `accuracy` above 0 runs are
    made by substeps, see `_controlled`.
    """
    import serve

    os.environ["JAX_ENABLE_X64"] = "1"
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    runs = range(0, len(request["models"]), 3)
    return {"change": np.array([_changed(request, run, tick, serve) for run in runs])}


def _changed(request: dict[str, Any], run: int, tick: Callable[[], None], serve: Any) -> np.ndarray:
    """Return (nq + nv + na) the derivative of a run's end."""
    import jax
    from mujoco import mjx

    accuracy, firsts = request["accuracy"], _firsts(request, run)
    lengths = np.diff([*firsts, request["steps"]])

    def leaves(number: int) -> tuple[list[Any], Any]:
        model = serve.model_of(request, number, *_SWITCHES)
        model.sensor_type[serve.energy_sensors(model)] = mujoco.mjtSensor.mjSENS_CLOCK
        data = serve.start_of(request, number, model)
        inputs = {name: rows[firsts] for name, rows in _inputs(request, number, model).items()}
        parts = mjx.put_model(model), mjx.put_data(model, data), (inputs, lengths)
        found, structure = jax.tree_util.tree_flatten(parts)
        return [jax.numpy.asarray(each) for each in found], structure

    (own, structure), (above, other), (below, _) = (leaves(run + each) for each in range(3))
    if structure != other:
        raise NotImplementedError("the parameter changes what is compiled here; take another")
    smooth = [number for number, each in enumerate(own) if each.dtype.kind == "f"]
    point = [own[number] for number in smooth]
    slope = [(above[number] - below[number]) / request["spread"] for number in smooth]
    rest = [None if number in smooth else each for number, each in enumerate(own)]
    key = structure, tuple((each.shape, str(each.dtype)) for each in own), accuracy
    if key not in _DERIVATIVES:

        def end(point: list[Any], rest: list[Any]) -> Any:
            whole, floats = list(rest), dict(zip(smooth, point, strict=True))
            whole = [floats.get(number, each) for number, each in enumerate(whole)]
            model, data, inputs = jax.tree_util.tree_unflatten(structure, whole)
            last = _last(model, data, inputs, accuracy)
            return jax.numpy.concatenate([last.qpos, last.qvel, last.act])

        _DERIVATIVES[key] = jax.jit(
            lambda point, slope, rest: jax.jvp(lambda each: end(each, rest), (point,), (slope,))
        )
    _flatten_roots()
    _, change = _DERIVATIVES[key](point, slope, rest)
    tick()
    return np.array(change)


def _flatten_roots() -> None:
    """Let a square root have the derivative 0 at 0, where it has none.

    MJX takes the root of a contact's force along its plane squared, which is 0 of what rests or
    meets it head-on, and multiplies what depends on it by 0 there: infinity times 0 is no number.
    """
    import jax
    from jax.interpreters import ad

    numpy, root = jax.numpy, jax.lax.sqrt_p

    def rule(values: Any, changes: Any, **how: Any) -> Any:
        (value,), (change,) = values, changes
        answer = root.bind(value, **how)
        if isinstance(change, ad.Zero):
            return answer, change
        return answer, numpy.where(answer > 0, change * 0.5 / numpy.where(answer > 0, answer, 1), 0)

    ad.primitive_jvps[root] = rule


_DERIVATIVES: dict[Any, Any] = {}


def _firsts(request: dict[str, Any], run: int) -> np.ndarray:
    """Return the steps from which on something else drives a run, or one of the two beside it.

    Without an accuracy these are all steps.
    """
    levels = request["levels"][run : run + 3]
    changed = (np.diff(levels, axis=1) != 0).any(axis=(0, 2)) | (not request["accuracy"])
    return np.concatenate([[0], np.flatnonzero(changed) + 1])


def _stepped(model: Any, data: Any, inputs: dict[str, Any]) -> tuple[Any, tuple[Any, ...]]:
    import jax
    from mujoco import mjx

    stepped = mjx.step(model, data.replace(**inputs))
    # A loop wants the types that it began with.
    data = jax.tree_util.tree_map(lambda old, new: new.astype(old.dtype), data, stepped)
    return data, (data.qpos, data.qvel, data.act, data.sensordata)


def _last(model: Any, data: Any, inputs: tuple[dict[str, Any], Any], accuracy: float) -> Any:
    """Return the data at the end of a run: by its steps, or by substeps of an accuracy.

    The inputs are those of stretches of so many steps each in which they stay; without an accuracy
    a stretch is a step.
    """
    import jax

    if not accuracy:
        return jax.lax.scan(lambda now, each: _stepped(model, now, each), data, inputs[0])[0]
    (last, _), _ = jax.lax.scan(
        lambda now, each: (_controlled(model, *now, *each, accuracy), None),
        (data, model.opt.timestep),
        inputs,
    )
    return last


def _controlled(
    model: Any, data: Any, size: Any, inputs: dict[str, Any], steps: Any, accuracy: float
) -> tuple[Any, Any]:
    """Return the data some steps later, by substeps of a step at most, and the size of the next.

    A substep is made at once and in two halves, which are taken. It is made again, shorter, if they
    part by more than the accuracy, over one plus the size of each coordinate and velocity, and if a
    contact is made before its end: then it ends there. Sizes are constants to a derivative, but for
    this: when a contact is made changes with the parameter, and what follows is made as much later.
    What comes slower than the root of the accuracy changes speeds by little: what hops as it slides
    would end substeps without end. None but those that end at a contact is below a tenth of a step.
    """
    import jax
    from mujoco import mjx

    numpy, longest = jax.numpy, model.opt.timestep
    whole, least = steps * longest, _SHORTEST * longest
    data = data.replace(**inputs)

    def by(data: Any, size: Any) -> Any:
        stepped = mjx.step(model.tree_replace({"opt.timestep": size}), data)
        return jax.tree_util.tree_map(lambda old, new: new.astype(old.dtype), data, stepped)

    def attempt(now: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        data, at, size = now
        size = numpy.minimum(numpy.minimum(size, longest), whole - at)
        once, twice = by(data, size), by(by(data, size / 2), size / 2)
        parted = [
            numpy.abs(one - other) / (1 + numpy.abs(other))
            for one, other in ((once.qpos, twice.qpos), (once.qvel, twice.qvel))
        ]
        error = numpy.maximum(numpy.concatenate(parted).max() / accuracy, 1e-6)
        after = jax.lax.stop_gradient(size * numpy.clip(0.9 * error**-0.5, 0.2, 5.0))
        # Distances are of the states before a step: of the start, and of the half.
        start, half = (_gaps(each) for each in (once, twice))
        comes = start - half > accuracy**0.5 * size / 2
        share = start / numpy.where(comes, start - half, 1.0)
        share = numpy.where(comes & (start > 0) & (share < 2), share, numpy.inf)
        touch = size / 2 * share.min(initial=numpy.inf)
        early = (touch > _SAME * longest) & (touch < (1 - _SAME) * size)
        taken = ~early & (~(error > 1) | (size <= least))  # what is no number ends the run
        data = jax.tree_util.tree_map(lambda old, new: numpy.where(taken, new, old), data, twice)
        after = numpy.where(early, touch, numpy.maximum(after, least))
        return data, at + numpy.where(taken, size, 0.0), after

    data, _, size = jax.lax.while_loop(
        lambda now: now[1] < whole - _SAME * longest, attempt, (data, 0.0 * whole, size)
    )
    return data, size


def _gaps(data: Any) -> Any:
    """Return how far each contact is from where it begins to act [m]."""
    contact = data._impl.contact
    return contact.dist - contact.includemargin


def _told(
    request: dict[str, Any], tell: Callable[..., dict[str, Any]], tick: Callable[[], None]
) -> dict[str, Any]:
    import serve

    os.environ["JAX_ENABLE_X64"] = "1"
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    return serve.of_each(request, tell, tick)


_FORWARDS: dict[bytes, Any] = {}


def _forward(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import jax
    import serve
    from mujoco import mjx

    binary = request["models"][run]
    if binary not in _FORWARDS:
        made = serve.model_of(request, run, *_SWITCHES)
        made.sensor_type[serve.energy_sensors(made)] = mujoco.mjtSensor.mjSENS_CLOCK
        _FORWARDS[binary] = made, mjx.put_model(made), jax.jit(mjx.forward)
    model, on_device, compute = _FORWARDS[binary]
    data = compute(on_device, mjx.put_data(model, serve.start_of(request, run, model)))
    tick()
    told = {name: np.array(getattr(data, name)) for name in serve.FORWARD}
    # It has a row for every contact that there may be.
    rows = serve.contact_rows(data._impl.contact)
    return {**told, "contacts": rows[rows[:, 2] < rows[:, 3]]}


def _run(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import jax
    import serve
    from mujoco import mjx

    model = serve.model_of(request, run, *_SWITCHES)
    kinds = model.sensor_type.copy()
    # A sensor that it has stands in for those of energy, which it has not.
    model.sensor_type[serve.energy_sensors(model)] = mujoco.mjtSensor.mjSENS_CLOCK
    data = serve.start_of(request, run, model)
    on_device, first = mjx.put_model(model), mjx.put_data(model, data)
    inputs = jax.tree_util.tree_map(jax.numpy.asarray, _inputs(request, run, model))
    scan = _compiled(on_device, first, inputs)
    begin = time.process_time()
    _, told = scan(on_device, first, inputs)
    qpos, qvel, act, sensors = (np.array(each, np.float64) for each in told)
    cost = time.process_time() - begin
    tick()
    start = np.concatenate([data.qpos, data.qvel, data.act])
    state = np.concatenate([start[None], np.concatenate([qpos, qvel, act], axis=1)])
    model.sensor_type[:] = kinds
    serve.add_energies(model, state, sensors)
    return {"state": state, "sensors": sensors, "cost": cost}


_SCANS: dict[Any, Any] = {}


def _compiled(*arguments: Any) -> Any:
    """Return a compiled loop over steps, the same for models of one structure."""
    import jax

    def scan(model: Any, data: Any, inputs: dict[str, Any]) -> Any:
        return jax.lax.scan(lambda now, each: _stepped(model, now, each), data, inputs)

    leaves, structure = jax.tree_util.tree_flatten(arguments)
    key = structure, tuple((each.shape, str(each.dtype)) for each in leaves)
    if key not in _SCANS:
        _SCANS[key] = jax.jit(scan).lower(*arguments).compile()
    return _SCANS[key]


def _inputs(request: dict[str, Any], run: int, model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Return what drives each step: controls, and forces and mocap bodies where they change."""
    import serve

    controls, forces, rows = serve.inputs_of(request, run, model)
    given = {"ctrl": controls}
    if (request["places"] >= model.nu).any():
        given["xfrc_applied"] = forces
    if (request["places"] >= model.nu + 6 * model.nbody).any():
        places = [serve.mocap(row, model.nmocap) for row in rows]
        given["mocap_pos"], given["mocap_quat"] = map(np.array, zip(*places, strict=True))
    return given
