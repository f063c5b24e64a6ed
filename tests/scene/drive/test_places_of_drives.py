"""The files of a drive are regular, not too large, and where a sweep may name them."""

import os
from pathlib import Path

import pytest

from contactlab.errors import SceneError
from contactlab.scene.drive import located_drive
from contactlab.scene.drive.located_drive import locate_drive
from contactlab.schema.drive import FileDrive, PolicyDrive


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder three below the one that strangers share."""
    folder = tmp_path / "one/two/three"
    folder.mkdir(parents=True)
    (tmp_path / "secret.csv").write_text("time\n0\n")
    (folder / "own.csv").write_text("time\n0\n")
    (folder / "own.py").write_text("")
    return folder


def test_a_sweep_names_files_near_it(folder: Path, tmp_path: Path) -> None:
    assert locate_drive(FileDrive(file="own.csv"), folder).files
    (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    secret = str(tmp_path / "secret.csv")
    for name in (secret, "link.csv", "../../../secret.csv"):
        with pytest.raises(SceneError, match=r"secret.csv|link.csv lies outside"):
            locate_drive(FileDrive(file=name), folder)
    policy = PolicyDrive(policy="own.py:Own", files=(secret,))
    with pytest.raises(SceneError, match="allow its folder"):
        locate_drive(policy, folder)
    assert locate_drive(FileDrive(file=secret), folder, named_by_user=True).files


def test_pipes_and_devices_are_not_read(folder: Path) -> None:
    os.mkfifo(folder / "pipe.csv")
    os.mkfifo(folder / "pipe.py")
    for drive in (
        FileDrive(file="pipe.csv"),
        FileDrive(file="/dev/zero"),
        PolicyDrive(policy="pipe.py:Own"),
        PolicyDrive(policy="own.py:Own", files=("/dev/zero",)),
    ):
        with pytest.raises(SceneError, match="is no regular file"):
            locate_drive(drive, folder, named_by_user=True)


def test_a_file_is_not_read_if_it_is_too_large(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(located_drive, "_MOST_BYTES", 3)
    with pytest.raises(SceneError, match=r"own\.csv has 7 bytes, more than 3"):
        locate_drive(FileDrive(file="own.csv"), folder)
