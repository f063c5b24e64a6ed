# ruff: noqa: PLC0415 - each half of it runs where the packages of the other are missing
"""Do policies of Gymnasium's pendulums succeed inside of their margins, and fail outside?

    ROBOT_WHEELS=... python -m bench.loop_gymnasium margins FOLDER    # with contactlab, onnx
    python bench/loop_gymnasium.py episodes FOLDER                    # with gymnasium, onnxruntime

The first writes a linear policy of the double pendulum and a network of the pendulum, and their
borders of rate and delay. The second knows nothing of contactlab: it counts the successes of 20
episodes of 10 s of Gymnasium's own environments, at the last whole step inside of each border, and
at the next ones outside.
"""

import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np

ASSETS = "gymnasium/gymnasium/envs/mujoco/assets"
Act = Callable[[np.ndarray], float]


@dataclass(frozen=True)
class Pendulum:
    """An environment, its model, and the steps of its own control period."""

    env: str
    file: str
    skip: int


PENDULUMS = {
    "network": Pendulum("InvertedPendulum-v5", "inverted_pendulum.xml", 2),
    "linear": Pendulum("InvertedDoublePendulum-v5", "inverted_double_pendulum.xml", 5),
}


def find_gains(model: mujoco.MjModel, skip: int) -> np.ndarray:
    """Return the gains of a linear-quadratic regulator over a control period, upright."""
    from scipy.linalg import solve_discrete_are

    data, size, nudge = mujoco.MjData(model), 2 * model.nv, 1e-6
    columns = list[np.ndarray]()
    for place in range(size + 1):
        ends = list[np.ndarray]()
        for sign in (1, -1):
            state = np.zeros(size + 1)
            state[place] = sign * nudge
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = state[: model.nv], state[model.nv : size]
            data.ctrl[:] = state[size]
            mujoco.mj_step(model, data, skip)
            ends.append(np.concatenate([data.qpos, data.qvel]))
        columns.append((ends[0] - ends[1]) / (2 * nudge))
    period = np.array(columns).T
    a, b = period[:, :size], period[:, size:]
    cost = solve_discrete_are(a, b, np.eye(size), 10 * np.eye(1))
    return np.linalg.solve(10 + b.T @ cost @ b, b.T @ cost @ a)[0]


def write_network(path: Path, gains: np.ndarray, limit: float) -> None:
    """Write a network of 64 units, fitted to saturated gains; it returns a share of the limit."""
    import onnx  # pyright: ignore[reportMissingImports]

    random, kind = np.random.default_rng(0), onnx.TensorProto.FLOAT
    scale = np.array([1.0, 0.2, 1.0, 1.0])
    first, bias = random.standard_normal((4, 64)) / scale[:, None], random.uniform(-2, 2, 64)
    samples = random.uniform(-1, 1, (8000, 4)) * scale * random.uniform(0, 1, (8000, 1))
    hidden = np.tanh(samples @ first + bias) - np.tanh(bias)  # at rest it does nothing
    wanted = -np.tanh(samples @ gains / limit)
    last = np.linalg.solve(hidden.T @ hidden + 1e-4 * np.eye(64), hidden.T @ wanted)
    arrays = {"first": first, "bias": bias, "last": last[:, None], "rest": np.tanh(bias)}
    make = onnx.helper.make_node
    graph = onnx.helper.make_graph(
        [
            make("MatMul", ["seen", "first"], ["a"]),
            make("Add", ["a", "bias"], ["b"]),
            make("Tanh", ["b"], ["c"]),
            make("Sub", ["c", "rest"], ["d"]),
            make("MatMul", ["d", "last"], ["actions"]),
        ],
        "balance",
        [onnx.helper.make_tensor_value_info("seen", kind, ["n", 4])],
        [onnx.helper.make_tensor_value_info("actions", kind, ["n", 1])],
        [onnx.numpy_helper.from_array(v.astype(np.float32), k) for k, v in arrays.items()],
    )
    opset = [onnx.helper.make_opsetid("", 13)]
    onnx.save(onnx.helper.make_model(graph, opset_imports=opset, ir_version=8), str(path))


def measure_margins(folder: Path) -> None:
    """Write the policies, and their borders as contactlab has them."""
    import shutil

    from contactlab.closed_loop.control_loop import INTEGRATION, ControlLoop
    from contactlab.closed_loop.loop_margins import LoopStudy
    from contactlab.engines.closed_loop import load_code

    borders = dict[str, dict[str, float | None]]()
    for word, pendulum in PENDULUMS.items():
        path = Path(os.environ["ROBOT_WHEELS"]) / ASSETS / pendulum.file
        model = mujoco.MjModel.from_xml_path(str(path))
        gains, limit = find_gains(model, pendulum.skip), float(model.actuator_ctrlrange[0, 1])
        if word == "network":
            write_network(folder / "policy.onnx", gains, limit)
            example = Path(__file__).parents[1] / "examples" / "onnx_policy.py"
            shutil.copy(example, folder)
            policy = cast("Any", load_code("policy", folder / example.name, "OnnxPolicy"))
        else:
            np.save(folder / "gains.npy", gains)

            class Linear:
                def __init__(self, _: mujoco.MjModel) -> None:
                    pass

                def __call__(self, *seen: np.ndarray) -> np.ndarray:
                    return -np.concatenate(seen[1:3], axis=1) @ gains[:, None]  # noqa: B023

            policy = cast("Any", Linear)
        start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
        mujoco.mj_getState(model, mujoco.MjData(model), start, INTEGRATION)
        rate = 1 / (pendulum.skip * model.opt.timestep)
        report = LoopStudy(ControlLoop(model, policy, start, rate)).measure_margins()
        borders[word] = {each.name: each.border for each in report.margins}
        print(word, f"at {rate:g} Hz holds: {report.holds}", borders[word], flush=True)
    (folder / "borders.json").write_text(json.dumps(borders))


def count_successes(name: str, act: Act, every: int, delay: int) -> int:
    """Return in how many of 20 episodes of 10 s the poles stand.

    The environment does not end these by itself, and tilts are below 0.03 rad in their last 2 s.
    """
    import gymnasium  # pyright: ignore[reportMissingImports]

    env = gymnasium.make(name, frame_skip=1, reset_noise_scale=0.01, max_episode_steps=-1)
    good, data = 0, env.unwrapped.data  # pyright: ignore[reportAttributeAccessIssue]
    for seed in range(20):
        env.reset(seed=seed)
        waiting, ended, wanted, tilt = [0.0] * delay, False, 0.0, 0.0
        for step in range(round(10 / env.unwrapped.dt)):  # pyright: ignore[reportAttributeAccessIssue]
            if step % every == 0:
                wanted = act(np.concatenate([data.qpos, data.qvel]))
            waiting.append(wanted)
            ended = bool(env.step(np.array([waiting.pop(0)], np.float32))[2])
            if ended:
                break
            if step * env.unwrapped.dt >= 8:  # pyright: ignore[reportAttributeAccessIssue]
                tilt = max(tilt, float(np.abs(data.qpos[1:]).max()))
        good += not ended and tilt < 0.03
    return good


def count_episodes(folder: Path) -> None:
    """Print the successes on both sides of each border."""
    import onnxruntime  # pyright: ignore[reportMissingImports]

    session = onnxruntime.InferenceSession(folder / "policy.onnx")
    gains = np.load(folder / "gains.npy")

    def ask_network(state: np.ndarray) -> float:
        (actions,) = session.run(None, {"seen": state[None].astype(np.float32)})
        return float(3 * np.clip(actions[0, 0], -1, 1))

    policies: dict[str, Act] = {"network": ask_network, "linear": lambda state: -gains @ state}
    steps = {"network": 0.02, "linear": 0.01}
    for word, borders in json.loads((folder / "borders.json").read_text()).items():
        pendulum, step, act = PENDULUMS[word], steps[word], policies[word]
        own = count_successes(pendulum.env, act, pendulum.skip, 0)
        print(f"{word}: {pendulum.env} as it is: {own} of 20")
        slowest = int(1 / (borders["rate"] * step) + 1e-6)
        for every in (slowest - 1, slowest, slowest + 1, slowest + 2):
            found = count_successes(pendulum.env, act, every, 0)
            rate = borders["rate"]
            print(f"{word}: rate from {rate:.4g} Hz: at {1 / (every * step):.4g} Hz {found} of 20")
        latest = int(borders["delay"] / step + 1e-6)
        for delay in (latest - 1, latest, latest + 1, latest + 2):
            if delay >= 0:
                found = count_successes(pendulum.env, act, pendulum.skip, delay)
                late = borders["delay"]
                print(f"{word}: delay up to {late:.4g} s: at {delay * step:.4g} s {found} of 20")


if __name__ == "__main__":
    target = Path(sys.argv[2])
    target.mkdir(parents=True, exist_ok=True)
    (measure_margins if sys.argv[1] == "margins" else count_episodes)(target)
