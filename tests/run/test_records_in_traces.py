"""The record in a trace is as one writes itself, though runs of a kind write their part alone."""

from pathlib import Path
from typing import Any

import mujoco
import pytest

import contactlab
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.mcap.trace_reader import read_trace

# Of several values, seeds and kinds; with a second pass and twins; and one that MuJoCo stops.
SWEEPS = {
    "kinds": "scene: box_slide\nduration: 0.1\nseeds: 2\n"
    "axes: {perturbation: [0.0, 0.1], density: [0, 50], solref: [[0.02, 1], [0.1, 1]]}\n",
    "checked": "scene: ball_drop\nduration: 0.6\nchecks: all\nknife_edge: true\n"
    "axes: {restitution: [0.6, 0.9], timestep: [0.001, 0.004]}\n"
    "tolerances: {penetration_max: 1.0e-3}\n",
    "stopped": "scene: box_stack\nduration: 0.2\naxes: {timestep: [0.002, 10.0]}\n",
}
BALL = (
    '<mujoco><worldbody><geom name="floor" type="plane" size="9 9 .1"/>'
    '<body pos="0 0 .2"><freejoint/><geom name="ball" size=".1"/></body></worldbody></mujoco>'
)


def check(store: Path, runs: int) -> None:
    traces = [*store.rglob("*.mcap")]
    assert len(traces) == runs
    for trace in traces:
        text = read_trace(trace).record_json
        assert EvidenceRecord.model_validate_json(text).model_dump_json().encode() == text


@pytest.mark.long
@pytest.mark.parametrize("name", SWEEPS)
def test_of_sweeps(sweeper: Any, name: str) -> None:
    sweeper.run(f"version: 1\ntrace: all\n{SWEEPS[name]}")
    check(sweeper.folder / "store", len(sweeper.rows()))


@pytest.mark.parametrize("success", [None, True])
def test_of_loops(tmp_path: Path, success: bool | None) -> None:
    """They say more than others do: of an episode's success, if anything is known of it."""
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    recorder = contactlab.record(model, data, tmp_path / "store", monitor=[("floor", "ball")])
    for _ in range(50):
        recorder.step()
    recorder.reset(success=success)
    recorder.close()
    check(tmp_path / "store", 1)
