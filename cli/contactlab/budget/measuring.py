"""Measures the error budget of one phase."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from hashlib import blake2b
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.constraint_energy import ConstraintEnergy
from contactlab.budget.defects import (
    energy_defects,
    find_drift,
    measure_defects,
    measure_paths,
    settle_defects,
    slack_share,
    to_the_limit,
)
from contactlab.budget.exercised_rows import exercised_rows
from contactlab.budget.force_places import (
    Impulses,
    Stretch,
    find_force_place,
    sum_impulses,
)
from contactlab.budget.motion import GRAVITY_AS_REAL, Motion, measure_pulls, without_delays
from contactlab.budget.readings import Origin, PhaseBudget, Reading
from contactlab.budget.restarts import build_reference_model, run_at_once, scale_of_impulses
from contactlab.budget.windows import (
    EngineWarning,
    Observer,
    Run,
    Windows,
    body_name,
    changes_of,
    gyration_radii,
    judged_bodies,
    replay_motion,
    split_windows,
    without_sensors,
)
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import EngineError
from contactlab.modifications.model_predicates import (
    is_disabled,
    raises_time_constants,
    read_gravity,
)
from contactlab.modifications.modification import ModelChange, Row
from contactlab.modifications.numerics import RUN
from contactlab.scene.model_edits import has_step_factors, set_timestep

WINDOW = 0.04  # s; docs/theory/error-budget.md compares others
FINER = 4
# Steps of RK4 per step of the run; RK4 shows energy that both run and reference lose.
_RK4_RATE = 2
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_DISCRETE = int(getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", -1))


@dataclass(frozen=True)
class Settings:
    """How a budget is measured.

    Attributes:
        window: about how long windows are [s]; they have whole steps.
        finer: steps of the reference in one of the run.
        check: whether windows are also gone through with twice the reference's steps. Without,
            nothing tells whether the reference is resolved, and shares are those at h/4.
        energy: whether a second reference, with RK4, shows energy that both lose.
        places: whether it is looked for where forces differ most.
        excess: whether the run's own path is measured; if not, its excess and its peak are NaN.
        measures_time: whether the change of each row is timed, in the phase with its largest
            reading.
        workers: threads.
    """

    window: float = WINDOW
    finer: int = FINER
    check: bool = True
    energy: bool = True
    places: bool = True
    excess: bool = True
    measures_time: bool = False
    workers: int = 1


def count_evaluations(
    model: mujoco.MjModel,
    settings: Settings,
    rows: Iterable[Row] = (),
    *,
    drifts: bool = False,
) -> float:
    """Return about how many of a model's steps a budget makes for one of the run.

    A step of RK4 is four of another integrator. `drifts` says whether energy is known to drift
    against it, which is looked at again at half its step.
    """
    finer, smooth = settings.finer, settings.energy and model.opt.integrator != _RK4
    looks = _RK4_RATE * (3 if drifts else 1)
    run_count = finer * (1 + 2 * settings.check) + 4 * looks * smooth
    return run_count + sum(_count_row_evaluations(row, finer) for row in (RUN, *rows))


def _count_row_evaluations(row: Row, finer: int) -> int:
    rate = finer if row.base == "reference" else 1
    return rate * (len(row.changes) + (row.both is not None))


def steps_of(motions: Iterable[Motion]) -> int:
    """Return how many steps motions have, of all their seeds."""
    return sum(motion.seeds * motion.steps for motion in motions)


class PhaseMeasure:
    """Measures one phase: by a first look, where that tells enough, and whole."""

    def __init__(
        self,
        motion: Motion,
        rows_to_measure: Sequence[Row],
        settings: Settings,
        known_states: Floats | None = None,
        begun: "FirstPass | None" = None,
        original: mujoco.MjModel | None = None,
    ) -> None:
        """Repeat the run unless `known_states` has its states.

        `begun` has the measurement of its first seeds, which is not repeated. References are of
        the `original` if the model of the motion is a changed one of the same layout.
        """
        self._begun = begun
        self._motion, self._settings, self._model = motion, settings, motion.model
        self._exact_model = motion.model
        if original is not None:
            # References have the timestep and the integrator of the changed model.
            self._exact_model = without_sensors(original)
            self._exact_model.opt.integrator = motion.model.opt.integrator
            set_timestep(self._exact_model, float(motion.model.opt.timestep))
        self._used = [row for row in rows_to_measure if row.applies(motion.model)]
        self._undelayed = without_delays(motion)
        self._bodies = judged_bodies(motion.model)
        self._names = tuple(body_name(motion.model, int(body)) for body in self._bodies)
        self._observed = self._places_of(motion.observed)
        self.run: Run = replay_motion(motion, settings.window, settings.workers, known_states)
        self._slack = slack_share(self.run.steps)
        self._observer = Observer(motion.model, motion.starts[0], self._bodies, settings.workers)
        self._bases, self._stores = dict[str, mujoco.MjModel](), dict[str, ConstraintEnergy]()
        self._impulses = dict[tuple[str, int, int], Impulses]()
        gravity = 0.0 if is_disabled(motion.model, "gravity") else 1.0
        self._pulls = measure_pulls(motion, gravity * motion.model.opt.gravity)[..., self._bodies]
        self._usual = self._usual_changes()

    def _usual_changes(self) -> Floats:
        """Return (B,) accelerations that replace gravity if there is none, otherwise 0 [m/s^2]."""
        if read_gravity(self._model):
            return np.zeros(len(self._bodies))
        if self._motion.usual is not None:
            return self._motion.usual[self._bodies]
        return changes_of([self.run], self._observer) / float(self._model.opt.timestep)

    def _places_of(self, observed: Sequence[str]) -> np.ndarray:
        # (C,), among the bodies that move and have mass.
        if not self._bodies.size:
            raise EngineError("nothing of the model moves that has mass, so there is no motion")
        body_places = np.flatnonzero([not observed or name in observed for name in self._names])
        if not body_places.size:
            raise EngineError(
                f"no observed body moves and has mass ({', '.join(observed)}); those that do: "
                f"{', '.join(self._names)}"
            )
        return body_places

    def first_look(self) -> PhaseBudget:
        """Return the budget at h/4, without checks, excess path or RK4."""
        return self._build_phase(self.first_pass.values, excess=False)

    def measure_budget(self) -> PhaseBudget:
        """Return the budget with those of the wanted rows that the model has.

        Errors and windows are of the observed bodies; scales and energies are of all bodies.
        """
        window_values = self.first_pass.values
        for look in self.first_pass.looks:
            self._measure_more(look, window_values)
        return self._build_phase(window_values, excess=self._settings.excess)

    @cached_property
    def _exercised_rows(self) -> list[Row]:
        """The run, and the rows that the task exercises."""
        loaded_names = exercised_rows(self._motion, self._used)
        return [RUN, *(row for row in self._used if row.name in loaded_names)]

    def _build_phase(self, window_values: "_WindowValues", *, excess: bool) -> PhaseBudget:
        model, run, there = self._model, self.run, self._exercised_rows
        real, limits = self._sum_real(window_values), self._extrapolate_limits(window_values)
        energy, energy_rk4 = self._measure_drifts(window_values)
        of_steps = {
            row.name: window_values.apart[row.name] * limits for row in there if row.is_of_steps
        }
        window_values = window_values._replace(apart=window_values.apart | of_steps)
        whole, *rows = (
            self._build_reading(row, window_values, real, exercised=row in there)
            for row in (RUN, *self._used)
        )
        warnings = tuple(self._with_cause(warning) for warning in run.warnings)
        phase = PhaseBudget(
            name=self._motion.name,
            timestep=float(model.opt.timestep),
            steps=self._motion.steps,
            window=run.steps * float(model.opt.timestep),
            windows=len(run.begins),
            bodies=tuple(self._names[body] for body in self._observed),
            masses=model.body_mass[self._bodies[self._observed]],
            run=self._mark_failing(warnings, whole),
            rows=tuple(rows),
            energy=energy,
            energy_rk4=energy_rk4,
            energy_origin=self._energy_origin(window_values),
            excess_path=self._measure_excess(window_values, real)
            if excess
            else np.full(len(self._observed), np.nan),
            worst_window=self._measure_peak(window_values) if excess else float("nan"),
            upper_bound=self._bound_error(window_values, real),
            limit_factor=float(limits[self._observed[whole.body]]),
            invalid_windows=float(window_values.lost[run.valid].mean()) if run.valid.any() else 0.0,
            warnings=warnings,
        )
        self._bases.clear()
        self._stores.clear()  # nothing that waits holds models
        self._impulses.clear()
        return phase

    def _find_worst_body(self, values: Floats) -> int:
        """Return the number of the observed body with the largest of (B,) values."""
        return int(self._observed[np.argmax(values[self._observed])])

    def _find_base(self, name: str) -> mujoco.MjModel:
        if name not in self._bases:
            self._bases[name] = self._made_base(name)
        return self._bases[name]

    def _made_base(self, name: str) -> mujoco.MjModel:
        if name == "run":
            return run_at_once(self._model)
        if name == "RK4":
            return self._make_smooth_model(1)
        return self._build_reference(1 if name == "step" else self._settings.finer)

    def _build_reference(self, rate: int) -> mujoco.MjModel:
        return build_reference_model(self._exact_model, rate)

    def _find_energy_store(self, name: str) -> ConstraintEnergy:
        """Return the calculator of stored energies for a copy of a base."""
        if name not in self._stores:
            alike = not raises_time_constants(self._model)
            base = self._bases[name] if name in self._bases else self._made_base(name)
            self._stores[name] = ConstraintEnergy(base, constraints=alike)
        return self._stores[name]

    def _vary_model(self, row: Row) -> Iterator[mujoco.MjModel]:
        """Yield the models of a row's changes; each is a new copy, since a mesh may be large."""
        for change in row.changes:
            yield self._change_copy(
                self._compared_model(row) if row.both else self._find_base(row.base), change
            )

    def _compared_model(self, row: Row) -> mujoco.MjModel:
        """Return the model that a row's changes are compared with."""
        if row.both is None:
            return self._find_base(row.against)
        return self._change_copy(self._find_base(row.base), row.both)

    def _find_rate(self, row: Row) -> int:
        """Return how many steps of a row's models make one of the run's."""
        return self._settings.finer if row.base == "reference" else 1

    def _change_copy(self, model: mujoco.MjModel, change: ModelChange) -> mujoco.MjModel:
        changed = without_sensors(model)
        change(changed, self._model)
        return changed

    @cached_property
    def first_pass(self) -> "FirstPass":
        """First pass over all windows with references at h/4, and data for the second pass."""
        run, settings, rows = self.run, self._settings, self._exercised_rows
        shape, looks, seeds = (self._motion.seeds, len(run.begins)), list[_Look](), 0
        window_values = _WindowValues.empty(shape, len(self._bodies), [row.name for row in rows])
        if self._begun is not None and {*self._begun.values.apart} == {*window_values.apart}:
            looks, seeds = [*self._begun.looks], len(self._begun.values.lost)
            window_values.begin_with(self._begun.values)
        valid = run.valid & (np.arange(shape[0]) >= seeds)[:, None]
        for block in split_windows(
            self._model, np.argwhere(valid), (run.steps + 1) * settings.finer
        ):
            windows = Windows(self._undelayed, run, settings.workers, block)
            around, lost = self._measure_run(windows, block, window_values)
            looks.append(_Look(block, around["run"], around["reference"]))
            rolls = _SharedRolls(partial(self._measure_around, windows))
            if any(row.against == "step" for row in rows):
                around["step"] = rolls(self._find_base("step"), 1)
            for row in rows:
                if row is RUN:
                    continue
                other, rate = around[row.against], self._find_rate(row)
                if row.both is not None:
                    other = rolls(self._compared_model(row), rate)
                apart = [
                    measure_defects(rolls(model, rate), other, self._slack)
                    for model in self._vary_model(row)
                ]
                largest = np.max(apart, axis=0)
                largest[lost] = 0
                window_values.apart[row.name][tuple(block.T)] = largest
        return FirstPass(window_values, looks)

    def _measure_run(
        self, windows: Windows, block: np.ndarray, window_values: "_WindowValues"
    ) -> tuple[dict[str, Floats], np.ndarray]:
        """Enter the run's defects.

        Returns:
            Velocities of the run (M, 3, B, 6), and of the reference (M, 2 r + 1, B, 6), from one
            step of the run before the windows' ends to one after.
            (M) whether the reference gave up.
        """
        finer, steps, place = self._settings.finer, windows.steps, tuple(block.T)
        own, energies = self._observer(windows.own[:, [0, -3, -2, -1]])
        fine, lost = windows.roll_out(self._find_base("reference"), finer, whole=True)
        path, powers = self._observer(fine[:, : steps * finer + 1 : finer])
        end, end_energies = self._observer(fine[:, (steps - 1) * finer :])
        last = own[:, -3:]
        window_values.lost[place] = lost
        window_values.apart[RUN.name][place] = np.where(
            lost[:, None], 0, measure_defects(last, end, self._slack)
        )
        window_values.path[place] = np.where(lost[:, None], 0, measure_paths(path))
        window_values.gained[place] = np.where(
            lost[:, None], 0, self._measure_gained(last[:, 1], end[:, finer])
        )
        ends = np.concatenate([windows.own[:, -2:-1], fine[:, -2 * finer - 1 :: finer]], axis=1)
        stored, stored_around = self._measure_stored(windows, ["step", "reference"], ends)
        window_values.total[place] = energies[:, -2].sum(axis=-1) + stored[:, 1] - stored[:, 0]
        around, path_energy = end_energies[:, ::finer].sum(axis=-1), powers.sum(axis=-1)
        around += stored_around[:, 2:] - stored_around[:, :1]
        window_values.energy[place] = energy_defects(window_values.total[place], around)
        start, most = path_energy[:, 0] + stored[:, 0], path_energy.max(axis=1)
        window_values.held[place] = np.stack((start, most), axis=-1)
        window_values.lowest[place] = powers[..., 0].min(axis=1)
        window_values.added[place] = np.maximum(around[:, 1] - path_energy[:, 0], 0)
        window_values.begin[place] = np.linalg.norm(own[:, 0], axis=-1)
        return {"run": last, "reference": end}, lost

    def _measure_stored(self, windows: Windows, names: Sequence[str], kept_parts: Floats) -> Floats:
        """Return (N, M, 1 + K) stored energy at the beginning, and in states (M, K, kept) [J].

        N named bases differ in the length of their steps alone. Constraints store nothing if
        refsafe gives the run other springs than the reference: these would lift bodies that the
        run's springs let sink, window by window.
        """
        states = windows.restore_states(np.concatenate([windows.own[:, :1], kept_parts], axis=1))
        # Forces of some models depend on the step.
        if self._model.opt.integrator == _DISCRETE or has_step_factors(self._model):
            return np.stack([self._find_energy_store(name)(states) for name in names])
        rates = [self._settings.finer if name == "reference" else 1 for name in names]
        timesteps = [self._model.opt.timestep / rate for rate in rates]
        return self._find_energy_store(names[-1]).after_steps(states, timesteps)

    def _measure_gained(self, own: Floats, reference: Floats) -> Floats:
        """Return (M, B) kinetic energies beyond the reference's [J], from (M, B, 6) velocities."""
        with np.errstate(invalid="ignore", over="ignore"):
            square = (own**2).sum(axis=-1) - (reference**2).sum(axis=-1)
        return np.nan_to_num(self._model.body_mass[self._bodies] * square / 2)

    def _energy_origin(self, window_values: "_WindowValues") -> Origin:
        """Return the body whose kinetic energy changes most in one direction, and the window.

        Energy that leaves the reference in one window and returns in another is not a gain.
        """
        gained = np.where(self.run.valid[..., None], window_values.gained, 0)
        total = gained.sum(axis=(0, 1))
        body = int(np.argmax(np.abs(total)))
        along = gained[..., body] * np.sign(total[body])
        seed, window = map(int, np.unravel_index(np.argmax(along), along.shape))
        place = ""
        if self._settings.places and along[seed, window] > 0:
            models = self._find_base("run"), self._find_base("reference")
            place = self._find_place(seed, window, models, body)
        return Origin(
            body_name(self._model, int(self._bodies[body])),
            place,
            float(self.run.begins[window] * self._model.opt.timestep),
        )

    def _make_smooth_model(self, rate: int) -> mujoco.MjModel:
        smooth = self._build_reference(rate)
        smooth.opt.integrator = _RK4
        return smooth

    def _energy_by_rk4(self, windows: Windows, total: Floats, rate: int) -> Floats:
        """Return (M, 2) energy defects against RK4 [J]; NaN where it gave up."""
        states, gave_up = windows.roll_out(self._make_smooth_model(rate), rate)
        around = self._observer(states[:, ::rate])[1].sum(axis=-1)
        (stored_energy,) = self._measure_stored(windows, ["RK4"], states[:, ::rate])
        apart = energy_defects(total, around + stored_energy[:, 1:] - stored_energy[:, :1])
        return np.where(gave_up[:, None], np.nan, apart)

    def _measure_drifts(self, window_values: "_WindowValues") -> tuple[Floats, Floats]:
        """Return (S,) drifts of energy, against the run's own integrator and against RK4.

        RK4 treats dampers explicitly, and may be the one that is wrong. So if its
        drift is larger, it is measured again with half its step: NaN if the two differ.
        """
        own, rk4 = (
            self._measure_drift(window_values, window_values.energy),
            self._measure_drift(window_values, window_values.energy_rk4),
        )
        # Above a tenth of the tolerance, finer steps of RK4 show whether a drift is that of RK4.
        least_drift = 0.01
        if not np.abs(rk4).mean() > max(least_drift, np.abs(own).mean()):
            return own, rk4
        run, rate = self.run, 2 * _RK4_RATE
        for block in split_windows(self._model, np.argwhere(run.valid), (run.steps + 1) * rate):
            windows = Windows(self._undelayed, run, self._settings.workers, block)
            place = tuple(block.T)
            window_values.energy_rk4[place] = self._energy_by_rk4(
                windows, window_values.total[place], rate
            )
        finer = self._measure_drift(window_values, window_values.energy_rk4)
        with np.errstate(invalid="ignore"):
            # A drift changes at most by half when the reference is refined.
            resolved = np.abs(finer - rk4) <= 0.5 * np.maximum(np.abs(finer), np.abs(rk4))
        return own, np.where(resolved, finer, np.nan)

    def _measure_around(self, windows: Windows, model: mujoco.MjModel, rate: int) -> Floats:
        """Return (M, 2 rate + 1, B, 6) velocities of a model around the end; NaN if it gave up."""
        states, failed = windows.roll_out(model, rate)
        velocities = self._observer(states)[0]
        velocities[failed] = np.nan
        return velocities

    def _measure_more(self, look: "_Look", window_values: "_WindowValues") -> None:
        """Enter the requested numbers beyond the first pass."""
        settings, place = self._settings, tuple(look.block.T)
        windows = Windows(self._undelayed, self.run, settings.workers, look.block)
        if settings.check:
            rate = 2 * settings.finer
            finest = self._measure_around(windows, self._build_reference(rate), rate)
            window_values.checked[place] = measure_defects(look.reference, finest, self._slack)
            window_values.finer[place] = measure_defects(look.run, finest, self._slack)
        if settings.excess:
            own, lost = self._observer(windows.own[:, :-1])[0], window_values.lost[place][:, None]
            window_values.excess[place] = np.where(
                lost, 0, measure_paths(own) - window_values.path[place]
            )
            window_values.speed[place] = np.linalg.norm(own, axis=-1).max(axis=1)
        if settings.energy and self._model.opt.integrator != _RK4:
            window_values.energy_rk4[place] = self._energy_by_rk4(
                windows, window_values.total[place], _RK4_RATE
            )

    def _sum_real(self, window_values: "_WindowValues") -> Floats:
        """Return (S, B) real impulses over mass, the scale of errors [m/s]."""
        run, sums = self.run, np.cumsum(self._pulls, axis=1)
        sums = np.concatenate([0 * sums[:, :1], sums], axis=1)
        fallen = (sums[:, run.begins + run.steps] - sums[:, run.begins]) * run.valid[..., None]
        weight = GRAVITY_AS_REAL * self._model.opt.timestep * fallen.sum(axis=1)
        real = window_values.begin[:, 0] + window_values.path.sum(axis=1) + weight
        duration = run.steps * self._model.opt.timestep * run.valid.sum(axis=1)
        real = np.maximum(real, GRAVITY_AS_REAL * self._usual * duration[:, None])
        return scale_of_impulses(real)

    def _build_reading(
        self, row: Row, window_values: "_WindowValues", real: Floats, *, exercised: bool
    ) -> Reading:
        about = row.name, row.summary, row.kind
        if not exercised:
            none = np.empty(0)
            return Reading(*about, exercised=False, errors=none, seeds=none)
        if not self.run.valid.any():
            none = np.full(len(self._observed), np.nan)
            return Reading(*about, exercised=True, errors=none, seeds=none[:0])
        apart = window_values.apart[row.name]
        shares = apart.sum(axis=1) / real
        mean = shares.mean(axis=0)
        body = self._find_worst_body(mean)
        seed, window = map(int, np.unravel_index(np.argmax(apart[..., body]), apart.shape[:2]))
        time = float(self.run.begins[window] * self._model.opt.timestep)
        speeds = apart[..., body][self.run.valid & ~window_values.lost]
        reading = Reading(
            *about,
            exercised=True,
            errors=mean[self._observed],
            seeds=shares[:, body],
            shares=shares[:, self._observed],
            body=int(np.searchsorted(self._observed, body)),
            speed=float(speeds.mean()) if len(speeds) else np.nan,
            seed=seed,
            time=time,
        )
        if not self._settings.places or not apart[seed, window, body]:
            return reading
        models = next(self._vary_model(row)), self._compared_model(row)
        base = row.against if row.both is None else ""
        return replace(reading, place=self._find_place(seed, window, models, body, base))

    def _find_place(
        self,
        seed: int,
        window: int,
        models: tuple[mujoco.MjModel, mujoco.MjModel],
        body: int,
        base: str = "",
    ) -> str:
        """Return where the forces of two models differ; `base` is the name of the second, if any.

        Many rows are compared with one base in one window; its impulses are added up once.
        """
        run, timestep, key = self.run, self._model.opt.timestep, (base, seed, window)
        span = run.begins[window] + np.arange(run.steps)
        stretch = Stretch(
            run.starts[seed, window],
            self._undelayed.rows(seed, span),
            self._undelayed.spec,
            run.steps,
        )
        other = self._impulses.get(key) or sum_impulses(stretch, models[1], timestep)
        if base:
            self._impulses[key] = other
        impulses = sum_impulses(stretch, models[0], timestep), other
        return find_force_place(stretch, models[0], impulses, int(self._bodies[body]))

    def _mark_failing(self, warnings: Sequence[EngineWarning], reading: Reading) -> Reading:
        """Return the run's reading, infinite if the engine warned."""
        if not warnings:
            return reading
        first = min(warnings, key=lambda warning: warning.time)
        return replace(
            reading,
            errors=np.full_like(reading.errors, np.inf),
            seeds=np.full(self._motion.seeds, np.inf),
            body=int(
                np.searchsorted(self._observed, self._find_worst_body(self._measure_speeds(first)))
            ),
            seed=first.seed,
            time=first.time,
            place=first.cause,
        )

    def _measure_speeds(self, warning: EngineWarning) -> Floats:
        """Return (B,) speeds in the last state before a warning; 0 where one is not finite."""
        run, begin = self.run, int(self.run.begins[warning.window])
        states = run.velocity_states[warning.seed, begin : begin + run.steps]
        with np.errstate(invalid="ignore", over="ignore"):
            speeds = np.linalg.norm(self._observer(states)[0], axis=-1)
        whole = np.isfinite(speeds).all(axis=1)
        last = len(whole) if whole.all() else max(1, int(whole.argmin()))
        return np.nan_to_num(speeds[last - 1])

    def _with_cause(self, warning: EngineWarning) -> EngineWarning:
        """Return a warning of the run with where its forces had parted from the reference's."""
        if not self._settings.places:
            return warning
        models = self._find_base("run"), self._find_base("reference")
        body = int(np.argmax(self._measure_speeds(warning)))
        cause = self._find_place(warning.seed, warning.window, models, body)
        if not cause and warning.window:
            cause = self._find_place(warning.seed, warning.window - 1, models, body)
        return replace(warning, cause=cause)

    def _measure_drift(self, window_values: "_WindowValues", parts: Floats) -> Floats:
        """Return (S,) drifts of energy over all of it that there was.

        That is the energy of the start above the lowest potential energy, and the energy that the
        reference added; or the largest energy at one time, less the gain of the run itself; or
        weight times size.
        """
        model = self._model
        size = max(
            model.geom_rbound[model.geom_bodyid > 0].max(initial=0),
            gyration_radii(model)[self._bodies].max(),
        )
        weight = self._pulls.mean(axis=1) @ model.body_mass[self._bodies] * size
        usual = GRAVITY_AS_REAL * self._usual @ model.body_mass[self._bodies] * size
        found_drifts = np.full(len(parts), np.nan)
        for seed, valid in enumerate(self.run.valid & ~window_values.lost):
            if not valid.any():
                continue
            own, gained = (
                settle_defects(parts[seed][valid]),
                settle_defects(window_values.energy[seed][valid]),
            )
            start, most = window_values.held[seed][valid].T
            with np.errstate(invalid="ignore", over="ignore"):
                before = np.cumsum(gained) - gained
                had = max(
                    start[0] + window_values.added[seed][valid].sum(), np.nanmax(most - before)
                )
                had -= window_values.lowest[seed][valid].min()
                scale = max(had, weight[seed], usual) + 1e-300
                # No run loses more than there is: a larger loss is a gain of the reference.
                if (own >= -scale - np.maximum(np.cumsum(own) - own, 0)).all():
                    found_drifts[seed] = find_drift(own / scale)
        return found_drifts

    def _measure_excess(self, window_values: "_WindowValues", real: Floats) -> Floats:
        return np.maximum(0, (window_values.excess.sum(axis=1) / real).mean(axis=0))[self._observed]

    def _measure_peak(self, window_values: "_WindowValues") -> float:
        speed = window_values.speed.max(axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            parts = np.where(speed > 0, window_values.apart[RUN.name] / speed, 0)[
                ..., self._observed
            ]
        return float(np.nanmax(parts, initial=0))

    def _extrapolate_limits(self, window_values: "_WindowValues") -> Floats:
        """Return (B,) factors from shares at h/4 to those at the limit of fine steps."""
        checked = self._find_checked(window_values)
        run, finer = (
            of[checked].sum(axis=0) for of in (window_values.apart[RUN.name], window_values.finer)
        )
        return to_the_limit(run, finer)

    def _bound_error(self, window_values: "_WindowValues", real: Floats) -> float:
        """Return at most how far the run is from the limit of fine steps, of the worst body.

        NaN where nothing was checked. In first order that limit is as far from a reference at h/8
        as that is from one at h/4, whether or not they come nearer to the run. The part
        that slack forgives is in the run's share, which is at the limit already.
        """
        checked = self._find_checked(window_values)
        if not checked.any():
            return float("nan")
        apart = np.where(checked[..., None], window_values.finer + window_values.checked, 0)
        apart = np.stack([apart, window_values.apart[RUN.name]]).sum(axis=2)
        return float((apart / real).mean(axis=1)[:, self._observed].max())

    def _find_checked(self, window_values: "_WindowValues") -> np.ndarray:
        """Return (S, W) whether a window was gone through by both references."""
        return ~np.isnan(window_values.checked[..., 0]) & ~window_values.lost


class _SharedRolls:
    """Rolls of models through one block of windows, which equal models of several rows share."""

    def __init__(self, roll: Callable[[mujoco.MjModel, int], Floats]) -> None:
        self._roll, self._known, self._numbers = roll, dict[tuple[bytes, int], Floats](), 0

    def __call__(self, model: mujoco.MjModel, rate: int) -> Floats:
        buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, buffer)
        key = blake2b(buffer.data).digest(), rate
        if key in self._known:
            return self._known[key]
        velocities = self._roll(model, rate)
        most_numbers = 1 << 23  # that rows share: 64 MiB, as much as is recorded
        if self._numbers + velocities.size <= most_numbers:
            self._known[key], self._numbers = velocities, self._numbers + velocities.size
        return velocities


class _Look(NamedTuple):
    """Data of the first pass over a block of windows, for the second pass."""

    block: np.ndarray  # (M, 2) seeds and numbers of windows
    run: Floats  # (M, 3, B, 6) velocities of the run around the windows' ends
    reference: Floats  # (M, 2 r + 1, B, 6) of the reference there


class FirstPass(NamedTuple):
    """Results of the first pass over all windows."""

    values: "_WindowValues"
    looks: list[_Look]


class _WindowValues(NamedTuple):
    """Measurements in S x W windows, of B bodies."""

    apart: dict[str, Floats]  # (S, W, B) defects of each row [m/s]
    path: Floats  # (S, W, B) of the reference's velocity [m/s]
    excess: Floats  # (S, W, B) path of the run's velocity less the reference's [m/s]
    speed: Floats  # (S, W, B) largest [m/s]
    begin: Floats  # (S, W, B) speed at the start [m/s]
    checked: Floats  # (S, W, B) defects of the reference; NaN where it was not checked
    finer: Floats  # (S, W, B) defects of the run against the finer reference there
    gained: Floats  # (S, W, B) kinetic, beyond the reference's at the end [J]
    total: Floats  # (S, W) the run's energy at the end, less that stored in constraints before [J]
    energy: Floats  # (S, W, 2) defects, and their forgiven parts [J]
    energy_rk4: Floats  # (S, W, 2)
    held: Floats  # (S, W, 2) the reference's energy at the start, and its largest [J]
    lowest: Floats  # (S, W) least potential energy [J]
    added: Floats  # (S, W) how much the reference's energy rose [J]
    lost: np.ndarray  # (S, W) whether the reference gave up

    def begin_with(self, other: "_WindowValues") -> None:
        """Enter the measurements of the first seeds."""
        for name, first_values in other.apart.items():
            self.apart[name][: len(first_values)] = first_values
        for own, first_values in zip(self[1:], other[1:], strict=True):
            own[: len(first_values)] = first_values

    @classmethod
    def empty(cls, shape: tuple[int, int], bodies: int, names: Iterable[str]) -> "_WindowValues":
        """Return arrays to enter into; windows that are never entered count nothing."""

        def bodies_of() -> Floats:
            return np.zeros((*shape, bodies))

        return cls(
            apart={name: bodies_of() for name in names},
            path=bodies_of(),
            excess=bodies_of(),
            speed=bodies_of(),
            begin=bodies_of(),
            checked=np.full((*shape, bodies), np.nan),
            finer=np.full((*shape, bodies), np.nan),
            gained=bodies_of(),
            total=np.zeros(shape),
            energy=np.zeros((*shape, 2)),
            energy_rk4=np.full((*shape, 2), np.nan),
            held=np.zeros((*shape, 2)),
            lowest=np.zeros(shape),
            added=np.zeros(shape),
            lost=np.zeros(shape, bool),
        )
