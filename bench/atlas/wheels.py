"""Finds the robots and scenes in unpacked wheels, one of each family of near-equal files.

A family is what one folder of a wheel holds under one first word: `ant.xml` and `ant_v5.xml`,
`sawyer_door.xml` and sixty other tasks, `random_urdfs/000` to `999`. The first member that compiles
and is no mere object stands for it. Files that others include are parts, not models.
"""

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from email.message import Message
from email.parser import HeaderParser
from itertools import chain, zip_longest
from pathlib import Path, PurePosixPath

_INCLUDED = re.compile(r"""<include\s[^>]*file\s*=\s*["']([^"']+)["']""")
_ROOT = re.compile(r"<(mujoco|robot)\b")
_DIGITS = re.compile(r"\d+")
_SEPARATOR = re.compile(r"[_\-.]")
_SOURCES = ("upstream", "repository", "source", "source code", "homepage")
_LICENCE = "License :: OSI Approved :: "


@dataclass(frozen=True)
class Wheel:
    """A wheel and where it is unpacked.

    Attributes:
        name: of the folder.
        place: that folder.
        version: of the wheel.
        licence: as its metadata has it; empty if they have none.
        source: its repository, home page, or own page.
    """

    name: str
    place: Path
    version: str
    licence: str
    source: str


@dataclass(frozen=True)
class Robot:
    """A file of a wheel that may be a model."""

    wheel: Wheel
    path: PurePosixPath

    @property
    def file(self) -> Path:
        """Where it is."""
        return self.wheel.place / self.path

    @property
    def name(self) -> str:
        """Its wheel and its place there, as a path."""
        return f"{self.wheel.name}/{self.path}"

    @property
    def digest(self) -> str:
        """SHA-256 of the wheel's version and the file; what it includes is the wheel's own."""
        return hashlib.sha256(
            f"{self.wheel.version}\n".encode() + self.file.read_bytes()
        ).hexdigest()


def wheels(folder: Path) -> list[Wheel]:
    """Return the wheels that are unpacked in a folder, by name.

    Raises a FileNotFoundError if it holds none.
    """
    found: list[Wheel] = []
    for metadata in sorted(folder.glob("*/*.dist-info/METADATA")):
        place = metadata.parents[1]
        head = HeaderParser().parsestr(metadata.read_text(encoding="utf-8"))
        classified = [
            value.removeprefix(_LICENCE)
            for value in head.get_all("Classifier", [])
            if value.startswith(_LICENCE)
        ]
        licence = head["License-Expression"] or head["License"] or " ".join(classified)
        first = licence.splitlines()[0] if licence else ""
        found.append(Wheel(place.name, place, head["Version"], first, _source(head)))
    if not found:
        raise FileNotFoundError(
            f"{folder} holds no unpacked wheel; unzip each into a folder of its own there"
        )
    return found


def _source(head: Message) -> str:
    """Return where a wheel says that it is from: its repository or home page; "" if nowhere."""
    urls = [value.partition(", ") for value in head.get_all("Project-URL", [])]
    named = {name.lower(): url for name, _, url in urls}
    found = [named.get(name) for name in _SOURCES]
    return next(filter(None, [*found, head["Home-page"]]), "")


def families(folder: Path) -> list[tuple[Robot, ...]]:
    """Return the families of all wheels: a wheel's first, the next wheel's first, and so on.

    The order within a wheel is that of a hash of names, so that the first of them are no choice of
    anybody's.
    """
    seen: set[str] = set()
    ordered = [
        sorted(_families(wheel, seen), key=lambda family: _drawn(family[0]))
        for wheel in wheels(folder)
    ]
    turns = zip_longest(*ordered)
    return [family for family in chain.from_iterable(turns) if family]


def _drawn(robot: Robot) -> str:
    return hashlib.sha256(robot.name.encode()).hexdigest()


def _families(wheel: Wheel, seen: set[str]) -> list[tuple[Robot, ...]]:
    """Return a wheel's families, without files that another wheel has, whose hashes were seen."""
    found: dict[tuple[str, str], list[Robot]] = {}
    for path in _models(wheel.place):
        content = hashlib.sha256((wheel.place / path).read_bytes()).hexdigest()
        if content in seen:
            continue
        seen.add(content)
        word = _SEPARATOR.split(_DIGITS.sub("", path.stem).strip("_-. "))[0]
        key = (_DIGITS.sub("", str(path.parent)), word.lower())
        found.setdefault(key, []).append(Robot(wheel, path))
    return [tuple(family) for family in found.values()]


def _models(place: Path) -> Iterator[PurePosixPath]:
    """Yield the files that have the root of a model and that no other file includes."""
    texts = {
        path: path.read_text(encoding="utf-8", errors="replace")
        for pattern in ("*.xml", "*.urdf")
        for path in sorted(place.rglob(pattern))
    }
    parts = {
        (path.parent / name).resolve()
        for path, text in texts.items()
        for name in _INCLUDED.findall(text)
    }
    for path, text in texts.items():
        if _ROOT.search(text) and path.resolve() not in parts:
            yield PurePosixPath(path.relative_to(place).as_posix())
