"""A study's folder has the results of one model, and says whose."""

from pathlib import Path

import pytest

from contactlab.errors import OutputError
from contactlab.tasks.session import Session, free_folder


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
    for model, name in ((one, "robot"), (other, "robot-2"), (one, "robot"), (other, "robot-2")):
        folder = free_folder(results, "examine", model)
        assert folder == results / name
        Session(folder).claim("examine", model)
    (results / "robot-3").write_text("mine")
    (tmp_path / "c").mkdir()
    (tmp_path / "c/robot.xml").write_text("<mujoco/>")
    assert free_folder(results, "examine", str(tmp_path / "c/robot.xml")) == results / "robot-4"


@pytest.mark.parametrize("text", ["[]", "{", '{"check": 1}', "[" * 100_000])
def test_a_damaged_claim_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "sources.json").write_text(text)
    with pytest.raises(OutputError, match=r"sources\.json is damaged; remove it"):
        Session(tmp_path).claim("check", "ball_drop")
