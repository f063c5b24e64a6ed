"""Settings that explain recorded runs: searched, with intervals and profiles, tried on others."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import ExpectationError, SceneError, SweepFileError
from contactlab.plan.rows import sample_points
from contactlab.run.evidence_record import as_written
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.schema.fit_report import MODEL, REPORT, FitReport, FittedSetting
from contactlab.schema.sweep_schema import Sample
from contactlab.schema.vocabulary import RECORDED_RUN, AxisSpec
from contactlab.studies.session import Session, Values, read_settings

_BOUNDS: Mapping[str, tuple[float, float]] = {
    "friction.slide": (0.02, 2.0),
    "solref.timeconst": (2e-3, 0.1),
    "solref.dampratio": (0.05, 3.0),
    "impratio": (1.0, 100.0),
}
"""Bounds where none are given; values are searched by their logarithm."""
_SCREENED, _SCREENING, _KEPT = 64, 30, 12  # points that few runs screen, how many, and what is left
_ROUNDS, _DRAWN, _ELITE = 4, 16, 8  # rounds of points around the best ones
_LEAST_SPREAD = 0.02  # of a round's points, as a share of the bounds
_PROFILE, _RESAMPLED = 7, 400  # points of a profile; resampled sets of runs
_DIGITS = 6


@dataclass(frozen=True)
class FitRequest:
    """What of which scene to fit."""

    scene: str
    free: Sequence[str]  # axes: NAME, or NAME=LOW:HIGH; axes of words as they are
    assign: Sequence[str] = ()  # settings of all runs, NAME=VALUE
    fitted: int = 120  # recorded runs to fit; at most two of three
    seed: int = 0  # which runs are fitted
    error: str = "reality"


@dataclass(frozen=True)
class _Knob:
    """A free setting, as a coordinate from 0 to 1: the logarithm between bounds, or a word."""

    spec: AxisSpec
    low: float = 0.0
    high: float = 0.0

    def value(self, place: float) -> object:
        """Return the value at a place."""
        if words := self.spec.choices:
            return words[min(int(place * len(words)), len(words) - 1)]
        return float(f"{self.low * (self.high / self.low) ** place:.{_DIGITS}g}")


@dataclass
class _Trials:
    """Runs points, and keeps what was found of those that were run on all fitted runs."""

    request: FitRequest
    session: Session
    scenes: SceneLoader
    knobs: Sequence[_Knob]
    fixed: Values
    points: list[Floats] = field(default_factory=list[Floats])
    errors: list[Floats] = field(default_factory=list[Floats])
    runs: int = 0

    def values(self, point: Floats) -> dict[str, object]:
        """Return the settings at a point (d,)."""
        return {each.spec.name: each.value(x) for each, x in zip(self.knobs, point, strict=True)}

    def run(self, name: str, settings: Sequence[Values], runs: Sequence[float]) -> Floats:
        """Return (points, runs) errors; a run that fails is as bad as the worst one."""
        names = list(settings[0])
        sweep: dict[str, object] = {
            "version": 1,
            "scene": self.request.scene,
            "axes": {RECORDED_RUN: list(runs)}
            | {x: [as_written(y)] for x, y in self.fixed.items()},
            "zip": [{x: [each[x] for each in settings] for x in names}] if names else [],
            "trace": "none",
            "checks": "none",
        }
        store = self.session.run_derived(name, sweep, self.scenes, resume=True)
        self.runs += store.columns.runs
        keys = [RECORDED_RUN, *names, self.request.error]
        rows = zip(*store.columns.to_pydict(keys).values(), strict=True)
        found = {row[:-1]: math.nan if row[-1] is None else row[-1] for row in rows}
        errors = np.array(
            [[found[(run, *each.values())] for run in runs] for each in settings], np.float64
        )
        if np.isnan(errors).all():
            raise ExpectationError(f"no run of {self.request.scene} has a {self.request.error}")
        return np.where(np.isnan(errors), np.nanmax(errors), errors)

    def add(self, name: str, points: Floats, runs: Sequence[float]) -> None:
        """Run points (m, d) on the fitted runs, and keep them."""
        self.errors += list(self.run(name, [self.values(each) for each in points], runs))
        self.points += list(points)

    @property
    def best(self) -> list[int]:
        """The points that were kept, the best one first."""
        return np.argsort([each.mean() for each in self.errors]).tolist()


def run(request: FitRequest, session: Session) -> FitReport:
    """Fit settings to some recorded runs, and try them on the others.

    The folder receives the stores, `fit.json`, and the model with the settings. Raises a SceneError
    if the scene has no recording, or too few runs; a SweepFileError if a setting is wrong; an
    ExpectationError if no run can be measured; a StoppedError if the session was stopped: the same
    call resumes it.
    """
    scenes = SceneLoader(Path())
    scene = scenes.open(request.scene)
    numbers = scene.recorded.numbers if scene.recorded else ()
    if len(numbers) < 3:
        raise SceneError(f"{request.scene}: a fit needs a `recording` of three runs or more")
    session.claim("fit", request.scene)
    fixed, _ = read_settings(scenes, request.scene, request.assign)
    knobs = [_knob(scenes, request.scene, each) for each in _unfolded(request.free)]
    trials = _Trials(request, session, scenes, knobs, fixed)
    order = np.random.default_rng(request.seed).permutation(numbers).tolist()
    count = min(request.fitted, 2 * len(order) // 3)
    fitted, held_out = order[:count], order[count:]
    _search(trials, fitted, request.seed)
    return _reported(trials, fitted, held_out)


def _unfolded(free: Sequence[str]) -> list[str]:
    """Return what is free, each by its own name: `solref` is a time constant and a damping ratio."""
    both = {"solref": ("solref.timeconst", "solref.dampratio")}
    return [name for each in free for name in both.get(each, (each,))]


def _knob(scenes: SceneLoader, scene: str, text: str) -> _Knob:
    name, _, bounds = text.partition("=")
    spec = scenes.open(scene).catalogue.find(name)
    if spec is None:
        raise SweepFileError(f"--free {name}: no such axis; `contactlab scenes {scene}` lists all")
    if spec.choices:
        return _Knob(spec)
    try:
        given = (
            tuple(float(each) for each in bounds.split(":")) if bounds else _BOUNDS.get(name, ())
        )
        low, high = given
    except ValueError:
        low = high = 0.0
    if not 0 < low < high < math.inf:
        raise SweepFileError(f"--free {text}: write bounds above 0, such as {name}=0.1:10")
    return _Knob(spec, low, high)


def _search(trials: _Trials, fitted: Sequence[float], seed: int) -> None:
    """Screen points all over with few runs; then draw points around the best of those left."""
    size = len(trials.knobs)
    points = sample_points(Sample(n=_SCREENED, seed=seed), size)
    screened = trials.run("screening", [trials.values(x) for x in points], fitted[:_SCREENING])
    best = np.argsort(screened.mean(axis=1))[:_KEPT]
    trials.add("kept", points[best], fitted)
    for number in range(_ROUNDS):
        rng = np.random.default_rng([seed, number])
        elite = np.array([trials.points[each] for each in trials.best[:_ELITE]])
        spread = np.maximum(elite.std(axis=0), _LEAST_SPREAD)
        drawn = np.clip(elite.mean(axis=0) + spread * rng.normal(size=(_DRAWN, size)), 0, 1)
        for place, knob in enumerate(trials.knobs):
            if knob.spec.choices:
                drawn[:, place] = elite[0, place]
        trials.add(f"round-{number}", drawn, fitted)


def _reported(trials: _Trials, fitted: Sequence[float], held_out: Sequence[float]) -> FitReport:
    request, session, scene = (
        trials.request,
        trials.session,
        trials.scenes.open(trials.request.scene),
    )
    best = trials.points[trials.best[0]]
    chosen = trials.values(best)
    (there,) = trials.run("held-out", [chosen], held_out)
    (written,) = trials.run("as-written", [{}], held_out)
    rng = np.random.default_rng(request.seed)
    drawn = rng.integers(len(there), size=(_RESAMPLED, len(there)))
    low, high = np.percentile(there[drawn].mean(axis=1), [2.5, 97.5]).tolist()
    settings = tuple(_fitted(trials, fitted, best, place) for place in range(len(best)))
    parsed = {each.spec.name: each.spec.parse(chosen[each.spec.name]) for each in trials.knobs}
    edits = ModelEdits({**trials.fixed, **parsed})
    lines = write_model(scene, edits, session.folder / "fitted", MODEL).lines
    report = FitReport(
        scene=request.scene,
        scene_hash=scene.hash,
        error=request.error,
        settings=settings,
        fitted_runs=tuple(sorted(fitted)),
        held_out=tuple(sorted(held_out)),
        fitted_error=float(trials.errors[trials.best[0]].mean()),
        held_out_error=float(there.mean()),
        held_out_interval=(low, high),
        written_error=float(written.mean()),
        run_errors={f"{run:g}": float(x) for run, x in zip(held_out, there, strict=True)},
        lines=lines,
        runs=trials.runs,
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _fitted(trials: _Trials, fitted: Sequence[float], best: Floats, place: int) -> FittedSetting:
    """Return one setting at the best point, with its interval and its profile."""
    knob = trials.knobs[place]
    name, words = knob.spec.name, knob.spec.choices
    count = len(words) or _PROFILE
    places = [best[place], *((k + 0.5) / count if words else k / (count - 1) for k in range(count))]
    settings = [trials.values(np.where(np.arange(len(best)) == place, x, best)) for x in places]
    distinct = list({each[name]: each for each in settings}.values())
    errors = trials.run(f"profile-{name}", distinct, fitted[: 2 * _SCREENING])
    worse = errors - errors[0]
    # Twice the standard error of the mean of paired differences.
    alike = worse.mean(axis=1) <= 2 * worse.std(axis=1) / math.sqrt(worse.shape[1])
    ends = np.percentile(_minima(trials)[:, place], [2.5, 97.5])
    low, high = (None, None) if words else (float(knob.value(end)) for end in ends)
    return FittedSetting(
        name=name,
        value=as_written(distinct[0][name]),
        low=low,
        high=high,
        profile={
            f"{each[name]:g}" if isinstance(each[name], float) else str(each[name]): float(x)
            for each, x in zip(distinct, errors.mean(axis=1), strict=True)
        },
        identified=bool(alike[1:].mean() < 0.5),
    )


def _minima(trials: _Trials) -> Floats:
    """Return (resampled, d) where a quadratic through the better points is least, by sets of runs.

    Where it has no minimum, it is the best point.
    """
    better = trials.best[: max(len(trials.best) // 2, _ELITE)]
    points = np.array([trials.points[each] for each in better])
    errors = np.array([trials.errors[each] for each in better])
    size, centre = points.shape[1], points[0]
    first, second = np.triu_indices(size)
    near = points - centre
    design = np.hstack([np.ones((len(near), 1)), near, near[:, first] * near[:, second]])
    solve = np.linalg.pinv(design, rcond=1e-6)
    rng, minima = np.random.default_rng(trials.request.seed), list[Floats]()
    for _ in range(_RESAMPLED):
        means = errors[:, rng.integers(errors.shape[1], size=errors.shape[1])].mean(axis=1)
        fit = solve @ means
        curve = np.zeros((size, size))
        curve[first, second] = fit[1 + size :]
        curve += curve.T
        least = points[means.argmin()]
        if np.linalg.eigvalsh(curve)[0] > 0:
            least = centre - np.linalg.solve(curve, fit[1 : 1 + size])
        minima.append(np.clip(least, points.min(axis=0), points.max(axis=0)))
    return np.array(minima)
