"""MuJoCo under another name is MuJoCo; what is planted in its states is found, by whose it is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.trace_arrays import Floats
from contactlab.engines import ENGINES
from contactlab.engines.engine import PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.errors import StoppedError
from contactlab.plan.overrides import Overrides
from contactlab.scene.scene import Scene
from contactlab.schema.comparison import ComparePolicy
from contactlab.studies.parity.forward import ForwardStates, forward_quantities
from contactlab.studies.parity.panel import Panel
from contactlab.studies.parity.parity_report import RunParity
from contactlab.studies.parity.sweep_parity import ParityRequest, compare_runs

SLIDE = """
version: 1
scene: incline
duration: 0.02
axes: {tilt: [35.0], timestep: [0.002], solver: [Newton, CG]}
"""


class Twin(MujocoEngine):
    """MuJoCo under another name, and with another version."""

    name = "twin"

    @property
    def version(self) -> str:
        return "0.0.twin"


@pytest.fixture
def twins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Panel:
    """Return the runs of a slide for the twin, which is among the engines."""
    monkeypatch.setitem(ENGINES, "twin", Twin())
    file = tmp_path / "panel.yaml"
    file.write_text(SLIDE)
    return Panel.read(file, "twin", Overrides(), (), None)


def test_mujoco_under_another_name_does_the_same(twins: Panel) -> None:
    """Every number is the same, bit for bit, and each engine has its own version."""
    policy = ComparePolicy.model_validate({"version": 1})
    told = list[str]()
    report = compare_runs(
        ParityRequest(twins, ENGINES["twin"], "here", (), policy),
        lambda total, _: told.append(str(total)),
        lambda done: told.append(done.run_id),
    )
    assert (report.engine, report.version) == ("twin", "0.0.twin")
    assert report.mujoco == mujoco.__version__
    assert {
        (judged.verdict, judged.position, judged.repeat_difference) for judged in report.runs
    } == {("same", 0.0, 0.0)}
    assert told == ["2", *(judged.run_id for judged in report.runs)]
    assert (report.exit_code, {check.outcome for check in report.findings}) == (0, {"passed"})


def test_a_comparison_that_was_stopped_goes_on(twins: Panel, tmp_path: Path) -> None:
    """Runs that are kept are not made again, unless another policy judges them."""
    told = list[object]()

    def compared(folder: Path | None, stop: Callable[[RunParity], None], **more: Any) -> Any:
        policy = ComparePolicy.model_validate({"version": 1, **more})
        request = ParityRequest(twins, ENGINES["twin"], "here", (), policy, folder)
        told.clear()
        return compare_runs(request, lambda total, stored: told.append((total, stored)), stop)

    def stopping(judged: RunParity) -> None:
        raise StoppedError(judged.run_id)

    first, second = (member.run_id for member in twins.runs)
    kept = tmp_path / "kept"
    with pytest.raises(StoppedError, match=first):
        compared(kept, stopping)
    with (kept / "runs.jsonl").open("ab") as file_of_runs:
        file_of_runs.write(b'{"key": "a kill leaves a torn line')
    report = compared(kept, lambda judged: told.append(judged.run_id))
    assert told == [(2, 1), second]
    assert report == compared(None, lambda _: None)
    compared(kept, stopping)
    assert told == [(2, 2)]
    with pytest.raises(StoppedError):
        compared(kept, stopping, metrics={"energy": {"rel": 0.1}})


@pytest.fixture(scope="module")
def states() -> Callable[..., ForwardStates]:
    """Return what compares states of a tumbling box by MuJoCo and, changed, by another."""
    scene = Scene.open("tumbling_box")
    runs = PreparedRuns.of(scene, scene.resolve({}, 0, 0.1))
    ours = forward_quantities(MujocoEngine(), runs)
    assert ours is not None

    def compared(**changes: Callable[[Floats], Floats]) -> ForwardStates:
        theirs = {
            name: [changes.get(name, np.copy)(np.asarray(value)) for value in values]
            for name, values in ours.items()
        }
        return ForwardStates(runs.models[0], [0], ours, theirs, ours)

    return compared


@pytest.mark.parametrize("sign", [1, -1])
def test_both_quaternions_of_a_rotation_agree(
    states: Callable[..., ForwardStates], sign: int
) -> None:
    """Signs of a quaternion turn alike; what turns by 0.01 rad more does not."""
    assert states(xquat=lambda quat: sign * quat).first_divergence() is None
    turned = states(xquat=lambda quat: sign * (quat + 0.005 * np.roll(quat, 1, axis=-1)))
    found = turned.first_divergence()
    assert found is not None
    assert (found.stage, found.quantity[:5]) == ("kinematics", "xquat")


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        ("xpos", "kinematics"),
        ("qfrc_bias", "forces"),
        ("qacc_smooth", "smooth acceleration"),
        ("qacc", "acceleration"),
    ],
)
def test_a_changed_quantity_is_found_at_its_stage(
    states: Callable[..., ForwardStates], name: str, stage: str
) -> None:
    """With the values of both, and which is whose."""
    found = states(**{name: lambda values: values + 1.0}).first_divergence()
    assert found is not None
    assert found.stage == stage
    assert found.mujoco is not None
    assert found.engine == pytest.approx(found.mujoco + 1.0)
