"""An engine of one class in one file, added to `ENGINES`: sweeps, records and replays have it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from contactlab.engines import (
    ENGINES,
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    SimulationEngine,
    Watch,
    no_limit,
    proceed_always,
)
from contactlab.errors import EngineError, PluginError, SceneError
from contactlab.run.stored_runs import replay_run
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.setting_values import as_number
from contactlab.store.finished_store import Store


class FreeFallEngine(SimulationEngine):
    """A single free body that does not turn and meets nothing, by its closed form."""

    name = "free_fall"
    summary = "the closed form of free fall"

    @property
    def version(self) -> str:
        """The version of this file."""
        return "2.5"

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:
        """Return why it cannot simulate a run: more than one free body, or what could touch it."""
        model, start = scene.base_of(run).model, scene.initial_states([run])
        if (model.nq, model.nv, model.ngeom) != (7, 6, 1) or start.qvel[0, 3:].any():
            return "the free_fall engine moves one free body that does not turn; use engine: mujoco"
        return super().refusal(scene, run)

    def ignored(self, run: RunSpec) -> Mapping[str, str]:
        """Return what solves nothing here."""
        reason = f"a closed form needs no {run.settings['solver']}"
        return {"warmstart": reason, "solver": reason}

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate bodies in free fall."""
        count = len(runs.prepared)
        arrays = buffers.arrays(runs.base.model, count, runs.steps)
        arrays.state[:], arrays.sensors[:], arrays.iterations[:] = 0.0, 0.0, 0
        for run, model in enumerate(runs.models):
            if run and not proceed():
                count = run
                break
            watch()
            time = np.arange(runs.steps + 1) * model.opt.timestep
            start, speed = runs.starts.qpos[run], runs.starts.qvel[run]
            fall = model.opt.gravity * time[:, None]
            arrays.state[run, :, 0] = time
            arrays.state[run, :, 1:8], arrays.state[run, :, 8:] = start, speed
            arrays.state[run, :, 1:4] += speed[:3] * time[:, None] + fall * time[:, None] / 2
            arrays.state[run, :, 8:11] += fall
            mass, velocity = model.body_mass[1], arrays.state[run, :-1, 8:11]
            layout = runs.base.layout
            arrays.sensors[run, :, layout.kinetic] = mass / 2 * (velocity**2).sum(axis=1)
            weight = -mass * model.opt.gravity
            arrays.sensors[run, :, layout.potential] = arrays.state[run, :-1, 1:4] @ weight
        return Rollout.completed(arrays, np.zeros(count))


STONE = """
<mujoco>
  <worldbody><body pos="0 0 5"><freejoint/><geom size=".1" mass="2"/></body></worldbody>
</mujoco>
"""
SWEEP = """
version: 1
scene: stone.xml
duration: 0.5
axes:
  engine: [mujoco, free_fall]
  timestep: [1.0e-3, 5.0e-3]
accuracy: {refine: 2}
timing: {rounds: 3}
knife_edge: true
checks: all
"""


@pytest.fixture(autouse=True)
def _added(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, _registries_restored: None) -> None:
    monkeypatch.chdir(tmp_path)
    ENGINES.add(FreeFallEngine())
    Path("stone.xml").write_text(STONE)


def swept(text: str) -> Store:
    request = read_request(text, "fall", Path("store"), folder=Path(), workers=0)
    run_sweep(request, lambda *_: None, lambda _finished: None)
    return Store.open(Path("store"))


def by_engine(store: Store) -> dict[str, list[EvidenceRecord]]:
    found: dict[str, list[EvidenceRecord]] = {}
    for record in store.records():
        found.setdefault(record.engine.name, []).append(record)
    return found


@pytest.mark.long
def test_a_sweep_has_it_as_a_value_of_an_axis() -> None:
    """Positions are exact; MuJoCo's semi-implicit Euler falls by g h t / 2 more."""
    store = swept(SWEEP)
    records = by_engine(store)
    assert [len(each) for each in records.values()] == [2, 2]
    assert {record.engine.version for record in records["free_fall"]} == {"2.5"}
    for record, other in zip(records["free_fall"], records["mujoco"], strict=True):
        assert record.status == "ok"
        assert record.axes["engine"] == "free_fall"
        height, higher = (store.trace(each).qpos[-1, 2] for each in (record, other))
        assert height == pytest.approx(5 - 9.81 * 0.5**2 / 2, abs=1e-12)
        timestep = as_number(record.settings["timestep"])
        assert height - higher == pytest.approx(9.81 * timestep / 4, abs=1e-9)
        assert abs(record.metrics["energy_drift"] or 0) < 1e-12


@pytest.mark.long
def test_the_record_has_what_it_ignores_as_off() -> None:
    records = by_engine(swept(SWEEP))
    for record in records["free_fall"]:
        assert not record.effects["warmstart"]
        assert record.effect_reasons["warmstart"] == "a closed form needs no Newton"
        assert record.effects["gravity"]
    assert all(record.effects["warmstart"] for record in records["mujoco"])


@pytest.mark.long
def test_passes_leave_out_what_it_cannot_do() -> None:
    records = by_engine(swept(SWEEP))
    for record in records["mujoco"]:
        assert record.accuracy is not None
        assert record.timing is not None
        assert record.accuracy.error_final is not None
        assert record.timing.time_min is not None
    for record in records["free_fall"]:
        assert record.accuracy is not None
        assert record.accuracy.error_final is None
        assert record.timing is not None
        assert record.timing.time_min is None


@pytest.mark.long
def test_it_replays_its_runs() -> None:
    store = swept(SWEEP)
    for record in by_engine(store)["free_fall"]:
        assert replay_run(store, record.run_id).equal


def test_what_it_cannot_do_is_refused_before_anything_runs() -> None:
    text = SWEEP.replace("stone.xml", "ball_drop")
    with pytest.raises(SceneError, match="free_fall engine moves one free body"):
        swept(text)
    assert not Path("store").exists()


@pytest.mark.parametrize("name", ["warmstart: [false]", "solver: [CG]"])
def test_what_it_ignores_cannot_be_swept(name: str) -> None:
    text = SWEEP.replace("  timestep: [1.0e-3, 5.0e-3]", f"  {name}")
    with pytest.raises(SceneError, match=f"free_fall engine ignores {name.partition(':')[0]}"):
        swept(text)


def test_the_axis_lists_it() -> None:
    axis = Scene.open("stone.xml", Path(), ENGINES).catalogue.find_axis("engine")
    assert axis is not None
    assert axis.parse("free_fall") == "free_fall"
    assert "free_fall" in axis.choices


@pytest.mark.long
def test_without_it_a_stored_run_says_what_is_missing() -> None:
    store = swept(SWEEP)
    run = by_engine(store)["free_fall"][0].run_id
    ENGINES.pop("free_fall")
    with pytest.raises(EngineError, match=r"no engine 'free_fall'; .*; if a plug-in adds it"):
        replay_run(store, run)


def test_no_two_engines_share_a_name() -> None:
    with pytest.raises(PluginError, match="engine named 'free_fall'"):
        ENGINES.add(FreeFallEngine())
