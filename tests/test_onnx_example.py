"""The example that asks a network flies the cart-pole as its gains do."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.cart_pole import cart_pole

from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

EXAMPLE = Path(__file__).parents[1] / "examples" / "onnx_policy.py"
GAINS = np.array([[2.0, 50.0, 4.0, 8.0]], np.float32).T
CART_POLE = cart_pole(
    0.002,
    motor='ctrllimited="true"',
    more='<keyframe><key name="tilted" qpos="0 0.1"/></keyframe>',
    floor="",
)


def write_network(path: Path) -> None:
    """Write a network of one layer, whose actions are shares of 50 N."""
    onnx = pytest.importorskip("onnx")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["observed", "gains"], ["actions"])],
        "balance",
        [helper.make_tensor_value_info("observed", kind, ["n", 4])],
        [helper.make_tensor_value_info("actions", kind, ["n", 1])],
        [onnx.numpy_helper.from_array(GAINS / 50, "gains")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, str(path))


def test_a_network_balances_the_pole(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    shutil.copyfile(EXAMPLE, tmp_path / EXAMPLE.name)
    (tmp_path / "cart.xml").write_text(CART_POLE)
    write_network(tmp_path / "policy.onnx")
    drive = {"policy": "onnx_policy.py:OnnxPolicy", "files": ["policy.onnx"]}
    sweep = {"version": 1, "scene": "cart.xml", "duration": 8.0, "seeds": 2, "drive": drive}
    ask = read_request(sweep, "onnx", tmp_path / "store", folder=tmp_path, workers=0)
    run_sweep(replace(ask, allow_code=True), lambda *_: None, lambda *_: None)
    store = Store.open(tmp_path / "store")
    for record in store.records():
        assert record.status == "ok"
        assert np.abs(store.trace(record).qpos[-1]).max() < 0.01
