"""Reports the mistakes in a model's files as facts of its examination."""

from collections.abc import Iterator
from pathlib import Path

from contactlab.scene.scene_source import SceneSource
from contactlab.schema.examination import Fact
from contactlab.studies.lint.linted_model import linted_model
from contactlab.studies.lint.linting import lint_scene

_MOST = 3


def _relative_to_model(file: str, reference: str) -> str:
    """Return a file as the lines of fixes name it: relative to the folder of the model."""
    path, folder = Path(file).absolute(), Path(reference).absolute().parent
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else file


def file_facts(source: SceneSource, reference: str) -> Iterator[Fact]:
    """Yield the first errors and warnings that lint finds in a model's files, errors first."""
    report = lint_scene(source, reference)
    found = [*report.open("error"), *report.open("warning")]
    more = len(found) - _MOST
    for number, finding in enumerate(found[:_MOST], 1):
        place = f"{finding.file}:{finding.line}"
        name = f"{_relative_to_model(finding.file, reference)}:{finding.line}"
        sentence = f"{name}: {finding.severity}: {finding.message} [{finding.name}]"
        if number == _MOST and more > 0:
            sentence += f"; contactlab lint lists {more} more"
        yield Fact(kind="file", place=place, value=finding.line, unit="", sentence=sentence)


def find_broken_start(source: SceneSource, reference: str, start: str) -> str:
    """Return why the numbers of a start are not those that its file means; "" if they are."""
    with linted_model(source) as linted:
        if start not in linted.short_keyframes:
            return ""
        short = linted.short_keyframes[start]
        name = _relative_to_model(str(short.place.file), reference)
        return (
            f"write {short.needed} numbers in {short.attribute} of keyframe {start} "
            f"({name}:{short.place.line}), which has {short.written}; all else follows from it"
        )
