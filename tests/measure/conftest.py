"""Traces made by hand, whose measures are known."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import (
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    TANGENT,
    BackwardError,
    PairTrace,
    SelfChecks,
    Trace,
)
from contactlab.contact.trace_setup import End, ExpectedContact, FreeBody, Setup

GRAVITY = 9.81

MakeTrace = Callable[..., Trace]
MakeSetup = Callable[..., Setup]


def make_pair(runs: int, steps: int, slots: int = 1, **columns: Any) -> PairTrace:
    """Return a pair that touches wherever `normal` (n, N, S) is positive; frame z, x, y."""
    block = np.zeros((runs, steps, slots, 23))
    for name, column in (("normal", FORCE.start), ("distance", DISTANCE)):
        if name in columns:
            block[..., column] = columns[name]
    if "tangential" in columns:
        block[..., FORCE.start + 1 : FORCE.stop] = columns["tangential"]
    if "velocity" in columns:
        block[..., LINEAR_VELOCITY.start + 1 : LINEAR_VELOCITY.stop] = columns["velocity"]
    touching = columns.get("touching", block[..., FORCE.start] > 0)
    block[..., FOUND] = touching * np.sum(touching, axis=-1, keepdims=True)
    block[..., NORMAL] = touching[..., None] * np.array([0.0, 0.0, 1.0])
    block[..., TANGENT] = touching[..., None] * np.array([1.0, 0.0, 0.0])
    mu = columns.get("friction", 0.5)
    friction = np.tile([mu, mu, 0.005, 1e-4, 1e-4], (runs, 1))
    return PairTrace(columns.get("name", "floor-box"), block, friction)


def make_trace(runs: int = 1, steps: int = 100, timestep: float = 2e-3, **changes: Any) -> Trace:
    """Return a healthy trace of one free body at rest, without pairs, and the changes."""
    zeros = np.zeros((runs, steps))
    counts = zeros.astype(np.int32)
    position = np.zeros((runs, steps + 1, 7))
    position[..., 3] = 1
    healthy = Trace(
        timestep=np.full(runs, timestep),
        steps_asked=steps,
        time=np.tile(timestep * np.arange(steps + 1, dtype=np.float64), (runs, 1)),
        qpos=position,
        qvel=np.zeros((runs, steps + 1, 6)),
        kinetic=zeros.copy(),
        potential=zeros.copy(),
        contacts=counts,
        least_distance=zeros.copy(),
        iterations=counts.copy(),
        iterations_most=counts.copy(),
        momentum=None,
        angular_momentum=None,
        pairs=(),
        warnings=tuple({} for _ in range(runs)),
    )
    return replace(healthy, **changes)


def make_setup(trace: Trace, **changes: Any) -> Setup:
    """Return the setup of a trace of one free body of 1 kg, and the changes.

    `first_mode` and `last_mode` are what every pair must do.
    """
    runs = trace.runs
    window, pairs = np.tile([0.0, np.inf], (runs, 1)), tuple(range(len(trace.pairs)))
    words: dict[End, Any] = {
        "first": changes.pop("first_mode", None),
        "last": changes.pop("last_mode", None),
    }
    plain = Setup(
        settings={},
        elliptic=np.ones(runs, dtype=np.bool_),
        iterations=np.full(runs, 100, dtype=np.int32),
        gravity=np.tile([0.0, 0.0, -GRAVITY], (runs, 1)),
        moving_mass=np.ones(runs),
        size=0.1,
        exact=1e-6,
        steered=False,
        passive=True,
        conservative=False,
        quaternions=(3,),
        free_bodies=(FreeBody("box", 0, 0, np.ones(runs)),),
        barriers=(),
        thickness=np.full(len(trace.pairs), np.inf),
        reaches=np.full(len(trace.pairs), 0.1),
        widths=np.zeros(len(trace.pairs)),
        masses=np.full(len(trace.pairs), np.inf),
        slots=np.array([pair.slots.shape[2] for pair in trace.pairs], dtype=np.int32),
        duration=trace.timestep * trace.steps_asked,
        expected=tuple(
            ExpectedContact("every pair", pairs, window, word, end)
            for end, word in words.items()
            if word
        ),
    )
    return replace(plain, **changes)


@pytest.fixture(scope="session")
def pair_of() -> Callable[..., PairTrace]:
    return make_pair


@pytest.fixture(scope="session")
def trace_of() -> MakeTrace:
    return make_trace


@pytest.fixture(scope="session")
def setup_of() -> MakeSetup:
    return make_setup


def make_checks(steps: int, residual: float = 0.0, backward: float | None = None) -> SelfChecks:
    """Return what a second pass found of one run: what a solver left, and phantom forces."""
    none = np.zeros((1, 1))
    return SelfChecks(
        residual=np.full((1, steps), residual),
        jacobian=none,
        jacobian_steps=np.zeros((1, 1), np.intp),
        overlap=none,
        apart=none,
        geometry_steps=np.zeros(1, np.intp),
        squeeze=np.empty((1, 0)),
        repeats=np.ones(1, np.bool_),
        backward=() if backward is None else (BackwardError(backward, "b", 0.0, 0.0, "b", 0.0),),
    )


@pytest.fixture
def checks_of() -> Callable[..., SelfChecks]:
    return make_checks
