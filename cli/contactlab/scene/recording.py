"""Recorded runs: the start of each, and the motion that its simulation is compared with."""

import copy
from collections.abc import Iterator, Sequence
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import RecordedMotion, RecordedPart
from contactlab.numerical_tolerance import COARSE_ROUNDING, SUM_ROUNDING
from contactlab.scene.contact_pairs import geom_pairs, touch_mask
from contactlab.scene.drive.recorded import RecordedTable
from contactlab.scene.recorded_rows import WINDOW, RecordedRows
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.scene_manifest import Recording

_MIN_FLIGHT_ROWS = 4  # fewest rows of a free flight that determine its velocity


class RecordedRuns:
    """The recorded runs of a table in coordinates of a model, by their number, ascending."""

    def __init__(self, model: mujoco.MjModel, entry: Recording, table: RecordedTable) -> None:
        """Read the runs. Raises a SceneError that lists all of their mistakes."""
        self._model, self._rule, self._data = model, entry.start, mujoco.MjData(model)
        self._rows = rows = RecordedRows(model, entry, table)
        self._points = [part for part in rows.parts if part.kind == "point"]
        self.numbers = tuple(rows.runs)
        self._starts = dict(self._find_starts())
        if model.opt.gravity.any():
            self._check_motion()
        rows.raise_mistakes()

    def duration_of(self, number: float) -> float:
        """Return the duration of the simulation of a run [s]: until its last row, or a bit more."""
        rows = self._from_start(number)
        seconds = self._rows.times[rows.stop - 1] - self._rows.times[rows.start]
        # Durations are multiples of it [s], so that runs of similar length share jobs.
        duration_grain_s = 0.1
        return round(
            float(np.ceil(seconds / duration_grain_s - COARSE_ROUNDING)) * duration_grain_s, 9
        )

    def start_state(self, number: float) -> Floats:
        """Return (nq + nv,) the state that a run starts from; NaN for unknown coordinates."""
        return np.concatenate([self._rows.qpos[self._starts[number]], self._start_velocity(number)])

    def command_signals(self, number: float) -> Signals:
        """Return the recorded commands over time."""
        rows, inputs = self._from_start(number), self._rows.inputs
        if not inputs:
            return Signals.no_signals()
        times = self._rows.times[rows] - self._rows.times[rows.start]
        levels = np.array([curves[rows] for curves in inputs.values()])
        return Signals(np.array(list(inputs), np.intp), times[None], levels)

    def recorded_motion(self, numbers: Sequence[float]) -> RecordedMotion:
        """Return the recorded motion that n runs are compared with."""
        runs = [self._from_start(number) for number in numbers]
        most = max(run.stop - run.start for run in runs)

        def padded(values: Floats) -> Floats:
            whole = np.full((len(runs), most, *values.shape[1:]), np.nan)
            for row, run in zip(whole, runs, strict=True):
                row[: run.stop - run.start] = values[run]
            return whole

        rows = self._rows
        times = padded(rows.times) - rows.times[[run.start for run in runs]][:, None]
        touched = np.array([self._first_touch_time(run) for run in runs])
        # Duration of the first contact after touch [s].
        within = times - touched[:, None] >= np.array([0, 0.05])[:, None, None]
        impact = np.where(within.any(axis=2), within.argmax(axis=2) - [[1], [0]], -1)
        impact = np.where((impact >= 0).all(axis=0), impact, -1).T
        lost = [self._energy_loss(run.start + two) for run, two in zip(runs, impact, strict=True)]
        lost_speed = np.where(impact[:, 0] >= 0, lost, np.nan)
        qpos, qvel = padded(rows.qpos), padded(rows.qvel)
        return RecordedMotion(rows.parts, times, qpos, qvel, touched, impact, lost_speed)

    def _energy_loss(self, rows: NDArray[np.intp]) -> float:
        """Return the energy that the model loses from the first to the second of two rows [J]."""
        qpos, qvel, data = self._rows.qpos[rows], self._rows.qvel[rows], self._data
        if np.isnan(qpos).any() or np.isnan(qvel).any():
            return np.nan
        energies = list[float]()
        for place, rates in zip(qpos, qvel, strict=True):
            data.qpos[:], data.qvel[:] = place, rates
            for compute in (mujoco.mj_fwdPosition, mujoco.mj_energyPos, mujoco.mj_energyVel):
                compute(self._model, data)
            energies.append(float(data.energy.sum()))
        return energies[0] - energies[1]

    def _from_start(self, number: float) -> slice:
        return slice(self._starts[number], self._rows.runs[number].stop)

    def _find_starts(self) -> Iterator[tuple[float, int]]:
        """Yield the start row of each run, and record a mistake for runs without one."""
        rule, without = self._rule, list[int]()
        for number in self._rows.valid_runs:
            if (start := self._find_start_row(self._rows.runs[number])) is None:
                without.append(self._rows.runs[number].start)
            else:
                yield number, start
        mistake = f"runs start after {rule.time:g} s, but a run is shorter"
        if rule.before_contact is not None:
            mistake = "no recorded free body comes close to contact in the run of"
        self._rows.add_mistake(mistake, np.array(without, np.intp))

    def _find_start_row(self, rows: slice) -> int | None:
        times, rule = self._rows.times[rows], self._rule
        if rule.before_contact is None:
            late = times - times[0] >= rule.time - SUM_ROUNDING
            return rows.start + int(late.argmax()) if late[:-1].any() else None
        near = (
            row
            for row in range(rows.start, rows.stop)
            if self._distance_to_others(row, bounding=True) <= 0
        )
        first = next(near, None)
        return None if first is None else max(first - rule.before_contact, rows.start)

    def _start_velocity(self, number: float) -> Floats:
        """Return (nv,) the start velocity of a run."""
        first, start, times = self._rows.runs[number].start, self._starts[number], self._rows.times
        velocity = self._rows.qvel[start].copy()
        if self._rule.before_contact is None or start - first < _MIN_FLIGHT_ROWS:
            return velocity
        rows, steps = slice(first, start + 1), np.diff(times[first : start + 1])
        since = times[rows] - times[start - self._rule.lag]
        fallen = since[:, None] ** 2 / 2 * np.array(self._model.opt.gravity)
        for part in self._points:
            line = np.polyfit(since, self._rows.qpos[rows, part.qpos] - fallen, 1)
            velocity[part.qvel] = line[0]
            spin = slice(part.qvel.stop, part.qvel.stop + 3)
            velocity[spin] = steps @ self._rows.rates[first:start, spin] / steps.sum()
        return velocity

    @cached_property
    def _touchable_pairs(self) -> tuple[list[tuple[int, int]], mujoco.MjModel]:
        """Geom pairs of recorded free bodies and others, and a model of bounding spheres."""
        model, spheres = self._model, copy.copy(self._model)
        roots = np.asarray(model.body_rootid)[model.geom_bodyid]
        own = np.isin(roots, model.body_rootid[[part.body for part in self._points]])
        touch = touch_mask(model) & (roots[:, None] != roots) & (own[:, None] | own)
        spheres.geom_size[own, 0] = model.geom_rbound[own]
        spheres.geom_type[own] = int(mujoco.mjtGeom.mjGEOM_SPHERE)
        return geom_pairs(touch), spheres

    def _distance_to_others(self, row: int, *, bounding: bool = False) -> float:
        """Return the distance of recorded free bodies, or of their spheres, to others [m]."""
        qpos, data, (pairs, spheres) = self._rows.qpos[row], self._data, self._touchable_pairs
        model = spheres if bounding else self._model
        np.copyto(data.qpos, qpos, where=np.isfinite(qpos))
        mujoco.mj_kinematics(model, data)
        max_measured_distance_m = 10.0  # largest distance that is measured [m]
        gaps = (
            mujoco.mj_geomDistance(model, data, *pair, max_measured_distance_m, None)
            for pair in pairs
        )
        return min(gaps, default=max_measured_distance_m)

    def _first_touch_time(self, rows: slice) -> float:
        """Return the time of the first contact of a free body, from the first of some rows [s]."""
        times, before = self._rows.times[rows] - self._rows.times[rows.start], np.nan
        for place, row in enumerate(range(rows.start, rows.stop)):
            if (gap := self._distance_to_others(row)) <= 0:
                share = before / (before - gap) if place else 1.0
                return float(times[place] - (1 - share) * (times[place] - times[max(place - 1, 0)]))
            before = gap
        return np.nan

    def _check_motion(self) -> None:
        rows, gravity = self._rows, np.array(self._model.opt.gravity)
        runs = [rows.runs[start] for start in self._starts]
        ends = np.array([run.stop - 1 for run in runs], np.intp)
        before = np.array([max(run.stop - 1 - WINDOW, run.start) for run in runs], np.intp)
        gaps = np.array([self._distance_to_others(row) for row in ends.tolist()])
        # Largest gap or depth of a resting body on its support, in body widths.
        max_support_gap = 0.05
        for part in self._points:
            moved = rows.qpos[ends, part.qpos] - rows.qpos[before, part.qpos]
            # Largest motion of a resting body in the last rows, in body widths.
            still = np.linalg.norm(moved, axis=1) < 0.05 * part.size
            # A moving body may be deeper by this factor.
            far, deep = (
                max_support_gap * part.size,
                np.where(still, 1, 5.0) * max_support_gap * part.size,
            )
            for word, off in (("rests above", still & (gaps > far)), ("overlaps", gaps < -deep)):
                mistake = f"{part.joint} {word} the geoms it may touch; check body, unit and frame"
                rows.add_mistake(mistake, ends[off])
            falls = np.array(
                [self._fall_acceleration(part, number) for number in self._starts]
            ).reshape(-1, 3)
            falls = (falls @ gravity / (gravity @ gravity))[np.isfinite(falls).all(axis=1)]
            fall = float(np.median(falls)) if len(falls) else 1.0
            # Largest relative difference between free flight and gravity if there are few or damped
            # flights.
            allowed = 0.2
            # Fewer flights do not show the uncertainty of gravity.
            if not (len(falls) < 4 or self._model.opt.density or self._model.opt.viscosity):
                # The standard error of a median is 1.25 times that of a mean. A normal scatter is
                # 1.48 times the median distance from the median. Three errors allow for chance.
                scatter = 1.48 * float(np.median(abs(falls - np.median(falls))))
                # Largest relative difference due to air; tossed cubes of 0.37 kg fall at 0.981 g.
                allowed = min(allowed, 0.05 + 3 * 1.25 * scatter / np.sqrt(len(falls)))
            if abs(fall - 1) > allowed:
                mistake = f"{part.joint} falls {fall:.3g} times as fast as in the model's gravity"
                rows.add_mistake(
                    f"{mistake}; check the units of length and time, or set the model's `density` "
                    "if air matters",
                    ends[:1],
                )

    def _fall_acceleration(self, part: RecordedPart, number: float) -> Floats:
        """Return (3,) the acceleration before a run's start [m/s^2]; NaN if that is too short."""
        rows = slice(self._rows.runs[number].start, self._starts[number] + 1)
        if self._rule.before_contact is None or rows.stop - rows.start < 3 * _MIN_FLIGHT_ROWS:
            return np.full(3, np.nan)
        return 2 * np.polyfit(self._rows.times[rows], self._rows.qpos[rows, part.qpos], 2)[0]
