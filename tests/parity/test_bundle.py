"""A bundle has all that another machine needs, and its results are judged as an engine's are."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines.adapted_engine import SERVER, load_adapter
from contactlab.errors import EngineError, OutputError, StoreError
from contactlab.plan.overrides import Overrides
from contactlab.schema.comparison import ComparePolicy
from contactlab.studies.parity.bundle import ENGINE, Bundle, write_bundle
from contactlab.studies.parity.bundled_engine import BundledEngine
from contactlab.studies.parity.panel import Panel
from contactlab.studies.parity.parity_report import ParityReport
from contactlab.studies.parity.sweep_parity import ParityRequest, compare_runs

SCRIPT = Path(__file__).with_name("check_mujoco.py")
SLIDE = """
version: 1
scene: box_slide
duration: 0.1
axes: {timestep: [0.002], friction.slide: [0.3, 0.5]}
"""
GRIP = """
version: 1
scene: gripping_pad
duration: 0.1
axes: {timestep: [0.002]}
"""


def bundled(folder: Path, text: str, **options: Any) -> tuple[Bundle, Path]:
    sweep, overrides = folder / "panel.yaml", Overrides(**options)
    sweep.write_text(text)
    panel = Panel.read(sweep, ENGINE, overrides, (), None)
    made = write_bundle(panel, overrides, None, folder / "bundle")
    sweep.unlink()  # what is judged is what the folder has
    return made, folder / "bundle"


def judged(folder: Path, *defect: str) -> ParityReport:
    subprocess.run([sys.executable, str(SCRIPT), str(folder), *defect], check=True)
    bundle = Bundle.read(folder)
    engine, rules = BundledEngine(folder, bundle), ComparePolicy(version=1)
    request = ParityRequest(bundle.panel(folder), engine, engine.device, (), rules)
    return compare_runs(request, lambda *_: None, lambda _: None)


@pytest.mark.long
@pytest.mark.parametrize("text", [SLIDE, GRIP], ids=["slide", "grip"])
def test_results_without_a_defect_are_the_same(tmp_path: Path, text: str) -> None:
    bundle, folder = bundled(tmp_path, text)
    assert {"check_newton.py", "check_isaaclab.py"} <= {each.name for each in folder.iterdir()}
    report = judged(folder)
    assert (report.exit_code, report.verdicts) == (0, {"same": len(bundle.runs)})
    assert (report.engine, report.version, report.device) == ("stand-in", "1", "cpu")
    assert report.sweep == "panel"
    # A step's velocity differs by no more than what rounding the model's numbers makes of forces.
    assert all(each.step is not None and each.step < 1e-9 for each in report.runs)


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "defect", "stage"),
    [(SLIDE, "friction", "one step"), (SLIDE, "buffer", "buffers")],
    ids=["friction", "buffer"],
)
def test_a_defect_elsewhere_is_found(tmp_path: Path, text: str, defect: str, stage: str) -> None:
    report = judged(bundled(tmp_path, text)[1], defect)
    assert report.exit_code == 1
    assert {each.first_divergence and each.first_divergence.stage for each in report.runs} == {
        stage
    }


def test_options_of_the_command_are_kept(tmp_path: Path) -> None:
    bundle, folder = bundled(
        tmp_path, SLIDE, assign=["timestep=0.001"], where=["friction.slide=0.5"], limit=1
    )
    assert [(each.timestep, each.solver) for each in bundle.runs] == [
        (0.001, {"enable_multiccd": hasattr(mujoco.mjtDisableBit, "mjDSBL_MULTICCD")})
    ]
    (again,) = bundle.panel(folder).runs
    assert again.run_id == bundle.runs[0].id


def test_expected_results_have_floors(tmp_path: Path) -> None:
    bundle, folder = bundled(tmp_path, SLIDE)
    expected = np.load(folder / "runs" / f"{bundle.runs[0].id}.npz")
    steps = len(expected["ctrl"])
    assert steps == 50
    assert expected["qpos"].shape == (steps + 1, 7)
    assert expected["floor"].shape == (steps + 1,)
    assert expected["places"].tolist() == list(range(steps))
    # A start at rest on multiples of a power of two would have no floor at all.
    assert 0 < expected["floor"].max() < 1e-3


@pytest.mark.long
def test_what_newton_cannot_do_is_left_out_by_name(tmp_path: Path) -> None:
    text = SLIDE.replace("timestep: [0.002]", "timestep: [0.002], solver: [Newton, PGS]")
    bundle, folder = bundled(tmp_path, text)
    assert (len(bundle.runs), len(bundle.refused)) == (2, 2)
    assert all("PGS" in why for why in bundle.refused.values())
    assert judged(folder).verdicts == {"same": 2, "refused": 2}


def test_nothing_is_written_if_newton_can_do_none_of_it(tmp_path: Path) -> None:
    text = SLIDE.replace("timestep: [0.002]", "timestep: [0.002], solver: [PGS]")
    with pytest.raises(EngineError, match="PGS"):
        bundled(tmp_path, text)
    assert not (tmp_path / "bundle").exists()


def test_a_run_without_a_result_has_failed(tmp_path: Path) -> None:
    report = judged(bundled(tmp_path, SLIDE)[1], "missing")
    assert (report.exit_code, report.verdicts) == (3, {"failed": 2})
    assert "no result" in report.runs[0].reason


@pytest.mark.long
def test_other_states_of_mujoco_are_not_judged(tmp_path: Path) -> None:
    bundle, folder = bundled(tmp_path, SLIDE)
    file = folder / "runs" / f"{bundle.runs[0].id}.npz"
    expected = dict(np.load(file))
    expected["qpos"] = expected["qpos"] + 1e-6
    np.savez(file, **expected)
    with pytest.raises(StoreError, match="judge it there"):
        judged(folder)


def test_what_is_no_bundle_or_has_no_results_is_told(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"no bundle\.json"):
        Bundle.read(tmp_path)
    bundle, folder = bundled(tmp_path, SLIDE)
    with pytest.raises(StoreError, match=r"check_newton\.py"):
        BundledEngine(folder, bundle)
    with pytest.raises(OutputError, match="new folder"):
        bundled(tmp_path, SLIDE)


WRITTEN = """
<mujoco>
  <option timestep="0.003" cone="elliptic" gravity="0 0 -9"/>
  <default><geom friction=".3" solref=".01" solimp=".8 .9"/></default>
  <worldbody><geom name="floor" type="plane" size="1 1 .1"/>
    <body name="a" pos="0 0 1" euler="10 20 30"><freejoint/><geom type="ellipsoid" size=".1 .2 .3"/>
      <body pos=".3 0 0"><joint name="turn" axis="1 2 3" range="-40 50" ref="10" springref="5"
        stiffness="3" damping=".3" frictionloss=".1" solreflimit=".03"/><geom size=".1"/></body>
    </body>
    <body name="b" pos="2 0 1"><joint type="slide"/><geom name="b" type="cylinder" size=".1 .2"/>
    </body>
  </worldbody>
  <contact><pair geom1="b" geom2="floor" condim="6" friction=".2 .3 .1"/>
    <exclude body1="a" body2="b"/></contact>
  <actuator><position joint="turn" kp="7" kv=".3" ctrlrange="-1 1"/></actuator>
</mujoco>"""


def test_mjcf_of_a_model_makes_the_same_model_in_full() -> None:
    model = mujoco.MjModel.from_xml_string(WRITTEN)
    text = load_adapter(SERVER).mjcf_of(model)
    again = mujoco.MjModel.from_xml_string(text)
    old, new = mujoco.MjData(model), mujoco.MjData(again)
    for data, each in ((old, model), (new, again)):
        data.ctrl[:] = 0.5
        mujoco.mj_step(each, data, 400)
    # Numbers have 17 digits in it: what differs after 400 steps began as rounding.
    assert np.abs(old.qpos - new.qpos).max() < 1e-9
    # Other importers take what is left out for 0.
    assert 'solref="0.01 1"' in text
    assert 'friction="0.3 0.005 0.0001"' in text
    assert 'solimp="0.8 0.9 0.001 0.5 2"' in text


def test_what_mjcf_would_not_say_is_refused() -> None:
    tendon = "<tendon><fixed><joint joint='turn' coef='1'/></fixed></tendon></mujoco>"
    model = mujoco.MjModel.from_xml_string(WRITTEN.replace("</mujoco>", tendon))
    with pytest.raises(ValueError, match="tendon"):
        load_adapter(SERVER).mjcf_of(model)
