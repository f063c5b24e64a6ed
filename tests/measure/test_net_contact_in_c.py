"""Series of a pair have the same bits whether C or NumPy reduces its slots."""

import os
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.sanitizers import run_sanitized

from contactlab import native, resources
from contactlab.contact.trace_arrays import DISTANCE, FORCE, FOUND, Floats, PairTrace
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import CompilerError
from contactlab.measure import net_contact as module
from contactlab.measure.net_contact import net_contact
from contactlab.scene.scene import Scene
from contactlab.store.control_tables import read_control_table

SWITCH = "CONTACTLAB_KERNEL"
SOURCE = Path(module.__file__).with_suffix(".c")
AWKWARD = (np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, 1e200, 1.7976931348623157e308)
STEPS, SECONDS = 200, 0.3
# Those whose sums NumPy makes one by one, by eights, and by halves.
SLOTS = (1, 2, 4, 7, 8, 9, 20, 150)


@pytest.fixture(autouse=True, scope="module")
def compiler() -> Iterator[None]:
    """Have a compiler, and the caller's switch again in the end."""
    try:
        native.compiled(SOURCE)
    except CompilerError as error:
        pytest.skip(str(error))
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv(SWITCH, raising=False)
        yield


def reduced(way: str, pair: PairTrace, elliptic: np.ndarray[Any, Any], timestep: Floats) -> Any:
    os.environ[SWITCH] = way
    with np.errstate(all="ignore"):
        return net_contact([pair], elliptic, timestep, pair.slots.shape[1])


def assert_same_bits(pair: PairTrace, elliptic: np.ndarray[Any, Any], timestep: Floats) -> None:
    in_c, in_numpy = (reduced(way, pair, elliptic, timestep) for way in ("on", "off"))
    for one, other in ((in_c, in_numpy), (in_c.series, in_numpy.series)):
        for each in fields(one):
            value, expected = getattr(one, each.name), getattr(other, each.name)
            if isinstance(expected, np.ndarray):
                assert (value.dtype, value.shape) == (expected.dtype, expected.shape)
                assert value.tobytes() == expected.tobytes(), each.name


def random_slots(rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
    """Return slots (n, N, S, 23) filled from the first, of frames that may differ."""
    values = rng.normal(size=(*shape, 23)) * 10.0 ** rng.integers(-3, 4)
    values[..., FORCE.start] -= rng.choice([0, 1]) * 2 * np.minimum(values[..., FORCE.start], 0)
    values[..., FORCE] *= rng.choice([0, 1, 1, 1], 3)
    if rng.random() < 0.5:
        values[..., DISTANCE] = -np.abs(values[..., DISTANCE])
    if rng.random() < 0.5:
        values[..., 11:17] = rng.normal(size=6)
    if rng.random() < 0.4:
        odd = rng.random(values.shape) < rng.choice([1e-4, 1e-2, 0.3])
        values = np.where(odd, rng.choice(AWKWARD, values.shape), values)
    filled = (rng.random(shape) < rng.choice([0.0, 0.3, 0.9, 1.0])).sum(axis=2, keepdims=True)
    touching = np.arange(shape[2]) < filled
    values[~touching] = 0
    more = rng.integers(0, 3, (*shape[:2], 1))
    values[..., FOUND] = np.where(touching, filled + more, 0)
    return values


@settings(deadline=None, max_examples=200)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(1, 3), st.sampled_from((0, 1, 2, 40)), st.sampled_from(SLOTS)),
    st.sampled_from(("together", "within rows", "scattered")),
)
def test_random_slots(seed: int, shape: tuple[int, int, int], layout: str) -> None:
    rng, (runs, steps, slots) = np.random.default_rng(seed), shape
    block = random_slots(rng, shape)
    if layout == "within rows":
        rows = np.full((runs, steps, 23 * slots + 5), np.nan)
        rows[:, :, 3:-2] = block.reshape(runs, steps, 23 * slots)
        block = rows[:, :, 3:-2].reshape(runs, steps, slots, 23)
    elif layout == "scattered":
        block = np.asfortranarray(block)
    friction = rng.uniform(0, 1, (runs, 5)) * rng.choice([0, 1, 1, 1])
    friction[:, 1] = friction[:, rng.integers(2)]
    pair = PairTrace("a-b", block, friction)
    assert_same_bits(pair, rng.random(runs) < 0.5, rng.uniform(1e-3, 1e-1, runs))


@pytest.mark.parametrize("name", resources.scene_names())
def test_scenes(name: str) -> None:
    scene = Scene.open(name, tables=read_control_table)
    steps = scene.resolve({}, 0, None).timestep
    resolved = [scene.resolve({}, seed, min(SECONDS, STEPS * steps)) for seed in range(2)]
    runs = PreparedRuns.of(scene, *resolved)
    trace = make_trace(runs.base, runs.prepared, MujocoEngine().roll_out(runs, Buffers()))
    for pair in trace.pairs:
        for elliptic in (False, True):
            assert_same_bits(pair, np.full(2, elliptic), trace.timestep)


def test_what_is_finite_is_not_left_to_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or the other tests would compare NumPy with itself."""
    monkeypatch.setenv(SWITCH, "on")
    monkeypatch.setattr(module, "_reduced", None)
    monkeypatch.setattr(module, "agrees", lambda *_: True)
    block = np.random.default_rng(0).uniform(0.1, 1, (2, 30, 3, 23))
    block[..., FOUND] = 3
    pair = PairTrace("a-b", block, np.ones((2, 5)))
    net = net_contact([pair], np.array([True, False]), np.ones(2), 30)
    assert (net.series.normal > 0).all()


def test_counts_that_no_contact_has_are_none() -> None:
    """As a damaged trace may have them: beyond what 32 bits count."""
    block = np.random.default_rng(0).uniform(0.1, 1, (1, 30, 2, 23))
    block[:, ::2, :, FOUND], block[:, 1::2, :, FOUND] = np.nan, 2.0**32
    with np.errstate(all="ignore"):
        assert_same_bits(PairTrace("a-b", block, np.ones((1, 5))), np.array([True]), np.ones(1))


def test_a_numpy_that_disagrees_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first result of a process is compared, as if NumPy added in another order."""
    monkeypatch.setenv(SWITCH, "on")
    monkeypatch.setattr(native, "_agreed", set())
    monkeypatch.setattr(native, "_given_up", set())
    true = module._reduced  # pyright: ignore[reportPrivateUsage]

    def other(*arguments: Any) -> Any:
        (normal, *series), worst = true(*arguments)
        return (np.nextafter(normal, np.inf), *series), worst

    monkeypatch.setattr(module, "_reduced", other)
    block = np.random.default_rng(0).uniform(0.1, 1, (2, 30, 3, 23))
    block[..., FOUND] = 3
    pairs, rest = [PairTrace("a-b", block, np.ones((2, 5)))], (np.array([True, False]), np.ones(2))
    with pytest.warns(UserWarning, match="disagrees with NumPy") as said:
        first = net_contact(pairs, *rest, 30)
    assert len(said) == 1
    assert native.functions_of(SOURCE) is None
    assert (first.series.normal == net_contact(pairs, *rest, 30).series.normal).all()
    monkeypatch.setenv(SWITCH, "off")
    assert (first.series.normal == net_contact(pairs, *rest, 30).series.normal).all()


@pytest.mark.slow
def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    """The tests of this file again, in C that stops at whatever it leaves undefined."""
    said = run_sanitized(__file__, "random_slots or left_to_numpy", tmp_path)
    assert "2 passed" in said
