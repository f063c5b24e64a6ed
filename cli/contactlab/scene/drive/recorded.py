"""Recorded inputs: columns of a table, matched with the inputs and the state of a model."""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.model_names import coordinate_indices, mocap_coordinates, part_starts
from contactlab.scene.part_bodies import AT_JOINT
from contactlab.scene.timed_inputs import Signals

TIME = "time"
_INDEXED_NAME = re.compile(r"(ctrl|qpos|qvel)\[(\d+)\]")

TableReader = Callable[[Path], Mapping[str, Floats]]
"""Returns the columns of a file by name, each (T,)."""


@dataclass(frozen=True)
class RecordedTable:
    """A named table: its columns by name, each (T,)."""

    name: str
    columns: Mapping[str, Floats]

    @property
    def end(self) -> float | None:
        """Time of the last row, after the first [s]; None without times."""
        times = self.columns.get(TIME)
        return None if times is None or not len(times) else float(times[-1] - times[0])

    def match_columns(
        self, model: mujoco.MjModel, columns: Mapping[str, str]
    ) -> tuple[dict[int, str], list[str]]:
        """Return columns by their indices in a row of state and inputs, and all mistakes.

        `columns` has the column of each name of an input, joint or body.
        """
        columns_by_place, mistakes = dict[int, str](), list[str]()
        for name, column in columns.items():
            if column not in self.columns:
                mistakes.append(self.missing_column_text(column))
            place = _find_place(model, name, columns)
            if isinstance(place, str):
                mistakes.append(place)
            elif column in self.columns:
                columns_by_place[place] = column
        return columns_by_place, mistakes

    def missing_column_text(self, column: str) -> str:
        """Return the message for a missing column."""
        hint = did_you_mean(column, self.columns) or f"; it has {', '.join(self.columns)}"
        return f"no column `{column}`{hint if self.columns else '; it is empty'}"


@dataclass(frozen=True)
class RecordedInputs:
    """Controls that drive runs, and parts of their start, from a named table."""

    name: str
    signals: Signals
    start: tuple[tuple[str, int, float], ...]  # qpos or qvel, an index in it, and the value there

    def signals_for(self, duration: float, timestep: float) -> Signals:
        """Return the signals for runs of a duration [s]; a SceneError if the last row is earlier.

        Rows at steps are moved exactly onto them, because clocks that add up timesteps accumulate
        rounding.
        """
        times = self.signals.times
        if (end := float(times[0, -1])) < duration * (1 - COARSE_ROUNDING):
            raise SceneError(
                f"{self.name}: its last row is at {end:g} s of column `{TIME}`, but runs take "
                f"{duration:g} s; write duration: {end:g}, or add rows"
            )
        return self.signals.at_steps(timestep)


def read_recorded(model: mujoco.MjModel, table: RecordedTable, *, is_held: bool) -> RecordedInputs:
    """Return the inputs of runs of a model in a table; its first row is their start.

    Each row is held until the next, or linearly interpolated. A SceneError says that there is no
    time, that nothing is driven, or lists names that the model lacks and values that are not
    numbers.
    """
    name, columns = table.name, table.columns
    if TIME not in columns or not len(columns[TIME]):
        raise SceneError(f"{name}: no rows, or no column `{TIME}` [s]; add both")
    columns_by_place, mistakes = table.match_columns(
        model, {column: column for column in columns if column != TIME}
    )
    times = columns[TIME] - columns[TIME][0]
    for column in (TIME, *columns_by_place.values()):
        if (bad := np.flatnonzero(~np.isfinite(columns[column]))).size:
            mistakes.append(f"row {bad[0] + 1} of column `{column}` is not a finite number")
    if (back := np.flatnonzero(np.diff(times) < 0)).size:
        mistakes.append(f"`{TIME}` decreases in row {back[0] + 2}; sort the rows by time")
    first = part_starts(model)["ctrl"]
    driven = {
        place - first: columns[column]
        for place, column in columns_by_place.items()
        if place >= first
    }
    if not (driven or mistakes):
        mistakes.append(
            "no column is an actuator, BODY.fx to .tz, or MOCAP_BODY.x to .qz; name at least one"
        )
    if mistakes:
        raise SceneError("\n".join(f"{name}: {mistake}" for mistake in mistakes))
    start: list[tuple[str, int, float]] = []
    for place in (place for place in columns_by_place if place < first):
        part, index = ("qpos", place) if place < model.nq else ("qvel", place - model.nq)
        start.append((part, index, float(columns[columns_by_place[place]][0])))
    signals = Signals(np.array(list(driven), np.intp), times[None], np.array(list(driven.values())))
    if is_held:
        times, levels = np.repeat(signals.times, 2, axis=1)[:, 1:], signals.levels
        signals = Signals(signals.places, times, np.repeat(levels, 2, axis=1)[:, :-1])
    return RecordedInputs(name, signals, tuple(start))


def _find_place(model: mujoco.MjModel, column: str, columns: Collection[str]) -> int | str:
    """Return the index of the input or coordinate with a name, or the reason for its absence."""
    element = _INDEXED_NAME.fullmatch(column)
    sizes = {"ctrl": model.nu, "qpos": model.nq, "qvel": model.nv}
    if element and int(element[2]) < sizes[element[1]]:
        return part_starts(model)[element[1]] + int(element[2])
    input_places = coordinate_indices(model) | mocap_coordinates(model)
    # Joints that exactly one actuator moves.
    movers: dict[str, list[str]] = {}
    for actuator in range(model.nu):
        if model.actuator_trntype[actuator] in AT_JOINT:
            joint = model.joint(int(model.actuator_trnid[actuator, 0])).name
            movers.setdefault(joint, []).append(model.actuator(actuator).name)
    joints = {joint: names[0] for joint, names in movers.items() if len(names) == 1}
    if f"{column}.ctrl" in input_places:
        return input_places[f"{column}.ctrl"]
    if column in joints and f"{joints[column]}.ctrl" not in input_places:
        return input_places[column]
    if column in joints and not {joints[column], f"{joints[column]}.ctrl"} & set(columns):
        return input_places[f"{joints[column]}.ctrl"]
    if (place := input_places.get(column.removesuffix(".qpos"))) is not None:
        return place
    names = [heading.removesuffix(".ctrl") for heading in input_places]
    some = [name for name in names if "." not in name] or sorted(
        input_places, key=input_places.__getitem__
    )
    such = f"; name them such as {', '.join(some[:4])}" if some else ""
    close = did_you_mean(column, names) or such
    return f"column `{column}` is not an actuator, joint or body of the model{close}"
