"""How far joints move and bodies turn, there and back."""

from pathlib import Path

import numpy as np
import pytest

from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

_SWEEP = "version: 1\nscene: m.xml\nduration: {}\ntrace: none\n"


def _measured(
    folder: Path, model: str, duration: float, sweep: str = _SWEEP
) -> dict[str, float | None]:
    (folder / "m.xml").write_text(model)
    ask = read_request(sweep.format(duration), "t", folder / "s", folder=folder, workers=0)
    run_sweep(ask, lambda *_: None, lambda _: None)
    store = Store.open(folder / "s")
    return store.record(store.table["run_id"][0].as_py()).metrics


def test_a_spring_travels_four_amplitudes_a_period(tmp_path: Path) -> None:
    """Mass 1, stiffness (2 pi)^2: a period of 1 s. The speed's sum is exact to h^2."""
    model = f"""<mujoco><option gravity="0 0 0"/><worldbody><body>
      <joint name="j" type="slide" axis="1 0 0" stiffness="{(2 * np.pi) ** 2}" springref="0.1"/>
      <geom size=".1" mass="1"/></body></worldbody></mujoco>"""
    found = _measured(tmp_path, model, 2.0, _SWEEP + "drive: none\n")
    assert found["joint_travel"] == pytest.approx(2 * 4 * 0.1, rel=2e-3)
    assert found["turn"] is None


def test_constant_forces_of_3_and_4_are_an_effort_of_5(tmp_path: Path) -> None:
    model = """<mujoco><option gravity="0 0 0"/><worldbody><body>
      <joint name="j" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body></worldbody>
      <actuator><motor joint="j"/><motor joint="j" gear="-1"/></actuator>
      <keyframe><key ctrl="3 4"/></keyframe></mujoco>"""
    sweep = _SWEEP + "drive: none\n"
    assert _measured(tmp_path, model, 0.1, sweep)["actuator_effort"] == pytest.approx(5)


def test_a_spinning_ball_turns_by_its_speed_times_time(tmp_path: Path) -> None:
    model = """<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/>
      <geom size=".1" mass="1"/></body></worldbody>
      <keyframe><key name="spin" qvel="0 0 0 3 0 4"/></keyframe></mujoco>"""
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "scene.xml").write_text(model)
    (tmp_path / "s" / "scene.yaml").write_text(
        "version: 1\ntitle: t\ndescription: d\nduration: 0.5\nkeyframe: spin\n"
    )
    text = "version: 1\nscene: ./s\ntrace: none\n"
    ask = read_request(text, "t", tmp_path / "store", folder=tmp_path, workers=0)
    run_sweep(ask, lambda *_: None, lambda _: None)
    store = Store.open(tmp_path / "store")
    metrics = store.record(store.table["run_id"][0].as_py()).metrics
    assert metrics["turn"] == pytest.approx(5 * 0.5, rel=1e-9)
    assert metrics["joint_travel"] is None
