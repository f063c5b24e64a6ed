"""Listens to the steps of one simulation, made by any code, until an episode is complete."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np
from mujoco import (
    mj_step,
    mj_step2,
)  # as names of their own, since `listening` replaces the module's

from contactlab.accuracy.reference import PlannedModel
from contactlab.engines import Rollout
from contactlab.errors import OutputError, SceneError
from contactlab.loop.reader import INPUTS, LoopReader, LoopSteps, StepEvent
from contactlab.schema.evidence import Loop
from contactlab.store.store_files import time_now

_CONTACT_FIELDS = tuple(
    f"{of}_{name}"
    for of in ("geom", "pair")
    for name in ("friction", "solref", "solimp", "margin", "gap")
)
_START_FIELDS = ("qpos", "qvel", "act", *INPUTS)
_VISUAL_PREFIXES = ("vis", "tex", "mat_", "skin", "light", "cam", "name", "text")


class Episode(NamedTuple):
    """An episode as a run: its plan, its rollout, and further fields of its setup and record."""

    plan: PlannedModel
    rollout: Rollout
    given_metrics: Mapping[str, object]
    started: str
    extra_fields: Mapping[str, object]


class HearsSteps(Protocol):
    """Makes the steps of other code, in the place of MuJoCo's own functions."""

    def mj_step(self, model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
        """Make steps."""
        ...

    def mj_step2(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Finish a step."""
        ...


@contextmanager
def hear_steps(listener: HearsSteps) -> Generator[None]:
    """Let a listener make the steps of other code by `mj_step` or `mj_step2` meanwhile."""
    mujoco.mj_step, mujoco.mj_step2 = listener.mj_step, listener.mj_step2
    try:
        yield
    finally:
        mujoco.mj_step, mujoco.mj_step2 = mj_step, mj_step2


class Listener(ABC):
    """Reads the steps of one MjData while they are made.

    Attributes:
        closed: the reason why no more steps are read; empty while they are.
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
            self._handle_changes()
        self._reader.make_steps(count)

    def mj_step(self, model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
        """Do the same as `mujoco.mj_step`, and record steps of the recorded data."""
        if data is self._reader.data:
            self.step(nstep)
        else:
            mj_step(model, data, nstep)

    def mj_step2(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Do the same as `mujoco.mj_step2` after `mj_step1`, and record steps of the data."""
        if data is self._reader.data:
            self._handle_changes()
        mj_step2(model, data)
        if data is self._reader.data:
            self._reader.read_step()

    @contextmanager
    def listening(self) -> Generator[None]:
        """Record the steps of other code by `mujoco.mj_step` or `mujoco.mj_step2` meanwhile."""
        with hear_steps(self):
            yield

    def _handle_changes(self) -> None:
        """Handle changes since the last step, before the next one."""
        if self.closed:
            raise OutputError(self.closed)
        reader = self._reader
        while since := reader.look():
            match since:
                case StepEvent.NEVER:
                    _check_finite_start(reader.model, reader.data)
                    reader.clear()
                    self._before, self._set = copy.copy(reader.model), []
                    self._started = time_now()
                    reader.start()
                case StepEvent.SET:
                    self._set.append(reader.steps)
                    reader.start()
                case StepEvent.ELSEWHERE:
                    has_missed_steps = reader.data.time > reader.time
                    self._cut_episode(
                        "the data was stepped without the recording" if has_missed_steps else None
                    )
                case _ if reader.is_large:
                    self._cut_episode(
                        "an episode's record is limited to 1 GiB; the next continues here"
                    )
                case _:
                    reader.grow(2 * reader.room)

    @abstractmethod
    def _cut_episode(self, why: str | None) -> None:
        """End the episode before its next step; there is no reason if its time decreased."""

    def _take_steps(self) -> LoopSteps:
        return self._reader.take_steps([0, *self._set])

    def _loop_record(self, expected: mujoco.MjModel, unchecked: str) -> Loop:
        """Return changes of the episode's model and state, against an expected model."""
        return Loop(
            unchecked=unchecked,
            changed=changed_fields(expected, self._before),
            changed_under_way=changed_fields(self._before, self._reader.model),
            state_set=tuple(self._set),
        )


def _check_finite_start(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise a SceneError for values that no record can hold at the start: no finite numbers."""
    for part, names in ((model, _CONTACT_FIELDS), (data, _START_FIELDS)):
        for name in names:
            if not np.isfinite(getattr(part, name)).all():
                raise SceneError(f"{name} is not finite at the start of an episode")


def known_setup(steps: LoopSteps) -> Mapping[str, object]:
    """Return known properties of a setup: external inputs may add energy."""
    driven = {"steered": True, "passive": False, "conservative": False}
    return driven if steps.is_driven else {}


def changed_fields(before: mujoco.MjModel, after: mujoco.MjModel) -> tuple[str, ...]:
    """Return the changed fields of a model, except for purely visual ones."""
    # A small model is compared whole first, since its fields take longer one by one. The meshes and
    # textures of a large one take longer to copy.
    small = 1_000_000  # bytes
    if mujoco.mj_sizeModel(before) < small and np.array_equal(
        _model_bytes(before), _model_bytes(after)
    ):
        return ()
    return tuple(
        name
        for name, old, new in _physical_fields(before, after)
        if not np.array_equal(_as_integers(old), _as_integers(new))
    )


def _as_integers(value: object) -> np.ndarray:
    # The bits of a field, without a copy.
    array = np.asarray(value).ravel()
    return array.view(f"i{array.itemsize}")


def _model_bytes(model: mujoco.MjModel) -> np.ndarray:
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer


def write_fields(model: mujoco.MjModel, target: mujoco.MjModel) -> None:
    """Copy differing fields from another model with the same parts, in place."""
    for name in changed_fields(target, model):
        _, is_option, option = name.rpartition("opt.")
        of, to = (target.opt, model.opt) if is_option else (target, model)
        value = getattr(of, option)
        if isinstance(value, np.ndarray):
            getattr(to, option)[:] = value
        else:
            setattr(to, option, value)


def _physical_fields(*models: mujoco.MjModel) -> Generator[tuple[Any, ...]]:
    fields, options = _field_names()
    for name in fields:
        yield name, *(getattr(model, name) for model in models)
    for name in options:
        yield f"opt.{name}", *(getattr(model.opt, name) for model in models)


@cache
def _field_names() -> tuple[tuple[str, ...], tuple[str, ...]]:
    # Each episode asks several times, and `dir` takes longer than to compare all fields.
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    fields = (
        name
        for name in dir(model)
        if not (name.startswith(_VISUAL_PREFIXES) or name.endswith(("rgba", "matid", "group")))
        and isinstance(getattr(model, name), np.ndarray)
    )
    return tuple(fields), tuple(name for name in dir(model.opt) if not name.startswith("_"))
