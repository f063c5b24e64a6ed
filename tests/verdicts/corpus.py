"""Models that fail in silence, each with a healthy twin, and the truth about both.

A part is a folder here, with `truth.json` and the models that it names. A case is one MJCF text
with a few numbers left open, `<<name>>`: the failing model has one set of them, its twin another.
What is true of either is found by stepping it with plain MuJoCo from its first keyframe (or its
reference configuration) and measuring one quantity (`truth.py`), whose limit was fixed from the
physics of the scene, not from what any label says.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from tests.verdicts.truth import Truth

from contactlab.expression import ExpressionError

FOLDER = Path(__file__).parent
_OPEN = re.compile(r"<<(\w+)>>")

Numbers = dict[str, int | float | str]
_Text = Annotated[str, StringConstraints(min_length=1, strip_whitespace=True)]
_File = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]*\.xml$")]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True, arbitrary_types_allowed=True)


class CorpusError(ValueError):
    """A part cannot be read; the message has the file and the case."""


def _model_of(file: str, info: ValidationInfo) -> str:
    return (Path(str(info.context)) / file).read_text(encoding="utf-8")


def _truth_of(text: object) -> Truth:
    try:
        return Truth(str(text))
    except ExpressionError as error:
        raise ValueError(f"at character {error.start}: {error}") from error


class Case(BaseModel):
    """One failing model and its twin, either of which may be missing.

    Attributes:
        name: of the case.
        kind: what fails: actuator, contact, constraint, passing, loss, support or the like.
        xml: the MJCF, open numbers in `<<name>>`; told as `model`, the name of its file.
        failing: the numbers of the failing model; None where only a sound one is told.
        healthy: those of its twin; None where there is no sound one.
        truth: what is measured of either.
        limit: above it a model has failed; twins stay below half of it.
        duration: how long it is watched [s].
        reason: why the limit is what it is.
        source: where the case comes from; empty where it is that of its part.
        nature: whether the motion is not that of the model, or the model not what it stands for.
        where: bodies, joints, tendons, actuators, geoms or sites; a right reason names one of them.
        removes: changes to the failing model: its twin's, others that mend it also, and not.
        measured: by model (nudged, or of finer steps), what is measured, in units of the limit.
        chaotic: whether its motion hangs on the step, though it is sound.
        driven: whether it has controls, from its keyframe.
    """

    model_config = _STRICT

    name: _Text
    kind: _Text
    xml: Annotated[_File, AfterValidator(_model_of), Field(alias="model")]
    failing: Numbers | None
    healthy: Numbers | None
    truth: Annotated[Truth, BeforeValidator(_truth_of)]
    limit: _Positive
    duration: _Positive
    reason: _Text
    source: str = ""
    nature: Literal["numerical", "model", "sound"] | None = None
    where: list[_Text] = []
    removes: dict[Literal["twin", "also", "not"], _Text | list[_Text]] = {}
    measured: dict[str, float] = {}
    chaotic: bool = False
    driven: bool | None = None

    @model_validator(mode="after")
    def _leaves_no_number_open(self) -> Self:
        if self.failing is None and self.healthy is None:
            raise ValueError("failing and healthy are both null: write the numbers of one at least")
        if self.failing == self.healthy:
            raise ValueError("the failing model and its twin have the same numbers")
        slots = set(_OPEN.findall(self.xml))
        for key, numbers in (("failing", self.failing), ("healthy", self.healthy)):
            if numbers is not None and set(numbers) != slots:
                raise ValueError(
                    f"{key} has {sorted(numbers)}, but its model leaves {sorted(slots)}"
                )
        return self

    @property
    def told(self) -> tuple[bool, ...]:
        """Whether each of its models is healthy: the failing one comes first."""
        return tuple(
            healthy
            for healthy, numbers in ((False, self.failing), (True, self.healthy))
            if numbers is not None
        )

    def text(self, *, healthy: bool) -> str:
        """Return the MJCF of the failing model or its twin."""
        numbers = self.healthy if healthy else self.failing
        if numbers is None:
            raise ValueError(f"'{self.name}' has no {'healthy' if healthy else 'failing'} model")
        return _OPEN.sub(lambda found: str(numbers[found[1]]), self.xml)


@dataclass(frozen=True)
class Part:
    """The cases of a folder, how they were made, and who had seen what."""

    name: str
    about: str
    source: str
    cases: tuple[Case, ...]

    @property
    def held_back(self) -> bool:
        """Whether no rule may be written by it; its folder's name says so."""
        return self.name.startswith("held_back")


class _Part(BaseModel):
    model_config = _STRICT

    part: _Text
    about: _Text
    source: _Text
    cases: Annotated[list[dict[str, object]], Field(min_length=1)]


@cache
def read_corpus(folder: Path = FOLDER) -> tuple[Part, ...]:
    """Return all parts of a folder, the open ones first; a CorpusError says what is wrong where."""
    parts = [read_part(path.parent) for path in sorted(folder.glob("*/truth.json"))]
    return tuple(sorted(parts, key=lambda part: (part.held_back, part.name)))


def read_part(folder: Path) -> Part:
    """Return the part of a folder; a CorpusError names the file and the case."""
    path = folder / "truth.json"
    try:
        told = _Part.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        raise CorpusError(f"{path}: {_first(error)}") from error
    except (OSError, ValueError) as error:
        raise CorpusError(f"{path}: {error}") from error
    if told.part != folder.name:
        raise CorpusError(f"{path}: part is '{told.part}', but the folder '{folder.name}'")
    cases = tuple(_read_cases(path, told))
    orphans = {file.name for file in folder.glob("*.xml")} - {case["model"] for case in told.cases}
    if orphans:
        raise CorpusError(f"{path}: no case has the model {min(orphans)}")
    return Part(told.part, told.about, told.source, cases)


def _read_cases(path: Path, part: _Part) -> Iterator[Case]:
    seen: set[str] = set()
    for number, told in enumerate(part.cases):
        place = f"{path}: case '{told.get('name', number)}'"
        try:
            case = Case.model_validate(told, context=path.parent)
        except (OSError, ValidationError) as error:
            found = _first(error) if isinstance(error, ValidationError) else error
            raise CorpusError(f"{place}: {found}") from error
        if case.name in seen:
            raise CorpusError(f"{place}: another case has this name")
        seen.add(case.name)
        yield case


def _first(error: ValidationError) -> str:
    found = error.errors()[0]
    place = ".".join(str(part) for part in found["loc"])
    return f"{place}: {found['msg']}" if place else found["msg"]
