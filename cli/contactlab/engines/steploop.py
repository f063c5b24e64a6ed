"""What contactlab uses of `mujoco.batch.Batch`, as loops over `mj_step`: for engines before 3.17.

Same names, same arrays, same bits; slower, by what Python takes for each step.
"""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.engines.contact_slots import ContactSlots, contact_slots

_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_WARNINGS = int(mujoco.mjtWarning.mjNWARNING)
_COUNT = 1


class SimulationError(RuntimeError):
    """The engine raised an error in a run; `StepLoop.error` has its message."""


class StepLoop:
    """Runs of one layout, stepped one by one.

    Attributes:
        state: (n, nstate) all that decides what follows, as `mjSTATE_INTEGRATION` has it.
        warning: (n, kinds, 2) what was last warned of, and how often.
    """

    def __init__(
        self, model: mujoco.MjModel, nsim: int, nthread: int = 1, persistent: bool = False
    ) -> None:
        """Hold `nsim` runs of a model; a persistent loop keeps the data of each between calls."""
        assert nthread == 1
        self._models = [model] * nsim
        self._kept: dict[int, mujoco.MjData] | None = {} if persistent else None
        self._errors = [""] * nsim
        self.state = np.zeros((nsim, mujoco.mj_stateSize(model, _INTEGRATION)))
        self.warning = np.zeros((nsim, _WARNINGS, 2), np.int32)

    def set_models(self, models: Sequence[mujoco.MjModel]) -> None:
        """Give each run a model of its own."""
        self._models = list(models)

    def reset(self, stage: int) -> None:  # noqa: ARG002 - nothing is computed before a step
        """Put every run where the first one's model starts."""
        first = self._models[0]
        mujoco.mj_getState(first, mujoco.MjData(first), self.state[0], _INTEGRATION)
        self.state[1:] = self.state[0]

    def bind(self, name: str) -> Floats:
        """Return a view of a part of the state: time, qpos, qvel, act, ctrl or xfrc_applied."""
        model, wanted = self._models[0], _component(name)
        begin = mujoco.mj_stateSize(model, wanted - 1 & _INTEGRATION)
        part = self.state[:, begin : begin + mujoco.mj_stateSize(model, wanted)]
        if name == "xfrc_applied":
            return part.reshape(len(part), -1, 6)
        return part[:, 0] if name == "time" else part

    def error(self, run: int) -> str:
        """Return the error that the engine raised in a run's last call, or an empty string."""
        return self._errors[run]

    def rollout(
        self,
        nstep: int,
        control: Floats | None = None,
        control_spec: int = 0,
        record: Sequence[Any] = (),
        ids: Sequence[int] | None = None,
        out: dict[Any, np.ndarray] | None = None,
    ) -> dict[Any, np.ndarray]:
        """Make some steps and record after each; a run that warns stops and repeats its last row.

        Raises:
            SimulationError: the engine raised an error; that run is where it was.
        """
        runs = list(range(len(self._models)) if ids is None else ids)
        arrays = out or {item: self._array(item, len(runs), nstep) for item in record}
        for place, run in enumerate(runs):
            rows = {item: array[place] for item, array in arrays.items()}
            inputs = None if control is None else (control_spec, control[place])
            self._errors[run] = ""
            try:
                self._run(run, nstep, inputs, rows)
            except mujoco.FatalError as error:
                self._errors[run] = str(error)
        failed = [run for run in runs if self._errors[run]]
        if failed:
            raise SimulationError(f"run {failed[0]}: {self._errors[failed[0]]}")
        return arrays

    def _run(
        self, run: int, steps: int, inputs: tuple[int, Floats] | None, rows: dict[Any, np.ndarray]
    ) -> None:
        model, data = self._models[run], self._data(run)
        mujoco.mj_setState(model, data, self.state[run], _INTEGRATION)
        counts = data.warning.number
        before = counts.copy()
        with _filling(contact_slots(model) if rows else None):
            if rows or inputs is not None:
                _record(model, data, steps, inputs, rows)
            else:
                mujoco.mj_step(model, data, nstep=steps)
        self.warning[run, :, _COUNT] += data.warning.number - before
        mujoco.mj_getState(model, data, self.state[run], _INTEGRATION)

    def _data(self, run: int) -> mujoco.MjData:
        if self._kept is None:
            return mujoco.MjData(self._models[run])
        if run not in self._kept:
            self._kept[run] = mujoco.MjData(self._models[run])
        return self._kept[run]

    def _array(self, item: int | str, runs: int, steps: int) -> np.ndarray:
        model = self._models[0]
        if isinstance(item, int):
            return np.empty((runs, steps, mujoco.mj_stateSize(model, item)))
        own = np.asarray(getattr(mujoco.MjData(model), item))
        return np.empty((runs, steps, *(own.shape or (1,))), own.dtype)


def _record(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    steps: int,
    inputs: tuple[int, Floats] | None,
    rows: dict[Any, np.ndarray],
) -> None:
    """Step, and copy what is asked for into row k after step k."""
    # A view: reading it afresh would take longer than many a step.
    counts = data.warning.number
    before = counts.tobytes()
    states = [(item, array) for item, array in rows.items() if isinstance(item, int)]
    fields = [(item, array) for item, array in rows.items() if isinstance(item, str)]
    for step in range(steps):
        if inputs is not None:
            mujoco.mj_setState(model, data, inputs[1][step], inputs[0])
        mujoco.mj_step(model, data)
        for item, array in states:
            mujoco.mj_getState(model, data, array[step], item)
        for item, array in fields:
            array[step] = getattr(data, item)
        if counts.tobytes() != before:
            for array in rows.values():
                array[step + 1 :] = array[step]
            return


def _component(name: str) -> int:
    return int(getattr(mujoco.mjtState, f"mjSTATE_{name.upper()}"))


@contextmanager
def _filling(fill: ContactSlots | None) -> Generator[None]:
    """Fill contact slots within the engine's steps, where its own sensors do not."""
    if fill is None:
        yield
        return
    mujoco.set_mjcb_sensor(fill)
    try:
        yield
    finally:
        mujoco.set_mjcb_sensor(None)
