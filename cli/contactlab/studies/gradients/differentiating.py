"""Derivatives of a scene's end state at one place, or on a map of two axes."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from contactlab.engines import ENGINES
from contactlab.errors import EngineError, SweepFileError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.plan.grid import Plan
from contactlab.plan.overrides import Overrides
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.gradients import (
    GRADIENT_VERDICTS,
    REPORT,
    Band,
    GradientInput,
    GradientPlace,
    GradientsReport,
)
from contactlab.schema.setting_values import as_number, as_vector
from contactlab.step_progress import count_steps
from contactlab.store.table_layout import axis_cell
from contactlab.studies.gradients import automatic_differentiation
from contactlab.studies.gradients.automatic_differentiation import ADAPTIVE, ENGINE
from contactlab.studies.gradients.derivative_cache import DerivativeCache
from contactlab.studies.gradients.derivatives import (
    METHODS,
    Differentiation,
    judge_derivative,
    measure_influence,
)
from contactlab.studies.gradients.differences import PLAN, parameter_scale
from contactlab.studies.gradients.end_states import DifferentiatedScene, Parameter, Point
from contactlab.tasks.session import Session

STORE = "places"
_SWEEPS = {".yaml", ".yml"}
_BATCH_SIZE = 16  # places with runs that are made together
RUN = "run"


@dataclass(frozen=True)
class GradientsRequest:
    """The output coordinate, the inputs and the places of the derivatives."""

    source: str  # a sweep file with a map over its axes of several values; or a scene or model
    output_coordinate: str  # coordinate whose end value is differentiated
    # Axes and coordinates of the start; default: those of the map, or the scene and its contacts.
    inputs: Sequence[str] = ()
    assign: Sequence[str] = ()  # settings of every place, `NAME=VALUE` each
    include: Sequence[str] | None = None  # of `METHODS`; None is the chain, at one place
    tolerance: float = 0.1  # share of the model's derivative that may be missing
    refinement: int | None = None  # refinement factor of the reference; 4, or 2 on a map
    task: TaskOptions = AS_INFERRED


def differentiate_scene(request: GradientsRequest, session: Session) -> GradientsReport:
    """Differentiate, and judge where the derivatives can be used.

    The folder receives a store with a run of each place, `gradients.json`, and the derivatives,
    which let an interrupted study resume. Raises a SweepFileError if the sweep, a setting or a name
    is wrong; a SceneError if there is no such scene; an EngineError if a requested engine cannot
    differentiate; an OutputError if the folder cannot be written; a StoppedError if the session was
    stopped.
    """
    sweep = _read_sweep(request, session)
    axes = _map_axes(sweep.plan)
    subject = DifferentiatedScene.of(
        sweep.scene, request.output_coordinate, sweep.plan.sweep.duration, max(1, session.workers)
    )
    points = [Point(row.values, {}) for row in sweep.plan.iterate_rows()]  # each of the first seed
    is_map = bool(axes)
    chosen = request.include if request.include is not None else ([] if is_map else ["chain"])
    for name in chosen:
        SweepFileError.unless_known(name, METHODS, f"--include {name}: no such method")
    if differentiates := bool({ENGINE, ADAPTIVE} & {*chosen}):
        spec = subject.resolve(points[0])
        if why := automatic_differentiation.engine().refusal(sweep.scene, spec):
            raise EngineError(why)
    methods = {name: how for group in chosen for name, how in METHODS[group].items()}
    names = list(request.inputs) or [*axes] or _default_inputs(sweep.scene, subject, points[0])
    parameters = [subject.find_parameter(name) for name in names]
    for parameter, point in product(parameters, points):
        value = parameter.at(subject, point)  # raises an error before anything runs
        for reach in (-PLAN.wide_spans[0], PLAN.wide_spans[0]):
            parameter.with_value(point, value + float(reach) * parameter_scale(value))
    session.claim("gradients", request.source)
    store = session.run(sweep)
    finer = request.refinement or (2 if is_map else 4)
    how = Differentiation(subject, finer, methods, ladder=not is_map)
    cache = DerivativeCache.of(
        session,
        {
            "runs": [sweep.scene.run_id(subject.resolve(point)) for point in points],
            "of": (request.output_coordinate, finer, is_map, *methods),
            "by": (ENGINES[MODEL_ENGINE].version, automatic_differentiation.engine().version),
        },
    )
    derivatives = {
        each.name: _differentiate_all(how, each, points, cache)
        for each in count_steps(parameters, "inputs", len(parameters))
    }
    ends, modes = subject.end_values(points), subject.contact_modes(points)
    most = max(measure_influence(by) for inputs in derivatives.values() for by in inputs)
    places = tuple(
        GradientPlace(
            settings={name: axis_cell(value) for name, value in point.values.items()},
            end=ends[place],
            mode=modes[place],
            inputs={
                name: _with_verdicts(inputs[place], request.tolerance, most)
                for name, inputs in derivatives.items()
            },
        )
        for place, point in enumerate(points)
    )
    first = subject.resolve(points[0])
    notes = [f"the store has {store.columns.runs} runs, one per place"]
    solref = first.settings.get("solref")
    if solref is not None and 0 < as_vector(solref)[0] < 2 * first.timestep:
        notes.append(
            "refsafe raises the contact's time constant to two timesteps of the scene, so that "
            "finer timesteps simulate another model"
        )
    report = GradientsReport(
        source=request.source,
        scene=sweep.scene.name,
        scene_hash=sweep.scene.hash,
        mujoco=ENGINES[MODEL_ENGINE].version,
        engines={ENGINE: automatic_differentiation.engine().version} if differentiates else {},
        output_coordinate=request.output_coordinate,
        duration=first.duration,
        steps=(first.timestep, first.timestep / finer),
        tolerance=request.tolerance,
        axes=axes,
        places=places,
        bands=tuple(_find_bands(axes, places, [RUN, *methods])) if is_map else (),
        mode_switches=len(list(find_mode_switches(axes, places))),
        notes=tuple(notes),
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _read_sweep(request: GradientsRequest, session: Session) -> SweepRequest:
    path = Path(request.source)
    is_file = path.suffix in _SWEEPS
    source = path if is_file else {"version": 1, "scene": request.source}
    sweep = read_request(
        source,
        STORE,
        session.folder / STORE,
        folder=path.parent if is_file else Path(),
        workers=session.workers,
        overrides=Overrides(assign=(*request.assign, *request.task.settings)),
        drive=request.task.drive,
    )
    for run in sweep.plan.iterate_runs():
        spec = sweep.scene.resolve(run.values, run.seed, sweep.plan.sweep.duration)
        if spec.engine != MODEL_ENGINE:
            raise SweepFileError(f"engine {spec.engine}: only runs of MuJoCo are differentiated")
        if isinstance(spec.drive, PolicyDrive):
            raise SweepFileError("the drive is a policy; use a file of recorded controls instead")
        break
    return sweep


def _map_axes(plan: Plan) -> dict[str, tuple[float, ...]]:
    """Return the axes of a map; a SweepFileError says that they do not span one."""
    several = [axis for axis in plan.axes if axis.count > 1]
    most_axes = 2
    if len(several) > most_axes:
        names = ", ".join(axis.name for axis in several)
        raise SweepFileError(
            f"a map has two axes, but {names} have several values; fix some with --set"
        )
    try:
        axes = {axis.name: tuple(map(as_number, axis.values)) for axis in several}
    except TypeError as error:
        raise SweepFileError(f"the axes of a map must be numeric: {error}") from error
    rows = sum(1 for _ in plan.iterate_rows())
    if rows != np.prod([len(values) for values in axes.values()], dtype=int):
        raise SweepFileError("a map is the product of its axes; leave out exclude, include and zip")
    return axes


def _default_inputs(scene: Scene, subject: DifferentiatedScene, point: Point) -> list[str]:
    """Return the scene's own initial values, friction and stiffness of its contacts."""
    manifest = scene.source.manifest
    own = list(manifest.initial) if manifest else []
    spec = subject.resolve(point)
    if "solref" in spec.settings:
        standard = as_vector(spec.settings["solref"])[0] > 0
        own += ["friction.slide", "solref.timeconst" if standard else "solref.stiffness"]
    if not own:
        raise SweepFileError("name an input of the derivative: --input joint.v")
    return own


def _differentiate_all(
    how: Differentiation, parameter: Parameter, points: Sequence[Point], cache: DerivativeCache
) -> list[GradientInput]:
    inputs: list[GradientInput] = []
    batches = range(0, len(points), _BATCH_SIZE)
    for first in count_steps(batches, "batches of places", len(batches)):
        some = cache.get(parameter.name, first)
        if some is None:
            some = how.by(parameter, points[first : first + _BATCH_SIZE])
            cache.add(parameter.name, first, some)
        inputs += some
        if len(points) > 1:
            cache.session.notify(f"{parameter.name}: {len(inputs)} of {len(points)} places")
    return inputs


def _with_verdicts(by: GradientInput, tolerance: float, most: float) -> GradientInput:
    values = {RUN: by.run.value, **by.methods}
    verdicts = {
        name: judge_derivative(value, by, tolerance, most) for name, value in values.items()
    }
    return by.model_copy(update={"verdicts": verdicts})


def _find_bands(
    axes: Mapping[str, Sequence[float]], places: Sequence[GradientPlace], methods: Sequence[str]
) -> Iterator[Band]:
    shape = [len(values) for values in axes.values()]
    for parameter, name in product(places[0].inputs, methods):
        verdicts = [place.inputs[parameter].verdicts[name] for place in places]
        unusable = np.array([each != "agrees" for each in verdicts]).reshape(shape)
        counts_of_verdicts = Counter(verdicts)
        yield Band(
            parameter=parameter,
            method=name,
            counts={each: counts_of_verdicts[each] for each in GRADIENT_VERDICTS},
            share=float(unusable.mean()),
            widths={
                axis: float(unusable.sum(axis=number).mean())
                * ((max(values) - min(values)) / (len(values) - 1))
                for number, (axis, values) in enumerate(axes.items())
            },
        )


def find_mode_switches(
    axes: Mapping[str, Sequence[float]], places: Sequence[GradientPlace]
) -> Iterator[tuple[int, int]]:
    """Yield the neighbors on a map with different modes, by index."""
    shape = [len(values) for values in axes.values()]
    for number, place in enumerate(places):
        index = np.unravel_index(number, shape) if shape else ()
        for axis, at in enumerate(index):
            if at + 1 < shape[axis]:
                neighbor = number + int(np.prod(shape[axis + 1 :], dtype=int))
                if places[neighbor].mode != place.mode:
                    yield number, neighbor
