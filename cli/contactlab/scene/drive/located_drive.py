"""A drive with its files: located, hashed, and copied into stores together with the scene."""

import hashlib
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path

from pydantic import ValidationError

from contactlab.errors import DriveFileError, SceneError, no_file
from contactlab.scene.model_guards import check_places
from contactlab.scene.model_xml import check_regular
from contactlab.schema.drive import Drive, FileDrive, PolicyDrive, drive_files, drive_text
from contactlab.schema.setting_values import nonnegative_number, number_parser, positive_number
from contactlab.schema.vocabulary import AxisSpec

_MOST_BYTES = 1 << 30  # of a file of a drive, which is copied into stores


@dataclass(frozen=True)
class LocatedDrive:
    """A drive with its files' names, hash and paths.

    The first file is the one that drives; the list is empty for drives without files.
    """

    drive: Drive
    files: tuple[Path, ...] = ()

    @property
    def hash(self) -> str | None:
        """Start of the hash of its files: the name of their folder in a store; None without."""
        if isinstance(self.drive, FileDrive | PolicyDrive) and drive_files(self.drive):
            return str(self.drive.sha256)[:16]
        return None

    def with_fallback(self, copy: "LocatedDrive") -> "LocatedDrive":
        """Return it, or its copy with the same hash if its own files are missing."""
        return self if all(file.is_file() for file in self.files) else copy

    def check_unchanged(self) -> None:
        """Check that its files are unchanged. Raises a SceneError that names a changed file."""
        assert isinstance(self.drive, FileDrive | PolicyDrive)
        if (sha256 := _hash_files(self.files)) != self.drive.sha256:
            raise SceneError(f"drive: {self.files[0]} has changed: its SHA-256 is now {sha256}")

    def copy_to(self, folder: Path) -> None:
        """Copy its files into a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        for file in self.files:
            shutil.copyfile(file, folder / file.name)


def locate_drive(drive: Drive, folder: Path, *, named_by_user: bool = False) -> LocatedDrive:
    """Find the files of a drive; relative paths start at a folder.

    Unless the user names them, they lie where a model in this folder may name files. A SceneError
    names a file that is missing, or that differs from the hash in a record or store.
    """
    if not isinstance(drive, FileDrive | PolicyDrive):
        return LocatedDrive(drive)
    files = tuple(folder / Path(file).expanduser() for file in drive_files(drive))
    for file in files:
        try:
            check_regular(file)
        except SceneError as error:
            raise DriveFileError(str(error), file) from error
    if not named_by_user:
        check_places(files, folder.absolute())
    sha256 = drive.sha256 or _hash_files(files)
    if isinstance(drive, FileDrive):
        names: dict[str, object] = {"file": Path(drive.file).name}
    else:
        own = tuple(Path(file).name for file in drive.files)
        names = {"policy": Path(drive.policy).name, "files": own}
    located = LocatedDrive(drive.model_copy(update={**names, "sha256": sha256}), files)
    located.check_unchanged()
    return located


def _hash_files(files: tuple[Path, ...]) -> str:
    digest = hashlib.sha256()
    for file in files:
        try:
            if (size := file.stat().st_size) > _MOST_BYTES:
                message = f"drive: {file} has {size:,} bytes, more than {_MOST_BYTES:,}"
                raise DriveFileError(message, file)
            data = file.read_bytes()
        except OSError as error:
            message = f"drive: {no_file(file, 'file', {file.suffix})}"
            raise DriveFileError(message, file) from error
        # For a single file this is the usual SHA-256 of the file.
        head = f"{file.name}\0{len(data)}\0" if len(files) > 1 else ""
        digest.update(head.encode() + data)
    return digest.hexdigest()


def _share_or_seconds(value: object) -> object:
    if isinstance(value, str) and value.endswith("%"):
        return f"{number_parser(least=0)(value.removesuffix('%')):g}%"
    return number_parser(least=0)(value)


_LATENCY_TEXT = "time from a policy's observation to its action; also as a share of its period: 50%"
DRIVE_AXES: Mapping[str, AxisSpec] = {
    axis.name: axis
    for axis in (
        AxisSpec(
            "drive.noise",
            "1",
            "size of random controls, as a share of their range",
            nonnegative_number,
        ),
        AxisSpec(
            "drive.rate",
            "Hz",
            "rate of a policy's actions, or bandwidth of noise",
            positive_number,
        ),
        AxisSpec("drive.latency", "s", _LATENCY_TEXT, _share_or_seconds),
        AxisSpec(
            "drive.noise.qpos",
            "m or rad",
            "noise of the positions a policy observes",
            nonnegative_number,
        ),
        AxisSpec("drive.noise.qvel", "m/s or rad/s", "noise of the velocities", nonnegative_number),
    )
}
"""Numeric parameters of drives as axes; found by name, but not listed."""


def with_values(drive: Drive, values: Mapping[str, object]) -> Drive:
    """Return a drive with the values of axes. Raises a SceneError for a number it does not have."""
    if not values:
        return drive
    setting_names = drive_settings(drive)
    for name in values:
        message = f"{name}: the drive {drive_text(drive)} has no such number"
        SceneError.unless_known(name, setting_names, message, "; `drive` sets the drive of a run")
    assert not isinstance(drive, str)
    data = drive.model_dump()
    for name, value in values.items():
        _, *above, last = name.split(".")
        reduce(getitem, above, data)[last] = value
    try:
        return type(drive).model_validate(data)
    except ValidationError as error:
        raise SceneError(f"drive: {error.errors()[0]['msg']}") from error


def drive_settings(drive: Drive) -> dict[str, float]:
    """Return the numbers of a drive by the names of their axes, times in seconds."""
    if isinstance(drive, str):
        return {}
    flat = {f"drive.{name}": value for name, value in drive.model_dump().items()}
    if isinstance(drive, PolicyDrive):
        noise = flat.pop("drive.noise")
        flat |= {f"drive.noise.{name}": value for name, value in noise.items()}
        flat["drive.latency"] = drive.latency_seconds
    return {name: value for name, value in flat.items() if name in DRIVE_AXES}
