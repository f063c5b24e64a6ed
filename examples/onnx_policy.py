"""A policy that asks a neural network in an ONNX file: one input of observations, one of controls.

Put `policy.onnx` beside a copy of this file, and name both in the sweep:

    drive: {policy: onnx_policy.py:OnnxPolicy, files: [policy.onnx], rate: 50}

    pip install onnxruntime
    contactlab sweep my_sweep.yaml --allow-code

The network gets (n, nq + nv) float32 positions and velocities, and returns (n, nu) actions in
[-1, 1], which stand for the range of each control. Change `__call__` to what yours was trained on.
"""

from pathlib import Path

import mujoco
import numpy as np

try:
    import onnxruntime
except ImportError as error:
    raise ImportError("this policy needs onnxruntime; pip install onnxruntime") from error

NETWORK = Path(__file__).with_name("policy.onnx")


class OnnxPolicy:
    """Controls from a network that maps observations to shares of their ranges."""

    def __init__(self, model: mujoco.MjModel) -> None:
        options = onnxruntime.SessionOptions()
        # Each worker process has one core.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._network = onnxruntime.InferenceSession(
            NETWORK, options, providers=["CPUExecutionProvider"]
        )
        self._input = self._network.get_inputs()[0].name
        limited = model.actuator_ctrllimited.astype(bool)[:, None]
        low, high = np.where(limited, model.actuator_ctrlrange, [-1.0, 1.0]).T
        self._middle, self._half = (low + high) / 2, (high - low) / 2

    def __call__(
        self, time: np.ndarray, qpos: np.ndarray, qvel: np.ndarray, sensordata: np.ndarray
    ) -> np.ndarray:
        """Return (n, nu) controls for n runs."""
        del time, sensordata
        observed = np.concatenate([qpos, qvel], axis=1).astype(np.float32)
        (actions,) = self._network.run(None, {self._input: observed})
        return self._middle + self._half * np.clip(actions, -1.0, 1.0)
