"""Rows of a recording: matched with a model, converted to its units and frames, and checked."""

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.rotations import multiply_rotations, rotate_vectors, rotate_vectors_back
from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import QUARTER_TURN, RecordedPart
from contactlab.errors import SceneError
from contactlab.scene.drive.recorded import RecordedTable
from contactlab.scene.model_names import part_starts
from contactlab.schema.scene_manifest import UNITS, Recording

_MAX_NORM_ERROR = 0.01  # largest deviation of a quaternion's norm from 1 that rounding explains
WINDOW = 10  # number of rows that average out the noise of single ones


class RecordedRows:
    """R rows of a recording, sorted by run, as states and inputs of a model.

    `runs` are the rows of each run by its number, at `times` (R,) [s]. `qpos` (R, nq) and `qvel`
    (R, nv) are NaN outside the recorded `parts`. `inputs` holds commands (R,) by index. The rows
    `within` are followed by a row of the same run, at mean `rates` (R, nv).
    """

    def __init__(self, model: mujoco.MjModel, entry: Recording, table: RecordedTable) -> None:
        """Read the rows. Raises a SceneError that lists all of their mistakes."""
        self._model, self._entry, self._name = model, entry, table.name
        keys = [entry.time, *([entry.run] if entry.run else [])]
        column_names = entry.columns or {
            column: column for column in table.columns if column not in keys
        }
        # A joint's name denotes its coordinate, not the control of its actuator.
        joints = {model.joint(index).name for index in range(model.njnt)}
        column_names = {
            f"{name}.qpos" if name in joints else name: column
            for name, column in column_names.items()
        }
        columns_by_place, self._mistakes = table.match_columns(model, column_names)
        if lacking := [table.missing_column_text(key) for key in keys if key not in table.columns]:
            self._mistakes += lacking
            self.raise_mistakes()
        self._unsound = set[float]()
        self._sort_by_run(*(table.columns[key] for key in keys))
        columns = {
            place: table.columns[name][self._order] for place, name in columns_by_place.items()
        }
        names = [entry.time, *columns_by_place.values()]
        for column, values in zip(names, [self.times, *columns.values()], strict=True):
            unknown = ~np.isfinite(values)
            self.add_mistake(f"no finite number in column `{column}`", np.flatnonzero(unknown))
            values[unknown] = np.nan
        self._assign_columns(columns)
        # Rows in meters and radians, and in the frames of the model.
        length, angle = UNITS[self._entry.units.length], UNITS[self._entry.units.angle]
        frame, turn = self._entry.frame, np.array([1.0, 0, 0, 0])
        if frame != "world":
            turn = np.array(frame.quaternion) / np.linalg.norm(frame.quaternion)
        for part in self.parts:
            place, speed = self.qpos[:, part.qpos], self.qvel[:, part.qvel]
            speed *= length if part.kind in ("point", "slide") else angle
            if part.kind == "turn":
                norm = np.linalg.norm(place, axis=1)
                what = f"the quaternion of {part.joint} does not have the norm 1"
                self.add_mistake(what, np.flatnonzero(np.abs(norm - 1) > _MAX_NORM_ERROR))
                place[:] = multiply_rotations(
                    turn, place / np.maximum(norm, _MAX_NORM_ERROR)[:, None]
                )
                if self._entry.turning == "world":
                    speed[:] = rotate_vectors_back(place, rotate_vectors(turn, speed))
                continue
            place *= angle if part.kind == "hinge" else length
            if part.kind == "point" and frame != "world":
                place[:] = rotate_vectors(turn, place) + np.array(frame.position)
                speed[:] = rotate_vectors(turn, speed)
        # Runs with one row, late or missing rows, and joints beyond their ranges.
        single = [rows.start for rows in self.runs.values() if rows.stop - rows.start < 2]
        self.add_mistake("the only row of a run", np.array(single, np.intp))
        steps = np.diff(self.times)[self.within]
        self.add_mistake("time does not increase after", self.within[steps <= 0])
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        what = f"rows are missing (others are {usual * 1e3:.3g} ms apart) after"
        # Rows are missing if the time between two exceeds the usual one by this factor.
        self.add_mistake(what, self.within[steps > 1.5 * usual])
        for part in self.parts:
            joint = self._model.joint(part.joint)
            if part.kind in ("slide", "hinge") and self._model.jnt_limited[joint.id]:
                low, high = joint.range
                out = np.abs(self.qpos[:, part.qpos.start] - (low + high) / 2) / part.size
                what = f"{part.joint} is beyond its range of {low:.3g} to {high:.3g}"
                # Largest allowed excess of a joint over its range, as a share of the range.
                self.add_mistake(what, np.flatnonzero(out > 0.5 + 0.05))
        self._check_velocities()

    @property
    def valid_runs(self) -> tuple[float, ...]:
        """The runs without mistakes in their rows."""
        return tuple(run for run in self.runs if run not in self._unsound)

    def add_mistake(self, mistake: str, rows: NDArray[np.intp]) -> None:
        """Collect one kind of mistake with the first of its rows, if there are any."""
        if len(rows):
            self._unsound.update(self._numbers[rows].tolist())
            run = self._entry.run
            max_listed_rows = 3  # of one kind of mistake: the others are like them
            row_names = [
                f"row {self._order[row] + 1}" + (f" ({run} {self._numbers[row]:g})" if run else "")
                for row in rows[:max_listed_rows].tolist()
            ]
            more = (
                f" and {len(rows) - max_listed_rows:,} more" if len(rows) > max_listed_rows else ""
            )
            self._mistakes.append(f"{mistake}: {', '.join(row_names)}{more}")

    def raise_mistakes(self) -> None:
        """Raise a SceneError with the collected mistakes, if there are any."""
        if self._mistakes:
            head = f"{self._name} is not a recording of this model:"
            raise SceneError("\n  ".join([head, *self._mistakes]))

    def _sort_by_run(self, times: Floats, numbers: Floats | None = None) -> None:
        """Sort rows by run; rows of a run keep the order of the file."""
        numbers = np.zeros(len(times)) if numbers is None else numbers
        order = np.argsort(numbers, kind="stable")
        self._order = order[~np.isin(numbers[order], self._entry.leave_out)]
        self.times = times[self._order] * UNITS[self._entry.units.time]
        self._numbers = numbers[self._order]
        self.within = np.flatnonzero(np.diff(self._numbers) == 0)
        ids, first, counts = np.unique(self._numbers, return_index=True, return_counts=True)
        ends = (first + counts).tolist()
        self.runs = dict(zip(ids.tolist(), map(slice, first.tolist(), ends), strict=True))
        odd = np.nan_to_num(self._numbers, nan=0.5, posinf=0.5, neginf=0.5) % 1
        self.add_mistake("the number of a run is not an integer", np.flatnonzero(odd))
        if unknown := sorted(set(self._entry.leave_out) - set(numbers.tolist())):
            self._mistakes.append(f"no run to leave out: {', '.join(map(str, unknown))}")
        if not self.runs:
            self._mistakes.append("it has no rows")
            self.raise_mistakes()

    def _assign_columns(self, columns: dict[int, Floats]) -> None:
        model, first = self._model, part_starts(self._model)["ctrl"]
        state = np.full((len(self._order), first), np.nan)
        self.inputs = dict[int, Floats]()
        for place, values in columns.items():
            if place < first:
                state[:, place] = values
            else:
                self.inputs[place - first] = values
        self.qpos, self.qvel = state[:, : model.nq], state[:, model.nq : model.nq + model.nv]
        is_recorded = np.isin(np.arange(model.nq), list(columns))
        parts = [(part, is_recorded[part.qpos]) for part in _joint_parts(model)]
        self.parts = tuple(part for part, has_row in parts if has_row.all())
        for part, has_row in parts:
            if has_row.any() and not has_row.all():
                names = "x, y and z" if part.kind == "point" else "qw, qx, qy and qz"
                self._mistakes.append(f"{part.joint} needs all of {names}")
        if not self.parts:
            self._mistakes.append("no columns are a joint or a free body; name one")

    def _check_velocities(self) -> None:
        """Find jumps, and velocities that contradict the poses; fill in missing velocities."""
        self.rates = np.full_like(self.qvel, np.nan)
        steps = np.diff(self.times, append=np.nan)
        qpos = np.where(np.isnan(self.qpos), self._model.qpos0, self.qpos)
        for row in self.within[steps[self.within] > 0].tolist():
            pair = qpos[row], qpos[row + 1]
            mujoco.mj_differentiatePos(self._model, self.rates[row], steps[row], *pair)
        mean_velocity = (self.qvel + np.roll(self.qvel, -1, axis=0)) / 2
        for part in self.parts:
            quantity = "angular velocity" if part.kind in ("turn", "hinge") else "velocity"
            rates = self.rates[:, part.qvel]
            # Speed above every recorded motion [m/s or rad/s].
            jumps = np.flatnonzero(np.linalg.norm(rates, axis=1) > 100.0)
            self.add_mistake(
                f"{part.joint} jumps, or is in another unit ({quantity}), after", jumps
            )
            self.add_mistake(
                f"{part.joint} jumps in one row only",
                _single_row_jumps(rates * steps[:, None], part),
            )
            difference = mean_velocity[:, part.qvel] - rates
            off, typical = _smoothed_rms(difference), _smoothed_rms(rates)
            # Largest relative difference of recorded velocities from those of the poses.
            if off > 0.25 * typical:
                self.add_mistake(
                    f"{part.joint}: its {quantity} differs by {off:.3g} from that of its poses, "
                    f"which is {typical:.3g} (root mean squares); check unit and frame, or remove "
                    "it; largest after",
                    np.array([np.nanargmax(np.linalg.norm(difference, axis=1))]),
                )
        total, count = np.zeros_like(self.qvel), np.zeros((len(self.qvel), 1))
        for rows in (self.within, self.within + 1):
            total[rows] += self.rates[self.within]
            count[rows] += 1
        self.qvel = np.where(np.isnan(self.qvel), total / np.maximum(count, 1), self.qvel)


def _smoothed_rms(rates: Floats) -> float:
    """Return the root mean square of smoothed rates (R, m); noise of poses grows in rates.

    Rows without a rate do not count.
    """
    rates = rates[np.isfinite(rates).all(axis=1)]
    if not len(rates):
        return 0.0
    window = np.ones(min(WINDOW, len(rates))) / WINDOW
    smooth = [np.convolve(column, window, "valid") for column in rates.T]
    return float(np.sqrt(np.square(smooth).sum(axis=0).mean()))


def _single_row_jumps(moved: Floats, part: RecordedPart) -> NDArray[np.intp]:
    """Return the rows with a jump of a part there and back.

    The part moves by (R, m) after each row.
    """
    far = np.linalg.norm(moved, axis=1)
    before, there, back, after = (far[k : len(far) - 3 + k] for k in range(4))
    turned = (moved[1:-2] * moved[2:-1]).sum(axis=1) < -there * back / 2
    least = np.minimum(there, back)
    # A jump of a single row exceeds the motion before and after it by this factor.
    single_jump_ratio = 5
    jumps = (least > single_jump_ratio * np.maximum(before, after)) & (
        least > part.size / single_jump_ratio
    )
    return np.flatnonzero(turned & jumps) + 2


def _joint_parts(model: mujoco.MjModel) -> Iterator[RecordedPart]:
    hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    for index in range(model.njnt):
        joint = model.joint(index)
        kind, body, at, dof = (
            int(field[0]) for field in (joint.type, joint.bodyid, joint.qposadr, joint.dofadr)
        )
        if kind in (hinge, slide):
            size = QUARTER_TURN if kind == hinge else float(model.stat.extent)
            size = float(np.ptp(joint.range)) if model.jnt_limited[index] else size
            places = slice(at, at + 1), slice(dof, dof + 1)
            word = "hinge" if kind == hinge else "slide"
            yield RecordedPart(joint.name, body, word, *places, size)
            continue
        free = 3 * (kind == mujoco.mjtJoint.mjJNT_FREE)
        if free:
            width = 2 * float(model.bvh_aabb[model.body_bvhadr[body], 3:].min())
            places = slice(at, at + 3), slice(dof, dof + 3)
            yield RecordedPart(joint.name, body, "point", *places, width)
        places = slice(at + free, at + free + 4), slice(dof + free, dof + free + 3)
        yield RecordedPart(joint.name, body, "turn", *places, np.inf if free else QUARTER_TURN)
