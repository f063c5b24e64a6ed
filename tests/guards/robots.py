"""Public robots from the wheels of others, on which nothing here depends: thirty with a verdict.

`python -m tests.guards.robots FOLDER`, or `make robot-wheels ROBOT_WHEELS=FOLDER`, downloads the
wheels that `robots.json` pins and unpacks each into a folder of its own, as `atlas` has them. The
environment variable ROBOT_WHEELS names that folder; without it these guards are skipped.
"""

import hashlib
import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.atlas.wheels import wheels

PINNED = Path(__file__).with_name("robots.json")
MENAGERIE = "menagerie"
"""Name that stands for a wheel where a robot is in the folder MENAGERIE_ROOT."""


class UnavailableError(Exception):
    """A guard's record cannot be made here; the message says why."""


@dataclass(frozen=True)
class Robot:
    """A robot of a wheel.

    Attributes:
        name: of its records; no other robot has it.
        wheel: the wheel's name, or MENAGERIE.
        version: the wheel's version; empty for the Menagerie.
        path: its place in the wheel.
        sha256: of its file.
        written: whether the files that commands write for it are recorded too.
    """

    name: str
    wheel: str
    version: str
    path: str
    sha256: str
    written: bool

    def find(self) -> Path:
        """Return its file.

        Raises:
            UnavailableError: the wheel is missing or another version, or the file is another.
        """
        path = _menagerie() if self.wheel == MENAGERIE else _unpacked(self.wheel, self.version)
        file = path / self.path
        if not file.is_file():
            raise UnavailableError(f"{self.wheel} {self.version} has no {self.path}")
        if hashlib.sha256(file.read_bytes()).hexdigest() != self.sha256:
            raise UnavailableError(f"{self.wheel}/{self.path} is not the file that is pinned")
        return file


@cache
def pinned_robots() -> tuple[Robot, ...]:
    """Return all robots."""
    return tuple(Robot(**each) for each in json.loads(PINNED.read_text(encoding="utf-8")))


def _menagerie() -> Path:
    folder = os.environ.get("MENAGERIE_ROOT")
    if not folder:
        raise UnavailableError("MENAGERIE_ROOT names no folder of the MuJoCo Menagerie")
    return Path(folder)


def _unpacked(name: str, version: str) -> Path:
    folder = os.environ.get("ROBOT_WHEELS")
    if not folder:
        raise UnavailableError("ROBOT_WHEELS names no folder of unpacked wheels: make robot-wheels")
    try:
        found = {wheel.name: wheel for wheel in wheels(Path(folder))}
    except FileNotFoundError as error:
        raise UnavailableError(str(error)) from error
    if name not in found:
        raise UnavailableError(f"{name} {version} is not unpacked in ROBOT_WHEELS")
    if found[name].version != version:
        raise UnavailableError(f"{name} is {found[name].version} in ROBOT_WHEELS, not {version}")
    return found[name].place


def main(words: Sequence[str]) -> None:
    """Download and unpack the wheels that are pinned, unless they are there."""
    (folder,) = map(Path, words)
    folder.mkdir(parents=True, exist_ok=True)
    pins = {robot.wheel: robot.version for robot in pinned_robots() if robot.wheel != MENAGERIE}
    for name, version in pins.items():
        if any((folder / name).glob("*.dist-info")):
            continue
        with TemporaryDirectory(dir=folder) as downloaded:
            subprocess.run(
                [
                    *(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"),
                    *("--only-binary", ":all:", "--dest", downloaded, f"{name}=={version}"),
                ],
                check=True,
            )
            (wheel,) = Path(downloaded).glob("*.whl")
            with zipfile.ZipFile(wheel) as content:
                content.extractall(folder / name)


if __name__ == "__main__":
    main(sys.argv[1:])
