"""What the atlas says of one robot: an examination, where it is from, and what judged it."""

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Literal

import mujoco
from pydantic import ValidationError

from contactlab.schema.evidence import Setting
from contactlab.schema.examination import Examination
from contactlab.schema.strict_model import Model, about

ROOT = Path(__file__).parents[2]
RECORDS = Path(__file__).parent / "records"
FILMS = Path(__file__).parent / "films"
RELEASES = "releases"
"""Folder of records, in folders named after the MuJoCo that made them, of verdicts alone."""
_JUDGING = ("accuracy", "budget", "judge", "measure", "studies/examine")
"""Packages of contactlab that a verdict hangs on."""
_MENDING = {
    "field_changes.py",
    "fixes.py",
    "primitive_fixes.py",
    "start_fixes.py",
    "time_ratios.py",
}
"""Their files that search fixes, and do not judge."""


class FixedModel(Model):
    """The verdict of the same command on the model with a fix, written into its files."""

    name: str = about("The fix.")
    changes_model: bool = about("Whether it makes another model.")
    apply: str = about("Its name for `--apply`, if it makes another model.", default="")
    passed: bool = about("Whether the model passes, and the first reason is gone.")
    headline: str
    nearer: bool | None = about(
        "Whether it is nearer than before to the motion of the original at its finest step, on "
        "fresh seeds; null if not known.",
        default=None,
    )
    patch: str = about("Of its files; empty for a URDF, and where it is long.", default="")
    shown: bool | None = about(
        "Whether plain MuJoCo still shows the cause in it; null if it was not asked, or shows none "
        "in the original.",
        default=None,
    )


class Confirmation(Model):
    """What plain MuJoCo shows of the cause, without contactlab."""

    command: str
    holds: bool = about("Whether it shows what the verdict names.")
    shown: str


class Gripped(Model):
    """What `contactlab grip` says of it on a bench."""

    word: Literal["holds", "penetrates", "creeps"]
    sentence: str
    speed: float | None = about(
        "Of the worst direction [m/s]; null if the object is lost, or no weight pulled at it."
    )


class Tuned(Model):
    """What `contactlab tune` recommends."""

    sentence: str
    settings: dict[str, Setting] = about("By name; none if it recommends nothing, or leaves out.")
    ratio: float | None = about("Time with them over time without; null if it was not measured.")
    seconds: int = about("What it was given, `--max-cpu` [s].")


class Entry(Model):
    """One family of near-equal files, by the first of them that is a robot or a scene."""

    entry_version: Literal[3] = 3
    name: str = about("Wheel and path.")
    wheel: str
    version: str
    licence: str
    source: str = about("Its repository or home page, as its metadata have it.", default="")
    family: tuple[str, ...] = about("Names of the files that it stands for, its own among them.")
    digest: str = about("SHA-256 of the wheel's version and the file.")
    judge: str = about("SHA-256 of the code that judged.")
    contactlab: str
    mujoco: str
    refused: str = about("Why it has no verdict; else empty.", default="")
    lint: dict[str, int] = about("Findings by severity.", default={})
    examination: Examination | None = None
    passed: bool | None = None
    cpu: float | None = about("Of the examination [s].", default=None)
    max_cpu: int | None = about("What it was given, `--max-cpu` [s].", default=None)
    rate: float | None = about("Simulated over CPU time of MuJoCo's steps of it.", default=None)
    fixed: tuple[FixedModel, ...] = about(
        "The model with its fixes, those that keep the model first, up to the first that passes.",
        default=(),
    )
    confirmation: Confirmation | None = None
    grip: Gripped | None = about("Null where nothing closes, or holds the object.", default=None)
    tuned: Tuned | None = None

    @property
    def working_fix(self) -> FixedModel | None:
        """The fix with which it passes; None if none is needed or known."""
        return next((fixed for fixed in self.fixed if fixed.passed), None)

    @property
    def flagged(self) -> bool:
        """Whether its budget or a label names a cause."""
        report = self.examination
        return bool(report and (report.labels or (report.budget and report.budget.reasons)))

    @property
    def word(self) -> str:
        """The verdict in a word."""
        report = self.examination
        if report is None:
            return "refused"
        word = report.budget.verdict if report.budget else "ok"
        return "fails" if word in {"ok", "depends"} and not self.passed else word

    def save(self, folder: Path) -> None:
        """Write its record into a folder of records."""
        file = record_of(self.family[0], folder)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(self.model_dump_json() + "\n", encoding="utf-8")


def records_of(kind: str) -> Path:
    """Return the folder of whole records, or of the verdicts of this release of MuJoCo alone."""
    return RECORDS / RELEASES / mujoco.__version__ if kind == "verdict" else RECORDS


def film_of(name: str) -> Path:
    """Return the film of a family, by the name of its first file."""
    return FILMS / f"{name.replace('/', '--')}.webp"


def record_of(name: str, folder: Path = RECORDS) -> Path:
    """Return the record of a family, by the name of its first file."""
    return folder / f"{name.replace('/', '--')}.json"


def entries(folder: Path = RECORDS) -> Iterator[Entry]:
    """Yield what is recorded, by name."""
    yield from read_all(folder, "*.json").values()


def read_all(folder: Path, pattern: str = "**/*.json") -> dict[str, Entry]:
    """Return records by their places in a folder, those of other releases with them."""
    return {
        file.relative_to(folder).as_posix(): Entry.model_validate_json(file.read_bytes())
        for file in sorted(folder.glob(pattern))
    }


def releases(folder: Path = RECORDS) -> list[Path]:
    """Return the folders of records of other releases of MuJoCo, the newest first."""
    found = [place for place in folder.glob(f"{RELEASES}/*") if place.is_dir()]
    return sorted(found, key=lambda place: version(place.name), reverse=True)


def version(text: str) -> tuple[int, ...]:
    """Return a version of MuJoCo as numbers that have its order."""
    return tuple(int(part) for part in re.findall(r"\d+", text))


def recorded(name: str, folder: Path = RECORDS) -> Entry | None:
    """Return a family's record, unless there is none, or one of an older form."""
    try:
        return Entry.model_validate_json(record_of(name, folder).read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


@cache
def judge_digest() -> str:
    """Return the SHA-256 of the code that a verdict hangs on."""
    digest = hashlib.sha256()
    for package in _JUDGING:
        for file in sorted((ROOT / "cli/contactlab" / package).rglob("*.py")):
            if file.name in _MENDING:
                continue
            digest.update(f"{file.relative_to(ROOT)}\n".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()
