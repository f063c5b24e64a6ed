"""Environments of Gymnasium: an episode is a run, with its success and its rewards."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

import contactlab
from contactlab.errors import SceneError
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.verify_store import find_problems

gymnasium: Any = pytest.importorskip("gymnasium")

PUSHED = """
<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body name="puck" pos="0 0 .05"><joint name="x" type="slide" axis="1 0 0"/>
    <joint name="z" type="slide" axis="0 0 1"/>
    <geom name="puck" type="box" size=".05 .05 .05" mass="1"/></body>
</worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
SKIP, LENGTH = 5, 8


def make_env(kind: str = "plain") -> Any:
    """Return an environment that pushes a puck, and what it steps, where its kind has that."""

    class Push(gymnasium.Env):
        action_space = gymnasium.spaces.Box(-30, 30, (1,))
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))

        def __init__(self) -> None:
            self.mine = mujoco.MjModel.from_xml_string(PUSHED)
            self.own = mujoco.MjData(self.mine)
            if kind == "physics":
                model, data = SimpleNamespace(ptr=self.mine), SimpleNamespace(ptr=self.own)
                self.physics = SimpleNamespace(model=model, data=data)
            else:
                self.model, self.data = self.mine, self.own

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            super().reset(seed=seed, options=options)
            if kind == "anew":
                self.own = self.data = mujoco.MjData(self.mine)
            mujoco.mj_resetData(self.mine, self.own)
            self.count = 0
            return self.own.qpos[:1].copy(), {}

        def step(self, action: Any) -> Any:
            self.own.ctrl[:] = action
            mujoco.mj_step(self.mine, self.own, nstep=SKIP)
            self.count += 1
            far = bool(self.own.qpos[0] > 0.001)
            return self.own.qpos[:1].copy(), 0.5, False, self.count == LENGTH, {"is_success": far}

    return Push()


def _records(store: Path) -> list[EvidenceRecord]:
    assert find_problems(store) == []
    return list(contactlab.open(store).records())


@pytest.mark.parametrize("kind", ["plain", "physics"])
def test_each_episode_is_a_run(tmp_path: Path, kind: str) -> None:
    from contactlab.gymnasium import Evidence  # noqa: PLC0415 - it needs an extra

    step = mujoco.mj_step
    env = Evidence(make_env(kind), tmp_path / "store")
    for push in (30.0, -30.0, 30.0):
        env.reset(seed=0)
        truncated = False
        while not truncated:
            _, _, _, truncated, _ = env.step(np.array([push]))
    env.reset()
    env.step(np.array([1.0]))
    env.close()
    env.close()
    assert mujoco.mj_step is step

    first, second, third, last = _records(tmp_path / "store")
    assert [each.steps for each in (first, last)] == [SKIP * LENGTH, SKIP]
    assert [each.success for each in (first, second, third, last)] == [True, False, True, False]
    assert [each.total_reward for each in (first, last)] == [0.5 * LENGTH, 0.5]
    assert first.metrics == third.metrics
    assert first.trajectory_hash == third.trajectory_hash != second.trajectory_hash


def _anew(path: Path, *models: str) -> list[EvidenceRecord]:
    """Record an episode of each model, which its environment makes when it is reset."""
    from contactlab.gymnasium import Evidence  # noqa: PLC0415 - likewise

    inner = make_env("anew")
    env = Evidence(inner, path)
    for model in models:
        inner.mine = inner.model = mujoco.MjModel.from_xml_string(model)
        env.reset()
        for _ in range(3):
            env.step(np.array([30.0]))
    env.close()
    return _records(path)


def test_another_simulation_is_followed_and_its_changes_are_said(tmp_path: Path) -> None:
    heavier = PUSHED.replace('mass="1"', 'mass="2"')
    first, second, third = _anew(tmp_path / "store", PUSHED, heavier, PUSHED)
    assert [each.steps for each in (first, second, third)] == [3 * SKIP] * 3
    assert first.loop is not None
    assert second.loop is not None
    assert not first.loop.changed
    assert "body_mass" in second.loop.changed
    assert first.trajectory_hash == third.trajectory_hash != second.trajectory_hash
    assert first.metrics == third.metrics


def test_another_model_is_refused(tmp_path: Path) -> None:
    other = PUSHED.replace('name="puck" pos', 'name="disc" pos')
    with pytest.raises(SceneError, match=r"other parts than that of .*store \(names\)"):
        _anew(tmp_path / "store", PUSHED, other)


def test_an_environment_without_mujoco_is_refused(tmp_path: Path) -> None:
    from contactlab.gymnasium import Evidence  # noqa: PLC0415 - likewise

    class Empty(gymnasium.Env):
        pass

    with pytest.raises(SceneError, match="Empty has no MuJoCo model and data"):
        Evidence(Empty(), tmp_path / "store")
