"""One model has one answer: every view of its examination, and tune and sweep agree.

They are asked about one task, and answer with the same line, the same labels in the same phases,
and for the same settings the same shares to the bit.
"""

import importlib.util
import os
from pathlib import Path
from typing import Any

import pytest
from bench.atlas.views import apart, contradictions, of_report, of_views

import contactlab
from contactlab.schema.examination import Examination

PUBLIC = (
    "brax/test_data/triple_pendulum_motor.xml",
    "dm_control/locomotion/soccer/assets/boxhead/boxhead.xml",
    "fancy_gym/envs/mujoco/hopper_throw/assets/hopper_throw.xml",
    "genesis_world/genesis/assets/xml/rope_hinge.xml",
    "mani_skill/envs/tasks/control/assets/ant.xml",
    "metaworld/assets/objects/thermos.xml",
    "mujoco_warp/test_data/actuation/slidercrank.xml",
    "myo_sim/models/legacy/elbow/myoelbow_2dof6muscles.xml",
    "pybullet/pybullet_data/r2d2.urdf",
    "robosuite/models/assets/grippers/bd_gripper.xml",
)


def views_agree(model: str, folder: Path, duration: str) -> Examination:
    """Assert that all views of an examination have one answer, which a sweep has too."""
    options: dict[str, Any] = {"workers": 0, "output": folder / "examined", "duration": duration}
    whole = contactlab.examine(model, section=["labels", "budget", "facts", "checks"], **options)
    assert not list(contradictions(whole))
    for view, answer in of_views(model, whole.task, folder, duration):
        assert not [f"{view}: {other}" for other in apart(of_report(whole), answer)]
    contacts = contactlab.examine(model, section=["contacts"], **options)
    assert contacts.task == whole.task
    return whole


def searches_agree(model: str, whole: Examination, folder: Path, **options: Any) -> None:
    """Assert that two searches use the task, and have the same error of the model as written.

    The model as written has the error of its examination, wherever time ends a search.
    """
    assert whole.budget
    shares = [phase.numerical_error.error for phase in whole.budget.phases]
    finite = [share for share in shares if share is not None]
    # A phase that MuJoCo gives up has no share.
    own = max(finite) if len(finite) == len(shares) else None
    for place in ("first", "second"):
        report = contactlab.tune(model, workers=0, output=folder / place, **options)
        assert report.task.line == whole.task.line
        assert report.current_verdict
        assert report.current_verdict.seeds == whole.task.seeds
        written = [point for point in report.front if "as written" in point.marks]
        errors = [point.error for point in written]
        assert [*errors, report.current_verdict.numerical_error] == [own, own]
        assert report.current.error == own


@pytest.mark.long
def test_searches_of_a_small_model_have_one_answer(tmp_path: Path) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(
        """<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="3 3 .1"/>
        <body name="ball" pos="0 0 .06"><freejoint/><geom size=".05"/></body></worldbody>
        </mujoco>"""
    )
    options: dict[str, Any] = {"duration": "0.2s"}
    whole = contactlab.examine(path, section=["budget"], output=tmp_path / "out", **options)
    searches_agree(str(path), whole, tmp_path, max_cpu="2s", **options)


@pytest.mark.long
def test_a_shipped_scene_has_one_answer(tmp_path: Path) -> None:
    views_agree("box_slide", tmp_path, "0.2s")


@pytest.mark.long
def test_a_small_model_has_one_answer(tmp_path: Path) -> None:
    path = tmp_path / "swing.xml"
    path.write_text(
        """<mujoco><worldbody><body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 1 0"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" contype="0" conaffinity="0"/></body>
        </worldbody></mujoco>"""
    )
    options: dict[str, Any] = {"workers": 0, "output": tmp_path / "out", "duration": "0.1s"}
    whole = contactlab.examine(path, section=["labels", "budget"], **options)
    assert not list(contradictions(whole))
    for view, answer in of_views(str(path), whole.task, tmp_path, "0.1s"):
        assert not [f"{view}: {other}" for other in apart(of_report(whole), answer)]


def public(robot: str) -> str:
    """Return the file of a model of a wheel; skip the test if that is not here."""
    package, _, rest = robot.partition("/")
    places = [Path(folder) / package for folder in filter(None, [os.environ.get("ROBOT_WHEELS")])]
    # robosuite talks as it is imported, so that it is only looked for.
    spec = importlib.util.find_spec(package)
    places += map(Path, spec.submodule_search_locations or ()) if spec else ()
    for place in places:
        for found in (place / rest, place / package / rest):
            if found.is_file():
                return str(found)
    pytest.skip(f"{package} is not installed, and not in the folder that ROBOT_WHEELS names")


@pytest.mark.night
@pytest.mark.filterwarnings("ignore::contactlab.errors.ModelWarning")
@pytest.mark.parametrize("robot", PUBLIC)
def test_a_public_model_has_one_answer(robot: str, tmp_path: Path) -> None:
    model = public(robot)
    whole = views_agree(model, tmp_path, "0.6s")
    searches_agree(model, whole, tmp_path, max_cpu="20s", duration="0.6s")
