"""The study: derivatives of a scene's end state at one place, or on a map of two axes."""

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
    GRADIENT_WORDS,
    Band,
    GradientBy,
    GradientPlace,
    GradientsReport,
)
from contactlab.schema.setting_values import as_number, as_vector
from contactlab.store.table_layout import as_written
from contactlab.studies.gradients import automatic
from contactlab.studies.gradients.automatic import ADAPTIVE, ENGINE
from contactlab.studies.gradients.derivatives import MEANS, Differentiation, influence, word
from contactlab.studies.gradients.differences import WIDE_SPANS, scale_of
from contactlab.studies.gradients.end_states import Parameter, Point, Subject
from contactlab.studies.gradients.kept_derivatives import KeptDerivatives
from contactlab.studies.session import Session

REPORT, STORE = "gradients.json", "places"
_SWEEPS = {".yaml", ".yml"}
_MOST_AXES = 2
_TOGETHER = 16  # places whose runs are made together
RUN = "run"


@dataclass(frozen=True)
class GradientsRequest:
    """What to differentiate, where, and by what."""

    source: str  # a sweep file, whose axes of several values span a map; else a scene or model
    of: str  # coordinate whose end is differentiated
    # Axes and coordinates of the start; if none, the map's, or the scene's own and of its contact.
    by: Sequence[str] = ()
    assign: Sequence[str] = ()  # settings of every place, `NAME=VALUE` each
    also: Sequence[str] | None = None  # of `MEANS`; None is the chain, at one place
    tolerance: float = 0.1  # share of the model's derivative that may be missing
    finer: int | None = None  # how many times finer the model is stepped; 4, on a map 2
    task: TaskOptions = AS_INFERRED


def run(request: GradientsRequest, session: Session) -> GradientsReport:
    """Differentiate, and say where that can be used.

    The folder receives a store with a run of each place, derivatives as they are made, from which
    the same question goes on, and `gradients.json`. Raises a
    SweepFileError if the sweep, a setting or a name is wrong; a SceneError if there is no such
    scene; an EngineError if one that was asked for cannot do it; an OutputError if the folder
    cannot be written; a StoppedError if the session was stopped.
    """
    sweep = _sweep(request, session)
    axes = _axes(sweep.plan)
    subject = Subject.of(
        sweep.scene, request.of, sweep.plan.sweep.duration, max(1, session.workers)
    )
    points = [Point(row.values, {}) for row in sweep.plan.rows()]  # each of the first seed
    is_map = bool(axes)
    chosen = request.also if request.also is not None else ([] if is_map else ["chain"])
    for name in chosen:
        SweepFileError.unless_known(name, MEANS, f"--also {name}: no such means")
    if differentiates := bool({ENGINE, ADAPTIVE} & {*chosen}):
        spec = subject.resolve(points[0])
        if why := automatic.engine().refusal(sweep.scene, spec):
            raise EngineError(why)
    means = {name: how for group in chosen for name, how in MEANS[group].items()}
    names = list(request.by) or [*axes] or _usual(sweep.scene, subject, points[0])
    parameters = [subject.parameter(name) for name in names]
    for parameter, point in product(parameters, points):
        value = parameter.at(subject, point)  # which says what is wrong, before anything runs
        for reach in (-WIDE_SPANS[0], WIDE_SPANS[0]):
            parameter.moved(point, value + float(reach) * scale_of(value))
    session.claim("gradients", request.source)
    store = session.run(sweep)
    finer = request.finer or (2 if is_map else 4)
    how = Differentiation(subject, finer, means, ladder=not is_map)
    kept = KeptDerivatives.of(
        session,
        {
            "runs": [sweep.scene.run_id(subject.resolve(point)) for point in points],
            "of": (request.of, finer, is_map, *means),
            "by": (ENGINES[MODEL_ENGINE].version, automatic.engine().version),
        },
    )
    derivatives = {each.name: _by(how, each, points, kept) for each in parameters}
    ends, modes = subject.end(points), subject.modes(points)
    most = max(influence(by) for found in derivatives.values() for by in found)
    places = tuple(
        GradientPlace(
            settings={name: as_written(value) for name, value in point.values.items()},
            end=float(ends[place]) if np.isfinite(ends[place]) else None,
            mode=modes[place],
            by={
                name: _worded(found[place], request.tolerance, most)
                for name, found in derivatives.items()
            },
        )
        for place, point in enumerate(points)
    )
    timestep = subject.resolve(points[0]).timestep
    report = GradientsReport(
        source=request.source,
        scene=sweep.scene.name,
        scene_hash=sweep.scene.hash,
        mujoco=ENGINES[MODEL_ENGINE].version,
        engines={ENGINE: automatic.engine().version} if differentiates else {},
        of=request.of,
        duration=subject.resolve(points[0]).duration,
        steps=(timestep, timestep / finer),
        tolerance=request.tolerance,
        axes=axes,
        places=places,
        bands=tuple(_bands(axes, places, [RUN, *means])) if is_map else (),
        switches=len(list(switches(axes, places))),
        notes=tuple(_notes(subject, points[0], store.columns.runs)),
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _sweep(request: GradientsRequest, session: Session) -> SweepRequest:
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
    for planned in sweep.plan.runs():
        spec = sweep.scene.resolve(planned.values, planned.seed, sweep.plan.sweep.duration)
        if spec.engine != MODEL_ENGINE:
            raise SweepFileError(f"engine {spec.engine}: derivatives are of MuJoCo's runs")
        if isinstance(spec.drive, PolicyDrive):
            raise SweepFileError("a policy drives it; drive it by a file of recorded controls")
        break
    return sweep


def _axes(plan: Plan) -> dict[str, tuple[float, ...]]:
    """Return the axes of a map; a SweepFileError says that they span none."""
    several = [axis for axis in plan.axes if axis.count > 1]
    if len(several) > _MOST_AXES:
        names = ", ".join(axis.name for axis in several)
        raise SweepFileError(f"a map has two axes; {names} have several values: fix some by --set")
    try:
        axes = {axis.name: tuple(map(as_number, axis.values)) for axis in several}
    except TypeError as error:
        raise SweepFileError(f"a map has axes of numbers: {error}") from error
    rows = sum(1 for _ in plan.rows())
    if rows != np.prod([len(values) for values in axes.values()], dtype=int):
        raise SweepFileError("a map is the product of its axes; leave out exclude, include and zip")
    return axes


def _usual(scene: Scene, subject: Subject, point: Point) -> list[str]:
    """Return the scene's own initial values, friction and stiffness of its contacts."""
    manifest = scene.source.manifest
    own = list(manifest.initial) if manifest else []
    spec = subject.resolve(point)
    if "solref" in spec.settings:
        standard = as_vector(spec.settings["solref"])[0] > 0
        own += ["friction.slide", "solref.timeconst" if standard else "solref.stiffness"]
    if not own:
        raise SweepFileError("name what to differentiate with respect to: --by joint.v")
    return own


def _by(
    how: Differentiation, parameter: Parameter, points: Sequence[Point], kept: KeptDerivatives
) -> list[GradientBy]:
    found: list[GradientBy] = []
    for first in range(0, len(points), _TOGETHER):
        some = kept.get(parameter.name, first)
        if some is None:
            some = how.by(parameter, points[first : first + _TOGETHER])
            kept.add(parameter.name, first, some)
        found += some
        if len(points) > 1:
            kept.session.notify(f"{parameter.name}: {len(found)} of {len(points)} places")
    return found


def _worded(by: GradientBy, tolerance: float, most: float) -> GradientBy:
    values = {RUN: by.run.value, **by.told}
    words = {name: word(value, by, tolerance, most) for name, value in values.items()}
    return by.model_copy(update={"words": words})


def _bands(
    axes: Mapping[str, Sequence[float]], places: Sequence[GradientPlace], means: Sequence[str]
) -> Iterator[Band]:
    shape = [len(values) for values in axes.values()]
    for parameter, name in product(places[0].by, means):
        words = [place.by[parameter].words[name] for place in places]
        unusable = np.array([each != "agrees" for each in words]).reshape(shape)
        counted = Counter(words)
        yield Band(
            parameter=parameter,
            means=name,
            counts={each: counted[each] for each in GRADIENT_WORDS},
            share=float(unusable.mean()),
            widths={
                axis: float(unusable.sum(axis=number).mean()) * _cell(values)
                for number, (axis, values) in enumerate(axes.items())
            },
        )


def _cell(values: Sequence[float]) -> float:
    return (max(values) - min(values)) / (len(values) - 1)


def switches(
    axes: Mapping[str, Sequence[float]], places: Sequence[GradientPlace]
) -> Iterator[tuple[int, int]]:
    """Yield the neighbours on a map whose modes differ, by their numbers."""
    shape = [len(values) for values in axes.values()]
    for number, place in enumerate(places):
        index = np.unravel_index(number, shape) if shape else ()
        for axis, at in enumerate(index):
            if at + 1 < shape[axis]:
                beside = number + int(np.prod(shape[axis + 1 :], dtype=int))
                if places[beside].mode != place.mode:
                    yield number, beside


def _notes(subject: Subject, point: Point, runs: int) -> Iterator[str]:
    yield f"{runs} runs, one of each place, are in the store"
    spec = subject.resolve(point)
    solref = spec.settings.get("solref")
    if solref is not None and 0 < as_vector(solref)[0] < 2 * spec.timestep:
        yield (
            "refsafe lengthens the contact's time constant to two steps of the scene's own, and "
            "finer steps are of another model"
        )
