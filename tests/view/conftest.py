"""Small stores of real runs, made once, and one of their runs as it is drawn."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mujoco
import pytest

from contactlab.plan import read_sweep
from contactlab.run import Ask, Scenes, prepare, run_sweep
from contactlab.run.replay import Start
from contactlab.store import Store
from contactlab.store.mcap import StoredTrace

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
    start: Start
    trace: StoredTrace

    @property
    def model(self) -> mujoco.MjModel:
        return self.start.prepared.model


@pytest.fixture(scope="session")
def make_store(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Store]:
    folder = tmp_path_factory.mktemp("drawn")

    def make(name: str) -> Store:
        if not (folder / name).exists():
            scenes = Scenes(folder)
            read = read_sweep(SWEEPS[name], scenes.vocabulary)
            ask = Ask(
                plan=read.plan,
                scene=scenes.open(read.sweep.scene),
                name=name,
                source=SWEEPS[name],
                overrides=(),
                store=folder / name,
                workers=0,
            )
            run_sweep(ask, begin=lambda _total, _done: None, progress=lambda _: None)
        return Store.open(folder / name)

    return make


@pytest.fixture(scope="session")
def drawn(make_store: Callable[[str], Store]) -> Callable[[str], Drawn]:
    def pick(name: str) -> Drawn:
        store = make_store(name)
        [run] = store.table["run_id"].to_pylist()
        start = prepare(store, run)
        return Drawn(store, run, start, store.trace(start.record))

    return pick


@pytest.fixture
def target(tmp_path: Path) -> Callable[[str], Path]:
    return lambda suffix: tmp_path / f"run{suffix}"
