"""The example of a LeRobot policy: chunks, processors, and a reset for each episode."""

import shutil
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests import push_env

import contactlab
from contactlab.engines.closed_loop import load_code

EXAMPLE = Path(__file__).parents[1] / "examples" / "lerobot_policy.py"


@pytest.mark.long
def test_the_stand_in_pushes_in_every_variant(tmp_path: Path) -> None:
    for file in (EXAMPLE, Path(push_env.__file__)):
        shutil.copy(file, tmp_path)
    report = contactlab.success(
        f"{tmp_path / 'push_env.py'}:Push",
        drive=f"{tmp_path / EXAMPLE.name}:Policy",
        episodes=2,
        duration=4.0,
        variant=["half the step"],
        allow_code=True,
        workers=0,
        output=tmp_path / "report",
    )
    assert (report.written.good, report.physical.good, report.written.episodes) == (2, 2, 2)


class Tensor:
    """As much of a tensor as the example uses."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def detach(self) -> "Tensor":
        return self

    def numpy(self) -> np.ndarray:
        return self.values


class Trained:
    """A policy with LeRobot's interface: the names and the shapes that its own have."""

    calls: list[object]

    @classmethod
    def from_pretrained(cls, path: str, *, config: object) -> "Trained":
        made = cls()
        made.calls = [path, config]
        return made

    def eval(self) -> "Trained":
        return self

    def reset(self) -> None:
        self.calls.append("reset")

    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        (state,) = batch.values()
        assert state.values.shape == (1, 2)
        assert state.values.dtype == np.float32
        return Tensor(state.values[:, :1] / 2)


def test_a_checkpoint_is_loaded_and_called_as_lerobot_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Processors add the batch and scale back; the device is the CPU."""

    def module(name: str, **parts: Any) -> None:
        made = ModuleType(name)
        vars(made).update(parts)
        monkeypatch.setitem(sys.modules, name, made)

    config = SimpleNamespace(type="act", device="cuda")

    def make_processors(own: object, path: str, *, preprocessor_overrides: Any) -> Any:
        assert preprocessor_overrides == {"device_processor": {"device": "cpu"}}
        assert (own, path) == (config, str(tmp_path / "checkpoint"))
        return (
            lambda seen: {name: Tensor(value.values[None]) for name, value in seen.items()},
            lambda action: Tensor(10 * action.values),
        )

    module("torch", set_num_threads=lambda _: None, manual_seed=lambda _: None, from_numpy=Tensor)
    for name in ("lerobot", "lerobot.configs", "lerobot.policies"):
        module(name)
    loaded = SimpleNamespace(from_pretrained=lambda _: config)
    module("lerobot.configs.policies", PreTrainedConfig=loaded)
    module(
        "lerobot.policies.factory",
        get_policy_class=lambda kind: {"act": Trained}[kind],
        make_pre_post_processors=make_processors,
    )
    shutil.copy(EXAMPLE, tmp_path)
    (tmp_path / "checkpoint").mkdir()

    policy: Any = load_code("policy", tmp_path / EXAMPLE.name, "Policy")(None)

    assert policy.act([0.4, 7.0]) == pytest.approx([2.0])
    assert policy.policy.calls == [str(tmp_path / "checkpoint"), config, "reset"]
    assert config.device == "cpu"
