"""Fits settings to recorded runs, with intervals and profiles, and tests them on held-out runs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import ExpectationError, SceneError, SweepFileError, did_you_mean
from contactlab.plan.rows import sample_points
from contactlab.reporting.start_noise import PERTURBATION, noise_floor
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.scene.scene import Scene
from contactlab.schema.study_reports import FIT_REPORT, FITTED, FitReport, FittedSetting
from contactlab.schema.sweep_schema import Sample
from contactlab.schema.vocabulary import RECORDED_RUN, AxisSpec
from contactlab.store.table_layout import axis_cell
from contactlab.tasks.session import Session, Values, read_settings

FREE = ("friction.slide", "solref", "impratio", "cone")
"""Parameters that are fitted by default."""
_FITTED_PARTS = {
    "solref": ("solref.timeconst", "solref.dampratio")
}  # parameters that are fitted by their parts
_BOUNDS: Mapping[str, tuple[float, float]] = {
    "friction.slide": (0.02, 2.0),
    "solref.timeconst": (2e-3, 0.1),
    "solref.dampratio": (0.05, 3.0),
    "impratio": (1.0, 100.0),
}
"""Default bounds; numbers are searched on a log scale."""


@dataclass(frozen=True)
class FitBudget:
    """Points and runs of a fit.

    Attributes:
        screening_points, screening_runs: points that are screened, and the runs of each.
        retained_points: the best of these, which all fitted runs then judge.
        rounds, points_per_round, best_points: rounds of points around the best ones.
        profile_points: of each setting.
        resamplings: sets of runs that give the intervals.
    """

    screening_points: int = 64
    screening_runs: int = 30
    retained_points: int = 12
    rounds: int = 4
    points_per_round: int = 16
    best_points: int = 8
    profile_points: int = 7
    resamplings: int = 400


_BUDGET = FitBudget()


@dataclass(frozen=True)
class FitRequest:
    """Parameters to fit, and their scene."""

    scene: str
    free: Sequence[str] = FREE  # axes: NAME, or NAME=LOW:HIGH; axes of words take any of them
    assign: Sequence[str] = ()  # settings of all runs, NAME=VALUE
    fitted: int = 120  # recorded runs to fit; at most two thirds
    seed: int = 0  # selects the fitted runs
    metric: str = "reality"


@dataclass(frozen=True)
class _FitParameter:
    """A fitted setting, as a coordinate from 0 to 1: the logarithm between bounds, or a word."""

    spec: AxisSpec
    low: float = 0.0
    high: float = 0.0

    @classmethod
    def of(cls, scene: Scene, text: str) -> "_FitParameter":
        """Read a setting; a SweepFileError says why it is wrong."""
        name, _, bounds = text.partition("=")
        spec = scene.catalogue.find_axis(name)
        if spec is None:
            near = did_you_mean(name, scene.catalogue.names)
            raise SweepFileError(
                f"--free {name}: no such axis{near or '; `contactlab list axes SCENE` lists all'}"
            )
        if spec.choices:
            return cls(spec)
        try:
            low, high = map(float, bounds.split(":")) if bounds else _BOUNDS.get(name, (0.0, 0.0))
        except ValueError:
            low = high = 0.0
        if not 0 < low < high < math.inf:
            raise SweepFileError(f"--free {text}: write bounds above 0, such as {name}=0.1:10")
        return cls(spec, low, high)

    def value(self, place: float) -> object:
        """Return the canonical value at a place."""
        if words := self.spec.choices:
            return words[min(int(place * len(words)), len(words) - 1)]
        return self.spec.parse(float(f"{self.low * (self.high / self.low) ** place:.6g}"))


@dataclass
class _Trials:
    """Runs points, (d,) each, and stores those that were run on all fitted runs."""

    request: FitRequest
    session: Session
    scenes: SceneLoader
    knobs: Sequence[_FitParameter]
    fixed: Values
    fitted: Sequence[float]
    points: list[Floats] = field(default_factory=list[Floats])
    errors: list[Floats] = field(default_factory=list[Floats])
    runs: int = 0

    def values(self, point: Floats) -> dict[str, object]:
        """Return the settings at a point."""
        return {
            knob.spec.name: knob.value(place) for knob, place in zip(self.knobs, point, strict=True)
        }

    def run(self, name: str, settings: Sequence[Values], runs: Sequence[float]) -> Floats:
        """Return (points, runs) errors; a run that fails is as bad as the worst one."""
        request, names = self.request, list(settings[0])
        axes = {RECORDED_RUN: list(runs)} | {
            fixed: [axis_cell(y)] for fixed, y in self.fixed.items()
        }
        block = {
            parameter: [axis_cell(candidate[parameter]) for candidate in settings]
            for parameter in names
        }
        sweep = {"version": 1, "scene": request.scene, "axes": axes, "trace": "none"}
        sweep |= {"checks": "none", "zip": [block] if block else []}
        store = self.session.run_derived(name, sweep, self.scenes, resume=True)
        self.runs += store.columns.runs
        columns = store.columns.to_pydict([RECORDED_RUN, *names, request.metric])
        errors_by_key = {row[:-1]: row[-1] for row in zip(*columns.values(), strict=True)}
        keys = [[axis_cell(candidate[parameter]) for parameter in names] for candidate in settings]
        errors = np.array(
            [[errors_by_key[(run, *key)] for run in runs] for key in keys], np.float64
        )
        if np.isnan(errors).all():
            raise ExpectationError(f"no run of {request.scene} has a value of {request.metric}")
        return np.where(np.isnan(errors), np.nanmax(errors), errors)

    def keep(self, name: str, points: Floats) -> None:
        """Run points (m, d) on the fitted runs, and store them."""
        self.errors += list(self.run(name, [self.values(point) for point in points], self.fitted))
        self.points += list(points)

    def best(self, count: int) -> tuple[Floats, Floats]:
        """Return (count, d) the best points, the best one first, and (count, runs) their errors."""
        order = np.argsort([error.mean() for error in self.errors])[:count]
        return np.array(self.points)[order], np.array(self.errors)[order]


def fit_settings(request: FitRequest, session: Session) -> FitReport:
    """Fit settings to some recorded runs, and test them on the others.

    The folder receives the stores, `fit.json`, and the model with the settings. Raises a SceneError
    if the scene has no recording, or too few runs; a SweepFileError if a setting is wrong; an
    ExpectationError if no run can be measured; a StoppedError if the session was stopped; the same
    call resumes it.
    """
    scenes = SceneLoader(Path())
    scene = scenes.open(request.scene)
    numbers = scene.recorded.numbers if scene.recorded else ()
    if len(numbers) < 3:
        raise SceneError(f"{request.scene}: a fit needs a `recording` of three runs or more")
    fixed, _ = read_settings(scenes, request.scene, request.assign)
    knobs = [
        _FitParameter.of(scene, part)
        for word in request.free
        for part in _FITTED_PARTS.get(word, (word,))
    ]
    session.claim("fit", request.scene)
    order = np.random.default_rng(request.seed).permutation(numbers).tolist()
    count = min(request.fitted, 2 * len(order) // 3)
    trials = _Trials(request, session, scenes, knobs, fixed, order[:count])

    # Screen points with few runs, then draw points around the best of them.
    size, words = len(knobs), [bool(knob.spec.choices) for knob in knobs]
    points = sample_points(Sample(n=_BUDGET.screening_points, seed=request.seed), size)
    few = trials.fitted[: _BUDGET.screening_runs]
    screened = trials.run("screening", [trials.values(point) for point in points], few).mean(axis=1)
    trials.keep("kept", points[np.argsort(screened)[: _BUDGET.retained_points]])
    least_spread = 0.02  # smallest spread of a round's points, as a share of the bounds
    for number in range(_BUDGET.rounds):
        elite, _ = trials.best(_BUDGET.best_points)
        spread = np.maximum(elite.std(axis=0), least_spread)
        normal = np.random.default_rng([request.seed, number]).normal(
            size=(_BUDGET.points_per_round, size)
        )
        positions = np.clip(elite.mean(axis=0) + spread * normal, 0, 1)
        trials.keep(f"round-{number}", np.where(words, elite[0], positions))

    report = _make_report(trials, scene, order[count:])
    session.write({FIT_REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _make_report(trials: _Trials, scene: Scene, held_out: Sequence[float]) -> FitReport:
    (best, *_), (errors, *_) = trials.best(1)
    chosen = trials.values(best)
    (there,) = trials.run("held-out", [chosen], held_out)
    (current_errors,) = trials.run("as-written", [{}], held_out)
    rng = np.random.default_rng(trials.request.seed)
    mean_errors = there[rng.integers(len(there), size=(_BUDGET.resamplings, len(there)))].mean(
        axis=1
    )
    minima = _resampled_minima(trials)
    floor = None  # the mean change of a run's error by the start noise that a scene declares
    if (manifest := scene.source.manifest) is not None and manifest.perturb is not None:
        both = [{**chosen, PERTURBATION: factor} for factor in (0.0, 1.0)]
        errors_of_noise = trials.run("noise", both, held_out)
        floor = noise_floor(np.tile(np.arange(len(held_out)), 2), errors_of_noise.ravel())
    edits = ModelEdits({**trials.fixed, **chosen})
    return FitReport(
        scene=trials.request.scene,
        scene_hash=scene.hash,
        metric=trials.request.metric,
        settings=tuple(_fitted_setting(trials, best, place, minima) for place in range(len(best))),
        fitted_runs=tuple(sorted(trials.fitted)),
        fitted_error=float(errors.mean()),
        held_out={f"{run:g}": float(x) for run, x in zip(held_out, there, strict=True)},
        held_out_error=float(there.mean()),
        held_out_interval=tuple(np.percentile(mean_errors, [2.5, 97.5]).tolist()),
        current_error=float(current_errors.mean()),
        noise_floor=floor,
        lines=write_model(scene, edits, trials.session.folder / "fitted", FITTED).lines,
        runs=trials.runs,
    )


def _fitted_setting(trials: _Trials, best: Floats, place: int, minima: Floats) -> FittedSetting:
    """Return one setting at the best point (d,), with its interval and its profile."""
    knob = trials.knobs[place]
    name, count = knob.spec.name, len(knob.spec.choices) or _BUDGET.profile_points
    along = np.array([best[place], *np.linspace(0, 1, count)])
    points = np.where(np.arange(len(best)) == place, along[:, None], best)
    settings = list(
        {candidate[name]: candidate for candidate in map(trials.values, points)}.values()
    )
    errors = trials.run(f"profile-{name}", settings, trials.fitted[: 2 * _BUDGET.screening_runs])
    flat_rise = 0.1  # relative rise of the error that makes a profile informative
    alike = errors.mean(axis=1) <= (1 + flat_rise) * errors[0].mean()
    alike |= _is_as_good(errors)
    values = [axis_cell(setting[name]) for setting in settings]
    points, every = trials.best(len(trials.points))
    middle, *ends = np.percentile(minima[:, place], [50, 2.5, 97.5])
    # Resampling of few runs makes intervals too narrow.
    runs = every.shape[1]
    wider = _student_quantile(runs) / _student_quantile(math.inf) * math.sqrt(runs / (runs - 1))
    places = [
        *(middle + wider * (end - middle) for end in ends),
        *points[_is_as_good(every), place],
    ]
    equal_values = [knob.value(min(max(position, 0), 1)) for position in places]
    equal_values += [value for value, same in zip(values, alike, strict=True) if same]
    numbers = [value for value in equal_values if isinstance(value, float)]
    return FittedSetting(
        name=name,
        value=values[0],
        interval=(min(numbers), max(numbers)) if numbers else None,
        profile=dict(zip(map(str, values), errors.mean(axis=1).tolist(), strict=True)),
        identified=bool(alike[1:].mean() < 0.5),
    )


def _is_as_good(errors: Floats) -> NDArray[np.bool_]:
    """Return which of errors (m, runs) are as good as the first within the scatter of runs."""
    worse, runs = errors - errors[0], errors.shape[1]
    return worse.mean(axis=1) <= _student_quantile(runs) * worse.std(axis=1, ddof=1) / math.sqrt(
        runs
    )


def _student_quantile(runs: float) -> float:
    """Return the 97.5 % quantile of Student's t for a mean of runs, by Cornish and Fisher."""
    return 1.96 + 2.372 / (runs - 1) + 2.823 / (runs - 1) ** 2


def _resampled_minima(trials: _Trials) -> Floats:
    """Return (resampled, d) minima of a quadratic through the better points, by sets of runs.

    Without a minimum, it is the best point.
    """
    points, errors = trials.best(max(len(trials.points) // 2, _BUDGET.best_points))
    size, near = points.shape[1], points - points[0]
    first, second = np.triu_indices(size)
    design = np.hstack([np.ones((len(near), 1)), near, near[:, first] * near[:, second]])
    solve = np.linalg.pinv(design, rcond=1e-6)
    rng, minima = np.random.default_rng(trials.request.seed), list[Floats]()
    for _ in range(_BUDGET.resamplings):
        means = errors[:, rng.integers(errors.shape[1], size=errors.shape[1])].mean(axis=1)
        fit, curve = solve @ means, np.zeros((size, size))
        curve[first, second] = fit[1 + size :]
        curve += curve.T
        least = points[means.argmin()]
        if np.linalg.eigvalsh(curve)[0] > 0:
            least = points[0] - np.linalg.solve(curve, fit[1 : 1 + size])
        minima.append(np.clip(least, points.min(axis=0), points.max(axis=0)))
    return np.array(minima)
