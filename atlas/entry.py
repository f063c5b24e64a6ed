"""What the atlas says of one robot: an examination, where it is from, and what judged it."""

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from contactlab.schema.examination import Examination
from contactlab.schema.strict_model import Model, about

ROOT = Path(__file__).parents[1]
RECORDS = Path(__file__).parent / "records"
_JUDGING = ("accuracy", "budget", "engines", "judge", "measure", "run", "scene", "studies")
"""Packages of contactlab that a verdict hangs on."""


class Changed(Model):
    """What the same command says of the model with its first change."""

    name: str = about("The change.")
    physics: bool = about("Whether it makes another model.")
    sound: bool
    sentence: str
    nearer: bool | None = about(
        "Whether it is nearer than before to the motion of the original at its finest step, on "
        "fresh seeds; null if not known."
    )


class Confirmation(Model):
    """What plain MuJoCo shows of the cause, without contactlab."""

    command: str
    holds: bool = about("Whether it shows what the verdict names.")
    shown: str


class Entry(Model):
    """One family of near-equal files, by the first of them that is a robot or a scene."""

    entry_version: Literal[1] = 1
    name: str = about("Wheel and path.")
    wheel: str
    version: str
    licence: str
    family: tuple[str, ...] = about("Names of the files that it stands for, its own among them.")
    digest: str = about("SHA-256 of the wheel's version and the file.")
    judge: str = about("SHA-256 of the code that judged.")
    contactlab: str
    mujoco: str
    refused: str = about("Why it has no verdict; else empty.", default="")
    lint: dict[str, int] = about("Findings by severity.", default={})
    examination: Examination | None = None
    sound: bool | None = None
    cpu: float | None = about("Of `contactlab MODEL` [s], the page included.", default=None)
    changed: Changed | None = None
    confirmation: Confirmation | None = None

    @property
    def file(self) -> Path:
        """Its record."""
        return record_of(self.family[0])

    @property
    def flagged(self) -> bool:
        """Whether its budget or a label names a cause."""
        report = self.examination
        return bool(report and (report.labels or (report.budget and report.budget.reasons)))

    @property
    def word(self) -> str:
        """The verdict in a word or two."""
        report = self.examination
        if report is None:
            return "refused"
        word = report.budget.verdict if report.budget else "sound"
        return "not sound" if word in {"sound", "model"} and not self.sound else word

    def save(self) -> None:
        """Write its record."""
        self.file.parent.mkdir(exist_ok=True)
        self.file.write_text(self.model_dump_json() + "\n", encoding="utf-8")


def record_of(name: str) -> Path:
    """Return the record of a family, by the name of its first file."""
    return RECORDS / f"{name.replace('/', '--')}.json"


def entries(folder: Path = RECORDS) -> Iterator[Entry]:
    """Yield what is recorded, by name."""
    for file in sorted(folder.glob("*.json")):
        yield Entry.model_validate_json(file.read_bytes())


def recorded(name: str) -> Entry | None:
    """Return a family's record, unless there is none, or one of an older form."""
    try:
        return Entry.model_validate_json(record_of(name).read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


@cache
def judge_digest() -> str:
    """Return the SHA-256 of the code that a verdict hangs on."""
    digest = hashlib.sha256()
    for package in _JUDGING:
        for file in sorted((ROOT / "cli/contactlab" / package).rglob("*.py")):
            digest.update(f"{file.relative_to(ROOT)}\n".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()
