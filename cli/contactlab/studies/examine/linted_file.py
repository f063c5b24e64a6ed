"""Reports the mistakes in a model's files as facts of its examination."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from contactlab.scene.scene_source import SceneSource
from contactlab.schema.examination import Fact, Stage
from contactlab.schema.finding import PlacedFinding
from contactlab.schema.task import QPOS0
from contactlab.studies.lint.linted_model import apply_edits, linted_model
from contactlab.studies.lint.linting import lint_scene
from contactlab.studies.lint.rules import RULES
from contactlab.studies.lint.starts import KEYFRAME_RANGE, largest_excess


def _relative_to_model(file: str, reference: str) -> str:
    """Return a file as the lines of fixes name it: relative to the folder of the model."""
    path, folder = Path(file).absolute(), Path(reference).absolute().parent
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else file


class FileFault(NamedTuple):
    """A mistake of a model's file that makes its runs say nothing of the robot that was meant.

    Attributes:
        rule: of lint.
        sentence: the mistake, and its line.
        stage: of the cause: the file, or the start that its keyframe gives.
        is_of_start: whether the numbers of the start are not those that its file means.
        is_certain: whether the runs say nothing; otherwise the edit of the rule is tried.
        fix: the sentence that a report has instead of a fix; "" if others may help.
    """

    rule: str
    sentence: str
    stage: Stage = "file"
    is_of_start: bool = False
    fix: str = ""
    is_certain: bool = True


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
    """Lint a model's file once, for its faults under a start, and its facts."""
    report = lint_scene(source, reference)
    found = [*report.open("error"), *report.open("warning")]
    faults = [*_list_start_faults(source, reference, start)]
    facts, most_named = list[Fact](), 3
    shown = [one for one in found if not _is_limp(one) and not _voids_start(one, start)]
    for number, finding in enumerate(shown[:most_named], 1):
        place = f"{_relative_to_model(finding.file, reference)}:{finding.line}"
        sentence = f"{place}: {finding.severity}: {finding.message} [{finding.name}]"
        if number == most_named < len(shown):
            sentence += f"; contactlab lint lists {len(shown) - most_named} more"
        place = f"{finding.file}:{finding.line}"
        facts.append(Fact(kind="file", place=place, value=finding.line, unit="", sentence=sentence))
    for finding in found:
        rule, is_limp = RULES[finding.name], _is_limp(finding)
        place = f"{_relative_to_model(finding.file, reference)}:{finding.line}"
        sentence = f"{finding.message} ({place})"
        is_certain = rule.voids_runs or (is_limp and start != QPOS0)
        if is_certain or rule.cause:
            stage = rule.cause or "file"
            faults.append(FileFault(finding.name, sentence, stage, is_certain=is_certain))
        elif is_limp or _voids_start(finding, start):
            line = finding.line
            facts.append(Fact(kind="limp", place=place, value=line, unit="", sentence=sentence))
    return LintedFile(tuple(faults), tuple(facts))


def _is_limp(finding: PlacedFinding) -> bool:
    return RULES[finding.name].voids_postures


def _voids_start(finding: PlacedFinding, start: str) -> bool:
    return RULES[finding.name].voids_starts and f"keyframe '{start}'" in finding.message


def write_rule_edits(
    source: SceneSource, rule: str, folder: Path
) -> tuple[Path, tuple[str, ...]] | None:
    """Write a copy of a model's files with the edits of a rule of lint.

    Returns:
        the main file, and each changed line as `FILE:LINE: ELEMENT`; None without an edit.
    """
    content = source.content
    with linted_model(source) as linted:
        faults = [*RULES[rule].function(linted)]
        changed = apply_edits(iter(faults))
    if not changed or content.resources:
        return None
    for file in content.files:
        target = folder / file
        target.parent.mkdir(parents=True, exist_ok=True)
        if content.root / file in changed:
            target.write_bytes(changed[content.root / file])
        else:
            target.symlink_to((content.root / file).resolve())
    edits = dict.fromkeys(edit for fault in faults for edit in fault.edits)
    lines = (f"{edit.place.file.name}:{edit.place.line}: {edit.text}" for edit in edits)
    return folder / source.model.relative_to(content.root), tuple(lines)


def _list_start_faults(source: SceneSource, reference: str, start: str) -> Iterator[FileFault]:
    if start == QPOS0:
        return
    with linted_model(source) as linted:
        if linted.compiled is None:
            return
        if start not in linted.short_keyframes:
            # A keyframe states a posture, so one that its limits push far at once is not the one
            # meant. A joint that a limit stops softly passes it by less than this share.
            far = 0.05
            if largest_excess(linted.model, linted.starts[start]) <= far:
                return
            place = linted.place("key", start)
            line = f"{_relative_to_model(str(place.file), reference)}:{place.line}"
            for fault in RULES[KEYFRAME_RANGE].function(linted):
                if fault.place == place and f"'{start}'" in fault.message:
                    yield FileFault(KEYFRAME_RANGE, f"{fault.message} ({line})", "start")
            return
        short = linted.short_keyframes[start]
    place = f"{_relative_to_model(str(short.place.file), reference)}:{short.place.line}"
    numbers = f"{short.needed} numbers in {short.attribute} of keyframe {start}"
    yield FileFault(
        "keyframe-length",
        f"keyframe {start} has {short.length} numbers in {short.attribute}, not {short.needed}: "
        f"values act on other joints ({place})",
        is_of_start=True,
        fix=f"write {numbers} ({place}), which has {short.length}; all else follows from it",
    )
