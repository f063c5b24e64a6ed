"""Runs with a differentiated end: of a scene, with changed axes and initial coordinates."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import SLIDE, STICK, Floats
from contactlab.contact.trace_setup import pull_of
from contactlab.engines import ENGINES
from contactlab.engines.engine import Buffers, PreparedRuns, bytes_of_run
from contactlab.engines.mujoco_batch import last_states
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import SweepFileError, did_you_mean
from contactlab.measure.net_contact import net_contact
from contactlab.mjcf import MODEL_ENGINE
from contactlab.scene.model_edits import find_field
from contactlab.scene.model_names import STATE_PARTS, coordinate_indices, part_starts
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.setting_values import as_number, as_vector
from contactlab.tasks.session import Values

_MODES = {STICK: "stick", SLIDE: "slide"}
_QUATERNION = (".qw", ".qx", ".qy", ".qz")


@dataclass(frozen=True)
class Point:
    """One run: values by axis, and initial coordinates by their index."""

    values: Values
    changed_values: Mapping[int, float]

    def at_step(self, timestep: float) -> "Point":
        """Return the run with another timestep [s]."""
        return replace(self, values={**self.values, "timestep": timestep})


@dataclass(frozen=True)
class DifferentiatedScene:
    """A scene, and the coordinate with the differentiated end value."""

    scene: Scene
    place: int  # index of the coordinate in a row of `InitialStates`
    duration: float | None
    threads: int = 1
    seed: int = 0

    @property
    def model(self) -> mujoco.MjModel:
        """The scene's compiled model."""
        return self.scene.base({}).model

    @classmethod
    def of(
        cls, scene: Scene, name: str, duration: float | None, threads: int = 1
    ) -> "DifferentiatedScene":
        """Find the coordinate; a SweepFileError says that it is not one of the state."""
        model = scene.base({}).model
        end = part_starts(model)["act"]
        coordinate_places = {
            each: place for each, place in coordinate_indices(model).items() if place < end
        }
        if name not in coordinate_places:
            near = (
                did_you_mean(name, coordinate_places)
                or f"; write one of {', '.join(list(coordinate_places)[:8])}"
            )
            raise SweepFileError(
                f"--output-coordinate {name}: no such coordinate of the state{near}"
            )
        return cls(scene, coordinate_places[name], duration, threads)

    def resolve(self, point: Point) -> RunSpec:
        """Return the specification of a run, without the changed coordinates."""
        return self.scene.resolve(point.values, self.seed, self.duration)

    def prepare(self, points: Sequence[Point]) -> PreparedRuns:
        """Prepare runs of one structure and step count."""
        runs = PreparedRuns.of(self.scene, *map(self.resolve, points))
        if not any(point.changed_values for point in points):
            return runs
        # Write the changed coordinates into the starts.
        starts = runs.starts
        sizes = np.cumsum([getattr(starts, part).shape[1] for part in STATE_PARTS])[:-1]
        rows = np.concatenate([getattr(starts, part) for part in STATE_PARTS], axis=1)
        for row, point in zip(rows, points, strict=True):
            row[list(point.changed_values)] = list(point.changed_values.values())
        parts = np.split(rows, sizes, axis=1)
        return replace(runs, starts=starts._replace(**dict(zip(STATE_PARTS, parts, strict=True))))

    def find_parameter(self, name: str) -> "Parameter":
        """Return a parameter; a SweepFileError says that this name is unknown."""
        known_places = {
            each: place
            for each, place in coordinate_indices(self.model).items()
            if not each.endswith(_QUATERNION)
        }
        if name in known_places and name not in self.scene.catalogue.names:
            return Parameter(name, known_places[name], lambda value: value)
        spec = self.scene.catalogue.find_axis(name)
        if spec is None:
            some = (
                f"; write one of {', '.join(list(known_places)[:8])}, or of `contactlab list axes "
                "SCENE`"
            )
            near = did_you_mean(name, [*self.scene.catalogue.names, *known_places]) or some
            raise SweepFileError(f"--input {name}: no such axis or coordinate{near}")
        if name == "timestep" or spec.choices:
            raise SweepFileError(
                f"--input {name}: nothing is differentiated with respect to that; write an axis of "
                "numbers, as friction.slide, or a coordinate of the start"
            )
        return Parameter(name, None, spec.parse)

    def end_values(self, points: Sequence[Point]) -> Floats:
        """Return (n,) end values of the coordinate; NaN for an incomplete run."""
        ends = np.full(len(points), np.nan)
        for places, runs in self._group_points(points):
            last = last_states(runs.models, runs.starts, runs.steps, self.threads)
            ends[places] = last[:, self.place]
        return ends

    def contact_modes(self, points: Sequence[Point]) -> list[str]:
        """Return the modes of the pairs of each run, in order; see `measure.stick_slip`."""
        words = [""] * len(points)
        buffers = Buffers()
        for places, runs in self._group_points(points):
            rollout = ENGINES[MODEL_ENGINE].roll_out(runs, buffers)
            trace = make_trace(runs.base, runs.prepared, rollout)
            size = float(runs.base.model.stat.meansize)
            elliptic = np.array([bool(model.opt.cone) for model in runs.models])
            pull = pull_of(np.array([model.opt.gravity for model in runs.models]), size)
            net = net_contact(trace.pairs, pull, elliptic, trace.timestep, runs.steps)
            for row, place in enumerate(places):
                words[place] = "; ".join(
                    f"{pair.name}: {_mode_sequence(net.series.mode[number, row])}"
                    for number, pair in enumerate(runs.base.pairs)
                )
        return words

    def _group_points(self, points: Sequence[Point]) -> Iterator[tuple[list[int], PreparedRuns]]:
        """Yield runs of one structure and step count, with their indices."""
        resolved = [self.resolve(point) for point in points]

        def key(place: int) -> str:
            run = resolved[place]
            return json.dumps([run.structure, sorted(run.without), run.steps], sort_keys=True)

        for _, alike in groupby(sorted(range(len(points)), key=key), key):
            places = list(alike)
            first = resolved[places[0]]
            size = bytes_of_run(self.scene.base_of(first).model, first.steps)
            most_runs, most_bytes = 256, 64 << 20  # made together
            most = max(1, min(most_runs, most_bytes // size))
            for at in range(0, len(places), most):
                some = places[at : at + most]
                yield some, self.prepare([points[place] for place in some])


@dataclass(frozen=True)
class Parameter:
    """An input of the derivative."""

    name: str
    place: int | None  # index of an initial coordinate; None for an axis
    parse: Callable[[float], object]

    def at(self, subject: DifferentiatedScene, point: Point) -> float:
        """Return its value in a run; a SweepFileError says that it is not a number."""
        if self.place is not None:
            starts = subject.prepare([point]).starts
            row = np.concatenate([getattr(starts, part)[0] for part in STATE_PARTS])
            return float(row[self.place])
        run = subject.resolve(point)
        value = {**run.settings, **run.structure, **run.initial, **point.values}.get(self.name)
        whole = self.name.partition(".")[0]
        spec = subject.scene.catalogue.find_axis(whole)
        if value is None and spec is not None and spec.split and whole in run.settings:
            numbers = as_vector(run.settings[whole])
            # the friction of a pair has two sliding and two rolling coefficients
            value = spec.split(numbers[0:1] + numbers[2:4] if whole == "friction" else numbers)
            value = value.get(self.name)
        if value is None and (field_place := find_field(subject.model, self.name)):
            value = float(field_place[0][field_place[1]])
        try:
            return as_number(value)
        except TypeError:
            raise SweepFileError(
                f"--input {self.name}: it is no number of this scene; give it one with --set"
            ) from None

    def with_value(self, point: Point, value: float) -> Point:
        """Return a run with another value; a SweepFileError says that the value is not allowed."""
        if self.place is not None:
            return replace(point, changed_values={**point.changed_values, self.place: value})
        try:
            value_of_axis = self.parse(value)
        except ValueError as error:
            raise SweepFileError(
                f"--input {self.name}: {error}; take a place farther from its end"
            ) from error
        return replace(point, values={**point.values, self.name: value_of_axis})


def _mode_sequence(mode: np.ndarray) -> str:
    changed = np.flatnonzero(np.diff(mode, prepend=-1))
    return ", ".join(_MODES.get(int(mode[step]), "apart") for step in changed)
