"""Listens to the steps of one simulation, whatever code makes them, until an episode is whole."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco import mj_step, mj_step2  # by themselves, since `listening` replaces the module's

from contactlab.accuracy.reference import PlannedModel
from contactlab.engines import Rollout
from contactlab.errors import OutputError, SceneError
from contactlab.loop.reader import INPUTS, LoopReader, LoopSteps, Since
from contactlab.schema.evidence import Loop
from contactlab.store.store_files import time_now

_OF_CONTACTS = tuple(
    f"{of}_{name}"
    for of in ("geom", "pair")
    for name in ("friction", "solref", "solimp", "margin", "gap")
)
_OF_STARTS = ("qpos", "qvel", "act", *INPUTS)
_FOR_THE_EYE = ("vis", "tex", "mat_", "skin", "light", "cam", "name", "text")


class Episode(NamedTuple):
    """An episode as a run: as it was made, what its setup and its record say besides."""

    plan: PlannedModel
    rollout: Rollout
    known: Mapping[str, object]
    started: str
    said: Mapping[str, object]


class Listener(ABC):
    """Reads the steps of one MjData as they are made.

    Attributes:
        closed: why no more steps are read; empty while they are.
    """

    def __init__(self, reader: LoopReader) -> None:
        self.closed = ""
        self._reader = reader
        self._before, self._set, self._started = reader.model, list[int](), ""

    @property
    def model(self) -> mujoco.MjModel:
        """The model that is recorded."""
        return self._reader.model

    @property
    def data(self) -> mujoco.MjData:
        """The data that is recorded."""
        return self._reader.data

    def step(self, count: int = 1) -> None:
        """Make steps, as `mujoco.mj_step(model, data, count)` does, and record each."""
        if self.closed or self._reader.look():
            self._attend()
        self._reader.make_steps(count)

    def mj_step(self, model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
        """Do what `mujoco.mj_step` does; steps of the recorded data are recorded."""
        if data is self._reader.data:
            self.step(nstep)
        else:
            mj_step(model, data, nstep)

    def mj_step2(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Do what `mujoco.mj_step2` does, after `mj_step1`; likewise."""
        if data is self._reader.data:
            self._attend()
        mj_step2(model, data)
        if data is self._reader.data:
            self._reader.read_step()

    @contextmanager
    def listening(self) -> Generator[None]:
        """Record what other code steps meanwhile by `mujoco.mj_step` or `mujoco.mj_step2`."""
        mujoco.mj_step, mujoco.mj_step2 = self.mj_step, self.mj_step2
        try:
            yield
        finally:
            mujoco.mj_step, mujoco.mj_step2 = mj_step, mj_step2

    def _attend(self) -> None:
        """Notice what happened since the last step, before the next one."""
        if self.closed:
            raise OutputError(self.closed)
        reader = self._reader
        while since := reader.look():
            match since:
                case Since.NEVER:
                    _check_start(reader.model, reader.data)
                    reader.clear()
                    self._before, self._set = copy.copy(reader.model), []
                    self._started = time_now()
                    reader.start()
                case Since.SET:
                    self._set.append(reader.steps)
                    reader.start()
                case Since.ELSEWHERE:
                    missed = reader.data.time > reader.time
                    self._cut("the data was stepped without the recording" if missed else None)
                case _ if reader.is_large:
                    self._cut("an episode's record takes 1 GiB at most; the next goes on from here")
                case _:
                    reader.grow(2 * reader.room)

    @abstractmethod
    def _cut(self, why: str | None) -> None:
        """End the episode before its next step; no reason is given where its time went back."""

    def _taken(self) -> LoopSteps:
        return self._reader.taken([0, *self._set])

    def _noticed(self, expected: mujoco.MjModel, unchecked: str) -> Loop:
        """Return what was noticed of the episode, whose model should have been the expected one."""
        return Loop(
            unchecked=unchecked,
            changed=changed_fields(expected, self._before),
            changed_under_way=changed_fields(self._before, self._reader.model),
            state_set=tuple(self._set),
        )


def _check_start(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise a SceneError for what no record can say of the start of an episode: no numbers."""
    for part, names in ((model, _OF_CONTACTS), (data, _OF_STARTS)):
        for name in names:
            if not np.isfinite(getattr(part, name)).all():
                raise SceneError(f"{name} is not finite where an episode begins")


def known_of(steps: LoopSteps) -> Mapping[str, object]:
    """Return what is known of a setup: what acts from outside may give energy."""
    driven = {"steered": True, "passive": False, "conservative": False}
    return driven if steps.is_driven else {}


def changed_fields(before: mujoco.MjModel, after: mujoco.MjModel) -> tuple[str, ...]:
    """Return the fields of a model that are not as they were, but for what is only seen."""
    return tuple(
        name
        for name, old, new in _fields(before, after)
        if np.asarray(old).tobytes() != np.asarray(new).tobytes()
    )


def write_fields(model: mujoco.MjModel, wanted: mujoco.MjModel) -> None:
    """Write what differs in the fields of another model of the same parts, in place."""
    for name in changed_fields(wanted, model):
        _, is_option, option = name.rpartition("opt.")
        of, to = (wanted.opt, model.opt) if is_option else (wanted, model)
        value = getattr(of, option)
        if isinstance(value, np.ndarray):
            getattr(to, option)[:] = value
        else:
            setattr(to, option, value)


def _fields(*models: mujoco.MjModel) -> Generator[tuple[Any, ...]]:
    first = models[0]
    for name in dir(first):
        seen = name.startswith(_FOR_THE_EYE) or name.endswith(("rgba", "matid", "group"))
        if not seen and isinstance(getattr(first, name), np.ndarray):
            yield name, *(getattr(model, name) for model in models)
    for name in dir(first.opt):
        if not name.startswith("_"):
            yield f"opt.{name}", *(getattr(model.opt, name) for model in models)
