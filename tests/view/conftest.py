"""Small stores of real runs, made once, and random motions."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from contactlab.contact.trace_arrays import Trace
from contactlab.plan.sweep_file import read_sweep
from contactlab.run.stored_runs import PreparedReplay, prepare_replay
from contactlab.run.sweep_request import SceneLoader, SweepRequest
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace
from contactlab.view.drawn_motion import BodyMotion, ContactForces, JointMotion, Stage
from contactlab.view.drawn_shapes import BodyShape, Form

SWEEPS = {
    "ball": "{version: 1, scene: ball_drop, duration: 0.4, axes: {drop_height: [0.1]}}",
    "slide": "{version: 1, scene: box_slide, duration: 0.3, axes: {direction: [22.5]}}",
    "stack": "{version: 1, scene: box_stack, duration: 0.1, axes: {boxes: [3]}, seeds: 1}",
    "untraced": "{version: 1, scene: ball_drop, duration: 0.05, trace: none}",
}


class Drawn(NamedTuple):
    """A store of one run, what is known of the run, and its trace."""

    store: Store
    run: str
    start: PreparedReplay
    trace: StoredTrace

    @property
    def model(self) -> mujoco.MjModel:
        return self.start.prepared_model.model


@pytest.fixture(scope="session")
def make_store(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Store]:
    folder = tmp_path_factory.mktemp("drawn")

    def make(name: str) -> Store:
        if not (folder / name).exists():
            scenes = SceneLoader(folder)
            read = read_sweep(SWEEPS[name], scenes.vocabulary)
            ask = SweepRequest(
                plan=read.plan,
                scene=scenes.open(read.sweep.scene),
                name=name,
                source=SWEEPS[name],
                overrides=(),
                store=folder / name,
                workers=0,
            )
            run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
        return Store.open(folder / name)

    return make


@pytest.fixture(scope="session")
def drawn(make_store: Callable[[str], Store]) -> Callable[[str], Drawn]:
    def pick(name: str) -> Drawn:
        store = make_store(name)
        [run] = store.table["run_id"].to_pylist()
        start = prepare_replay(store, run)
        return Drawn(store, run, start, store.trace(start.record))

    return pick


@pytest.fixture
def target(tmp_path: Path) -> Callable[[str], Path]:
    return lambda suffix: tmp_path / f"run{suffix}"


FORMS: tuple[Form, ...] = ("box", "ellipsoid", "cylinder", "mesh")
BODIES = ("world", "ball", "größe/2 b")


def unit(rng: np.random.Generator, *shape: int) -> np.ndarray:
    values = rng.standard_normal((*shape, 4))
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def shape_of(rng: np.random.Generator, body: int, form: Form) -> BodyShape:
    corners = 4 if form == "mesh" else 0
    return BodyShape(
        name=f"{form} {body}",
        body=body,
        form=form,
        size=rng.uniform(0.1, 2, 3),
        position=rng.standard_normal(3),
        rotation=unit(rng),
        colour=rng.uniform(size=4),
        vertices=rng.standard_normal((corners, 3)),
        triangles=rng.integers(0, 4, (corners, 3)).astype(np.int32),
    )


def random_motion(trace: Trace, rows: list[int], most: int = 3, seed: int = 0) -> BodyMotion:
    """Return a motion with frames at some state rows and up to `most` forces in each."""
    rng = np.random.default_rng(seed)
    frames, bodies = len(rows), len(BODIES)
    frame = np.repeat(np.arange(frames), rng.integers(0, most + 1, frames))
    force = rng.standard_normal((len(frame), 3)) * 10.0 ** rng.integers(-3, 4, (len(frame), 1))
    return BodyMotion(
        bodies=BODIES,
        moving=np.array([False, True, True]),
        shapes=tuple(shape_of(rng, body, form) for body in range(bodies) for form in FORMS),
        rows=np.array(rows),
        time=trace.time[0, rows],
        positions=rng.standard_normal((frames, bodies, 3)),
        rotations=unit(rng, frames, bodies),
        joints=JointMotion(
            ("hinge", 'slide "a"'),
            rng.standard_normal((frames, 2)),
            rng.standard_normal((frames, 2)),
        ),
        pairs=tuple(pair.name for pair in trace.pairs),
        forces=ContactForces(
            frame=frame,
            pair=rng.integers(0, max(1, len(trace.pairs)), len(frame)),
            mode=rng.integers(0, 3, len(frame)).astype(np.int8),
            position=rng.standard_normal((len(frame), 3)),
            force=force,
        ),
        stage=Stage(np.zeros(3), 2.0),
        scale=0.05,
        longest=2.0,
    )


@pytest.fixture(scope="session")
def make_motion() -> Callable[..., BodyMotion]:
    return random_motion
