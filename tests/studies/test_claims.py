"""A study's folder has the results of one model, and says whose."""

from pathlib import Path

import pytest

from contactlab.errors import OutputError
from contactlab.tasks.session import Session, free_folder, own_folder


def models(folder: Path) -> list[str]:
    paths = [folder / each / "robot.xml" for each in ("a", "b")]
    for path in paths:
        path.parent.mkdir(parents=True)
        path.write_text("<mujoco/>")
    return [str(path) for path in paths]


def test_another_model_s_results_are_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = models(tmp_path)
    session = Session(tmp_path / "results")
    session.claim("check", one)
    session.claim("effects", other)
    session.claim("check", one)
    monkeypatch.chdir(Path(one).parent)
    session.claim("check", "robot.xml")
    before = (session.folder / "sources.json").read_text()
    with pytest.raises(OutputError, match=f"has the results of {one}; write elsewhere with -o"):
        session.claim("check", other)
    assert (session.folder / "sources.json").read_text() == before


def test_shipped_scenes_and_robots_are_themselves_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(tmp_path / "results")
    monkeypatch.chdir(tmp_path)
    session.claim("check", "menagerie:robot/entry")
    session.claim("effects", "ball_drop")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    session.claim("check", "menagerie:robot/entry")
    session.claim("effects", "ball_drop")


def test_each_of_two_models_of_one_name_has_a_folder(tmp_path: Path) -> None:
    """What is no model's results is passed over, and one that has a folder keeps it."""
    one, other = models(tmp_path)
    results = tmp_path / "results"
    for model, name in ((one, "a-robot"), (other, "b-robot"), (one, "a-robot")):
        with free_folder(results, "examine", model) as folder:
            assert folder == results / name
            Session(folder).claim("examine", model)
    third = tmp_path / "elsewhere/a/robot.xml"
    third.parent.mkdir(parents=True)
    third.write_text("<mujoco/>")
    (results / "a-robot-2").write_text("mine")
    with free_folder(results, "examine", str(third)) as folder:
        assert folder == results / "a-robot-3"
    assert not folder.exists()


def test_a_study_of_a_second_model_of_one_name_is_kept_beside_the_first(tmp_path: Path) -> None:
    """Each finds its own again, to print and to resume; what has no claim may be anyone's."""
    (one, _), results = models(tmp_path), tmp_path / "results" / "tune"
    second = tmp_path / "elsewhere/a/robot.xml"
    second.parent.mkdir(parents=True)
    second.write_text("<mujoco/>")
    for model, name in ((one, "a-robot"), (str(second), "a-robot-2")) * 2:
        folder = own_folder(results, model)
        assert folder == results / name
        folder.mkdir(parents=True, exist_ok=True)
        Session(folder).claim("tune", model)


def test_variants_and_commands_at_once_have_folders_of_their_own(tmp_path: Path) -> None:
    (one, _), results = models(tmp_path), tmp_path / "results"
    with free_folder(results, "examine", one, ["timestep=1e-3", "solref=.01 1"]) as folder:
        assert folder == results / "a-robot_timestep=1e-3_solref=.01_1"
        Session(folder).claim("examine", one)
        with free_folder(results, "examine", one, ["timestep=1e-3", "solref=.01 1"]) as second:
            assert second == results / "a-robot_timestep=1e-3_solref=.01_1-2"


@pytest.mark.parametrize("text", ["[]", "{", '{"check": 1}', "[" * 100_000])
def test_a_damaged_claim_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "sources.json").write_text(text)
    with pytest.raises(OutputError, match=r"sources\.json is damaged; remove it"):
        Session(tmp_path).claim("check", "ball_drop")
