"""Advisories show their fault where they say so, and mistakes in them are named."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML
from tests.advisories.advisory_index import advisory_index

import contactlab
from contactlab import resources
from contactlab.advisories.advisory_files import (
    list_advisories,
    parse_advisory,
    read_advisories,
    read_advisory,
)
from contactlab.advisories.field_expressions import ModelFacts
from contactlab.advisories.met_advisories import InstalledEngine, can_act, find_met_advisories
from contactlab.advisories.witness_runs import compile_witness, fault_share, replay_witness
from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.errors import AdvisoryError, EngineError
from contactlab.parts import register_parts
from contactlab.scene.scene_source import find_scene
from contactlab.schema.advisory import Advisory, AffectedReleases
from contactlab.studies.advisories.checking import check_advisories
from contactlab.studies.examine.engine_faults import (
    find_met_faults,
    list_workarounds,
)
from contactlab.studies.lock.versions import list_supported_releases

register_parts()
FILES = sorted(resources.ADVISORIES.glob("*.yaml"))
SHOWN = {
    "id": "LAB-2026-0001",
    "title": "A ball falls at the wrong rate",
    "consequence": "It is for tests only.",
    "affected": [{"introduced": "3.3.4", "fixed": "9.0.0"}],
    "severity": "wrong result",
    "applies": "any(geom_type == 'sphere')",
    "witness": {
        "model": "<mujoco><worldbody><body><freejoint name='ball'/><geom size='.1'/></body>"
        "</worldbody></mujoco>",
        "measure": "qacc['ball', 2]",
        "right": -1.62,
        "wrong": -9.81,
        "tolerance": 0.01,
        "reason": "On the Moon it is.",
    },
    "advice": "Go to the Moon.",
}


def written(folder: Path, **changes: Any) -> Path:
    """Write an advisory with changes; `witness__right=1` changes an entry of its witness."""
    data: dict[str, Any] = {**SHOWN, "witness": {**SHOWN["witness"]}}  # pyright: ignore[reportGeneralTypeIssues]
    for name, value in changes.items():
        group, _, key = name.rpartition("__")
        (data[group] if group else data)[key] = value
    file = folder / "advisory.yaml"
    YAML().dump(data, file)
    return file


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_witness_shows_its_fault_here_only_if_this_release_has_it(file: Path) -> None:
    advisory = read_advisory(file)
    assert advisory.id == file.stem
    affected = advisory.affects_release(mujoco.__version__)
    try:
        run = replay_witness(advisory)
    except AdvisoryError:  # a fix may be that the model is refused
        assert advisory.severity == "crash" or not affected
        return
    if affected:
        assert not run.obstacle
        assert fault_share(advisory.witness, run.measured) >= 0.5
    else:
        assert run.measured == pytest.approx(
            advisory.witness.right, abs=advisory.witness.tolerance, rel=0
        )


def test_all_are_listed_in_order() -> None:
    assert [each.id for each in list_advisories()] == [file.stem for file in FILES]


@pytest.mark.parametrize(
    ("introduced", "fixed", "inside"),
    [
        ("0", "3.10.0", ["3.3.4", "3.9.0", "3.8.1"]),
        ("3.9.0", "3.11.0", ["3.9.0", "3.10.0"]),
        ("3.10.0", None, ["3.10.0", "3.11.0", "4.0.0"]),
    ],
)
def test_a_range_begins_with_its_first_release_and_ends_before_the_fix(
    introduced: str, fixed: str | None, inside: list[str]
) -> None:
    known = ["3.3.4", "3.8.1", "3.9.0", "3.10.0", "3.11.0", "4.0.0"]
    found = [
        release
        for release in known
        if AffectedReleases(introduced=introduced, fixed=fixed).includes_release(release)
    ]
    assert found == sorted(inside, key=known.index)


def test_a_model_meets_what_applies_to_it_under_an_affected_engine(tmp_path: Path) -> None:
    advisory = read_advisory(written(tmp_path))
    ball = mujoco.MjModel.from_xml_string(advisory.witness.model)
    box = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='box' size='1 1 1'/></worldbody></mujoco>"
    )
    here = InstalledEngine("mujoco", "4.0.0")
    assert find_met_advisories(ball, here, advisories=[advisory]) == (advisory,)
    assert not find_met_advisories(box, here, advisories=[advisory])
    assert not find_met_advisories(ball, InstalledEngine("mujoco", "9.0.0"), advisories=[advisory])
    assert not find_met_advisories(ball, InstalledEngine("newton", "4.0.0"), advisories=[advisory])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"applies": "geom_type = 'box'"}, "applies"),
        ({"witness__measure": "qacc['ball'"}, "witness.measure"),
        ({"witness__wrong": -1.63}, "measure something that differs more"),
        ({"workarounds": [{"modification": "jacobien", "settings": {}}]}, "mean 'jacobian'"),
        (
            {"workarounds": [{"modification": "jacobian", "settings": {"cone": "elliptic"}}]},
            "does not set cone",
        ),
        ({"witness__model": "<mujoco/><mujoco/>"}, "witness.model:1:10: not XML"),
        ({"advice": ""}, "name a modification"),
        ({"id": "one"}, "id"),
        ({"severity": "bad"}, "severity"),
        ({"colour": "red"}, "colour"),
        ({"affected": []}, "affected"),
    ],
)
def test_a_mistake_is_named(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(AdvisoryError, match=said):
        read_advisory(written(tmp_path, **changes))


def test_two_files_cannot_have_one_id(tmp_path: Path) -> None:
    first = written(tmp_path)
    second = tmp_path / "again.yaml"
    second.write_bytes(first.read_bytes())
    with pytest.raises(AdvisoryError, match=r"another LAB-2026-0001"):
        read_advisories([first, second])


@pytest.mark.parametrize("text", ["a: [", "- 1", "", "\0"])
def test_other_text_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "advisory.yaml"
    file.write_text(text)
    with pytest.raises(AdvisoryError, match=r"advisory\.yaml"):
        read_advisory(file)


def test_planted_mistakes_are_found(tmp_path: Path) -> None:
    """One process replays all: right, wrong releases, an unclear value, a crash, a refusal."""
    planted: dict[str, dict[str, Any]] = {
        "LAB-2026-0001": {},
        "LAB-2026-0002": {"affected": [{"introduced": "9.0.0"}]},
        "LAB-2026-0003": {"witness__right": -9.81, "witness__wrong": 0},
        "LAB-2026-0004": {"witness__right": 0, "witness__wrong": -30},
        "LAB-2026-0005": {"applies": "nmesh > 0"},
        "LAB-2026-0006": {"witness__model": "<mujoco><worldbody><geom/></worldbody></mujoco>"},
    }
    read = list[Advisory]()
    for name, changes in planted.items():
        read.append(read_advisory(written(tmp_path, id=name, **changes)))
    report = check_advisories(read, [mujoco.__version__])
    assert [result.outcome for result in report.results] == [
        *("shown", "shown", "not shown", "unclear", "shown", "not run")
    ]
    assert [bool(result.mistake) for result in report.results] == [False, *[True] * 5]
    for name in (*planted,)[1:]:
        assert name in report.problem
    assert "the measured value -9.81 is neither right nor wrong" in report.problem
    assert "does not apply to the witness: applies is false" in report.problem
    assert "5 of 6 advisories wrong" in report.headline


@pytest.mark.long
def test_a_process_that_ends_is_a_crash_and_the_rest_is_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "contactlab.studies.advisories.checking._PROCESS", "tests.advisories.dying_process"
    )
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    read = [read_advisory(written(tmp_path, id=f"LAB-2026-000{n}")) for n in (1, 2, 3)]
    report = check_advisories(read, [mujoco.__version__])
    assert [result.outcome for result in report.results] == ["shown", "crashed", "shown"]


def test_a_process_that_cannot_import_is_an_error_and_no_crash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("contactlab.studies.advisories.checking._PROCESS", "missing_process")
    read = [read_advisory(written(tmp_path))]
    with pytest.raises(EngineError, match=r"replayed under MuJoCo .* No module named") as error:
        check_advisories(read, [mujoco.__version__])
    assert error.value.exit_code == 2
    assert "PYTHONPATH" in str(error.value)
    assert capfd.readouterr().err == ""


AFFECTED = """<mujoco><option jacobian="sparse"/><worldbody>
  <body name="ball" pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


def move_freely(text: str, steps: int = 10) -> Motion:
    """Return a motion from qpos0 without inputs."""
    model = mujoco.MjModel.from_xml_string(text)
    start = np.zeros((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    return Motion(model, start, np.zeros((1, steps, 0)))


@pytest.fixture
def sparse_is_wrong(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Advisory:
    """An advisory of all releases, about sparse Jacobians; and a model in the current folder."""
    ways = [{"modification": "jacobian", "settings": {"jacobian": "dense"}}]
    changes = {"affected": [{"introduced": "0"}], "applies": "sparse_jacobian", "workarounds": ways}
    advisory = read_advisory(written(tmp_path, **changes))
    monkeypatch.setattr("contactlab.advisories.met_advisories.list_advisories", lambda: (advisory,))
    (tmp_path / "ball.xml").write_text(AFFECTED)
    monkeypatch.chdir(tmp_path)
    return advisory


def test_a_sweep_and_its_plan_say_which_advisories_are_met(sparse_is_wrong: Advisory) -> None:
    data = {
        "version": 1,
        "scene": "ball.xml",
        "duration": 0.01,
        "axes": {"jacobian": ["sparse", "dense", "auto"]},
    }
    plan: Any = contactlab.sweep(data, plan=True, workers=0)
    (warning,) = [each for each in plan.warnings if sparse_is_wrong.id in each]
    assert warning.startswith("1 of 3 models: meets LAB-2026-0001")
    assert "avoided by jacobian=dense" in warning
    store = contactlab.sweep(data, workers=0)
    assert store.manifest.advisories == (sparse_is_wrong.id,)
    axes = {**data, "axes": {"jacobian": ["dense", "auto"]}}
    other = contactlab.sweep(axes, workers=0, output="other")
    assert other.manifest.advisories == ()
    assert "advisories" not in Path("other/manifest.json").read_text(encoding="utf-8")


def test_an_examination_repairs_a_met_fault_by_its_workaround(sparse_is_wrong: Advisory) -> None:
    scene = find_scene("ball.xml")
    motion = move_freely(AFFECTED)
    model = motion.model
    (fact,) = find_met_faults([motion], [0.0], scene).facts
    assert fact.place == sparse_is_wrong.id
    (workaround,) = list_workarounds(model, scene)
    assert workaround.settings == {"jacobian": "dense"}
    assert sparse_is_wrong.id in workaround.sentence
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    assert not find_met_faults([motion], [0.0], scene).facts


@pytest.mark.parametrize(("height", "acts"), [(0.16, True), (5.0, False)])
def test_an_examination_says_whether_a_fault_acts_in_the_run(
    height: float, acts: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A ball that falls from 5 m does not land within 200 steps of 2 ms.
    way = {"modification": "jacobian", "settings": {"jacobian": "dense"}}
    changes = {
        "affected": [{"introduced": "0"}],
        "occurs": "ncon > 0",
        "workarounds": [way],
    }
    advisory = read_advisory(written(tmp_path, **changes))
    monkeypatch.setattr("contactlab.advisories.met_advisories.list_advisories", lambda: (advisory,))
    (tmp_path / "ball.xml").write_text(AFFECTED)
    monkeypatch.chdir(tmp_path)
    motion = move_freely(
        f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/>
        <body pos="0 0 {height}"><freejoint/><geom size=".1"/></body></worldbody></mujoco>""",
        200,
    )
    met = find_met_faults([motion], [0.0], find_scene("ball.xml"))
    (fact,) = met.facts
    assert fact.value == acts == met.acts
    # It falls 60 mm in .11 s, and each window has 20 ms.
    assert ("in this run, from 0.12 s" in fact.sentence) == acts
    assert ("but not in this run" in fact.sentence) != acts


def test_the_solver_fault_acts_where_the_equation_of_motion_is_not_solved() -> None:
    advisory = next(each for each in list_advisories() if each.id == "CL-2026-0001")
    model = compile_witness(advisory.witness)
    if not advisory.affects_release(mujoco.__version__):
        pytest.skip("this release is not affected")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert can_act(advisory, ModelFacts(model, data))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    mujoco.mj_forward(model, data)
    assert not can_act(advisory, ModelFacts(model, data))


@pytest.mark.night
def test_every_witness_shows_its_fault_in_the_affected_releases_only() -> None:
    report = check_advisories(list_advisories(), list_supported_releases())
    assert report.problem == ""


def test_the_index_has_the_files_content() -> None:
    message = "make it anew: python -m tests.advisories.advisory_index"
    assert resources.advisory_index() == advisory_index(), message
    for file in FILES:
        assert read_advisory(file) == parse_advisory(file)
