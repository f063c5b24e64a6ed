"""Reports the mistakes in a model's files as facts of its examination."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from contactlab.scene.scene_source import SceneSource
from contactlab.schema.examination import Fact
from contactlab.schema.finding import PlacedFinding
from contactlab.schema.task import QPOS0
from contactlab.studies.lint.linted_model import linted_model
from contactlab.studies.lint.linting import lint_scene
from contactlab.studies.lint.rules import RULES

_MOST = 3


def _relative_to_model(file: str, reference: str) -> str:
    """Return a file as the lines of fixes name it: relative to the folder of the model."""
    path, folder = Path(file).absolute(), Path(reference).absolute().parent
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else file


class FileFault(NamedTuple):
    """A mistake of a model's file that makes its runs say nothing of the robot that was meant.

    Attributes:
        rule: of lint.
        sentence: the mistake, and its line.
        is_of_start: whether the numbers of the start are not those that its file means.
        fix: the sentence that a report has instead of a fix; "" if others may help.
    """

    rule: str
    sentence: str
    is_of_start: bool = False
    fix: str = ""


@dataclass(frozen=True)
class LintedFile:
    """A model's file, as lint finds it.

    Attributes:
        faults: that runs cannot show.
        facts: the first errors and warnings, errors first.
    """

    faults: tuple[FileFault, ...]
    facts: tuple[Fact, ...]


def lint_file(source: SceneSource, reference: str, start: str) -> LintedFile:
    """Lint a model's file once, for its faults under a start and its facts."""
    report = lint_scene(source, reference)
    found = [*report.open("error"), *report.open("warning")]
    faults = [*_broken_starts(source, reference, start)]
    for finding in found:
        if RULES[finding.name].voids_runs:
            place = f"{_relative_to_model(finding.file, reference)}:{finding.line}"
            faults.append(FileFault(finding.name, f"{finding.message} ({place})"))
    return LintedFile(tuple(faults), tuple(_file_facts(found, reference)))


def _file_facts(found: Sequence[PlacedFinding], reference: str) -> Iterator[Fact]:
    more = len(found) - _MOST
    for number, finding in enumerate(found[:_MOST], 1):
        place = f"{finding.file}:{finding.line}"
        name = f"{_relative_to_model(finding.file, reference)}:{finding.line}"
        sentence = f"{name}: {finding.severity}: {finding.message} [{finding.name}]"
        if number == _MOST and more > 0:
            sentence += f"; contactlab lint lists {more} more"
        yield Fact(kind="file", place=place, value=finding.line, unit="", sentence=sentence)


def _broken_starts(source: SceneSource, reference: str, start: str) -> Iterator[FileFault]:
    if start == QPOS0:
        return
    with linted_model(source) as linted:
        if linted.compiled is None or start not in linted.short_keyframes:
            return
        short = linted.short_keyframes[start]
    place = f"{_relative_to_model(str(short.place.file), reference)}:{short.place.line}"
    numbers = f"{short.needed} numbers in {short.attribute} of keyframe {start}"
    yield FileFault(
        "keyframe-length",
        f"keyframe {start} has {short.written} numbers in {short.attribute}, not {short.needed}: "
        f"values act on other joints ({place})",
        is_of_start=True,
        fix=f"write {numbers} ({place}), which has {short.written}; all else follows from it",
    )
