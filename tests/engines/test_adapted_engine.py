"""An engine behind an adapter gives what it computes; what goes wrong there stays there.

The engine is MuJoCo itself, in another process: its trajectories are ours bit for bit.
"""

import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.engines import ENGINES
from contactlab.engines.adapted_engine import SERVER, AdaptedEngine
from contactlab.errors import SceneError
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

TWIN = '''
"""MuJoCo in another process."""

import mujoco
import numpy as np

PACKAGE = "twin"
REQUIREMENTS = ("mujoco=={mujoco}", "twin")

def refusal(model):
    return "gravity is off" if not model.opt.gravity.any() else None

def simulate(request, tick):
    print("a banner that an engine prints")
    made = [run(request, row, tick) for row in range(len(request["models"]))]
    return {key: np.array([each[key] for each in made]) for key in made[0]}

def run(request, row, tick):
    binary = request["models"][row]
    model = mujoco.MjModel.from_binary_path("m.mjb", {"m.mjb": binary})
    data = mujoco.MjData(model)
    for name in ("qpos", "qvel", "ctrl", "act"):
        getattr(data, name)[:] = request[name][row]
    data.xfrc_applied[:] = request["applied"][row].reshape(-1, 6)
    states, sensors, iterations = [np.concatenate([data.qpos, data.qvel, data.act])], [], []
    for step in range(request["steps"]):
        for place, level in zip(request["places"], request["levels"][row, step]):
            assert place < model.nu
            data.ctrl[place] = level
        EXTRA
        mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel, data.act]))
        sensors.append(data.sensordata.copy())
        iterations.append(data.solver_niter[0])
        if step % 100 == 0:
            tick()
    return {"state": states, "sensors": sensors, "iterations": iterations, "cost": 1.5,
            "contactfull": OVERFLOW}
'''
SWEEP = """
version: 1
scene: cart.xml
duration: 0.4
seeds: 2
drive: {noise: 0.5, rate: 10}
axes: {engine: [mujoco, twin], timestep: [0.001, 0.002]}
"""
CART = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="cart" pos="0 0 .1">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="1" friction=".2"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="x" ctrlrange="-5 5"/></actuator>
</mujoco>
"""

pytestmark = pytest.mark.usefixtures("_registries_restored")
Install = Callable[..., AdaptedEngine]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Return what adds the engine, with an environment that is this one."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "cart.xml").write_text(CART)

    def add(extra: str = "pass", overflow: str = "False") -> AdaptedEngine:
        file = tmp_path / "twin.py"
        file.write_text(TWIN.replace("EXTRA", extra).replace("OVERFLOW", overflow))
        engine = AdaptedEngine(file)
        python = engine.environment / "bin/python"
        python.parent.mkdir(parents=True)
        python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
        python.chmod(0o755)
        metadata = engine.environment / "lib/python3/site-packages/twin-7.1.dist-info/METADATA"
        metadata.parent.mkdir(parents=True)
        metadata.write_text("Metadata-Version: 2.1\nName: twin\nVersion: 7.1\n")
        ENGINES.add(engine)
        return engine

    return add


def swept(folder: Path, text: str = SWEEP) -> Store:
    """Run a sweep in this process."""
    request = read_request(text, "twins", folder / "store", folder=folder, workers=0)
    run_sweep(request, lambda *_: None, lambda _finished: None)
    return Store.open(folder / "store")


def pairs(store: Store) -> list[tuple[Any, Any]]:
    """Return the runs of both engines that are alike but for the engine."""
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for record in store.records():
        found.setdefault((record.axes["timestep"], record.seed), {})[record.engine.name] = record
    return [(each["mujoco"], each["twin"]) for each in found.values()]


@pytest.mark.long
def test_another_process_makes_the_same_runs(install: Install, tmp_path: Path) -> None:
    install()
    store = swept(tmp_path)
    assert len(pairs(store)) == 4
    for ours, theirs in pairs(store):
        assert (theirs.engine.version, theirs.label) == ("7.1", ours.label)
        assert theirs.cost.cpu_s == 1.5
        one, other = store.trace(ours), store.trace(theirs)
        # Its clock is steps times the timestep, not their sum.
        assert other.time == pytest.approx(one.time, abs=1e-12)
        for name in ("qpos", "qvel"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        ours_pair, their_pair = one.pair("floor-cart"), other.pair("floor-cart")
        for name in ours_pair.units:
            assert getattr(ours_pair, name).tobytes() == getattr(their_pair, name).tobytes()
        for metric in ("penetration_max", "slip_distance", "solver_iterations_mean"):
            assert theirs.metrics[metric] == ours.metrics[metric]
    assert find_problems(tmp_path / "store") == []


@pytest.mark.long
def test_what_is_raised_there_is_told_of_its_runs(install: Install, tmp_path: Path) -> None:
    install(extra='if step == 7: raise ValueError("no\\nway")')
    for ours, theirs in pairs(swept(tmp_path)):
        assert ours.status == "ok"
        assert (theirs.status, theirs.steps) == ("error", 0)
        assert "ValueError: no way" in theirs.status_reason


@pytest.mark.long
def test_a_process_that_dies_costs_its_job(install: Install, tmp_path: Path) -> None:
    engine = install(extra="import os; os._exit(3) if step == 7 else None")
    for _, theirs in pairs(swept(tmp_path)):
        assert theirs.status_reason == "the twin process failed: exit code 3"
    assert engine.version == "7.1"


def test_it_ends_with_the_process_that_started_it_while_it_computes(tmp_path: Path) -> None:
    """A process that is killed closes its pipes, and does nothing else."""
    adapter = tmp_path / "endless.py"
    adapter.write_text("from time import sleep\ndef simulate(request, tick): tick(); sleep(3600)\n")
    command = [sys.executable, "-P", str(SERVER), str(adapter)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        pickle.dump({"operation": "simulate"}, process.stdin)
        process.stdin.flush()
        assert pickle.load(process.stdout) is None  # noqa: S301 - it computes
        process.stdin.close()
        try:
            assert process.wait(60) == 0
        finally:
            process.kill()


@pytest.mark.long
def test_an_overflow_is_a_label(install: Install, tmp_path: Path) -> None:
    install(overflow="True")
    for ours, theirs in pairs(swept(tmp_path)):
        assert (ours.label, theirs.label) == ("stable", "buffer_overflow")


def test_a_model_that_it_cannot_simulate_is_refused_before_anything_runs(
    install: Install, tmp_path: Path
) -> None:
    install()
    text = SWEEP.replace("axes: {", "axes: {gravity: ['0 0 0'], ")
    with pytest.raises(SceneError, match="the twin engine cannot simulate this: gravity is off"):
        swept(tmp_path, text)
    assert not (tmp_path / "store").exists()


def test_what_is_not_installed_or_has_lost_its_python_is_refused(
    install: Install, tmp_path: Path
) -> None:
    engine = install()
    (engine.environment / "bin/python").unlink()
    with pytest.raises(SceneError, match="install it once with `contactlab parity --install twin`"):
        swept(tmp_path)
    with pytest.raises(SceneError, match="install it once with `contactlab parity --install warp`"):
        swept(tmp_path, SWEEP.replace("twin", "warp"))
