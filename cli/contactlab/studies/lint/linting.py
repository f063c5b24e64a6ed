"""Runs the lint rules on each model."""

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from contactlab.errors import SceneError, no_file
from contactlab.judge.subjects import OUTCOMES
from contactlab.judge.wording import plural
from contactlab.rendering.document import Code, Document, Sentence, document_of
from contactlab.scene.model_files import FileSearch
from contactlab.scene.model_xml import parse_model
from contactlab.scene.mujoco_versions import VERSION
from contactlab.scene.scene_source import MODEL_SUFFIXES, SceneSource, find_scene
from contactlab.schema.finding import PlacedFinding
from contactlab.schema.lint_report import LintReport
from contactlab.step_progress import count_steps
from contactlab.studies.lint.ignores import Ignored, read_ignored_rules
from contactlab.studies.lint.linted_model import Fault, LintedModel, linted_model, shown_path
from contactlab.studies.lint.rules import DOCS, RULES, Rule
from contactlab.writers.report import Report

_UNREAD = "unread"
_IGNORES = Rule("unknown-rule", "warn", lambda _: iter(()))
_PLACED = re.compile(r"(?P<file>.+?\.\w+):(?P<line>\d+):(\d+: )?")


def lint(models: Sequence[str]) -> LintReport:
    """Lint models; files without a model are skipped, included files are linted in their models.

    A SceneError says that there is no such file or scene.
    """
    unique_models, skipped = dict[str, None](), list[str]()
    for model in models:
        path = Path(model).expanduser()
        if path.suffix not in MODEL_SUFFIXES:
            unique_models[model] = None
            continue
        if not path.is_file():
            raise SceneError(no_file(path, "model file", MODEL_SUFFIXES))
        whole = list(map(str, _including_models(path)))
        if whole or _is_model(path):
            unique_models |= dict.fromkeys(whole or [model])
        else:
            skipped.append(model)
    counted_models = count_steps(unique_models, "models", len(unique_models))
    findings = (finding for model in counted_models for finding in _model_findings(model))
    return _report_of(unique_models, skipped, findings)


def lint_scene(source: SceneSource, reference: str) -> LintReport:
    """Lint an open scene; if it is a part that other models include, these are linted."""
    path = Path(reference).expanduser()
    is_file = path.suffix in MODEL_SUFFIXES
    if is_file and (whole := [*map(str, _including_models(path))]):
        return lint(whole)
    return _report_of([reference], (), _scene_findings(source, reference))


def _report_of(
    models: Iterable[str], skipped: Iterable[str], placed_findings: Iterable[PlacedFinding]
) -> LintReport:
    """Return the report of models; those that share a file share its findings."""
    findings = {
        (finding.file, finding.line, finding.name, finding.message): finding
        for finding in placed_findings
    }
    return LintReport(
        mujoco=VERSION,
        models=tuple(models),
        skipped=tuple(skipped),
        findings=tuple(findings.values()),
    )


def _is_model(path: Path) -> bool:
    """Return whether an XML file holds a model; broken XML counts as one.

    MJCF without bodies, and without an include that may have them, is a part of other models.
    """
    try:
        root = parse_model(path)
    except SceneError:
        return True
    has_bodies = any(root.find(tag) is not None for tag in ("worldbody", "include"))
    return has_bodies if root.tag == "mujoco" else root.tag == "robot"


def _including_models(part: Path) -> Iterator[Path]:
    """Yield the models in the folder of a file, or the folder above, that include it."""
    name = part.name.encode()
    for folder in (part.parent, part.parent.parent):
        for path in sorted(folder.glob("*.xml")):
            data = path.read_bytes() if path.is_file() and path != part else b""
            if b"<include" not in data or name not in data:
                continue
            try:
                elements = parse_model(path).iter("include")
                files = [FileSearch().find_model(one, path, path.parent).path for one in elements]
            except SceneError:
                continue
            if part.resolve() in (file.resolve() for file in files):
                yield from list(_including_models(path)) or [path]


def _model_findings(model: str) -> Iterator[PlacedFinding]:
    """Yield the findings in a model, by line."""
    try:
        source = find_scene(model)
    except SceneError as error:
        yield _unreadable_finding(model, str(error))
        return
    yield from _scene_findings(source, model)


def _scene_findings(source: SceneSource, model: str) -> Iterator[PlacedFinding]:
    """Yield the findings in an open scene, by line."""
    try:
        with linted_model(source) as linted:
            but = read_ignored_rules(linted.source)
            findings = [
                _make_finding(declared, fault, linted, but)
                for declared in count_steps(RULES.values(), "rules", len(RULES))
                if linted.compiled is not None or declared.of_refused
                for fault in declared.function(linted)
            ]
            # Comments may ignore an unknown rule.
            findings += [
                _make_finding(_IGNORES, Fault(f"unknown rule '{rule}', {at}"), linted, but)
                for rule, at in but.rules.items()
                if rule not in RULES
            ]
            yield from sorted(findings, key=lambda finding: (finding.file, finding.line))
    except SceneError as error:
        yield _unreadable_finding(model, str(error))


def _make_finding(rule: Rule, fault: Fault, linted: LintedModel, but: Ignored) -> PlacedFinding:
    place = fault.place or linted.place_at(None)
    accepted = but(rule.name, place)
    remedy = [str(edit) for edit in fault.edits]
    most_edits = 4
    if len(remedy) > most_edits:
        remedy[most_edits:] = [f"and {plural(len(remedy) - most_edits, 'such line')} more"]
    return PlacedFinding(
        name=rule.name,
        kind="lint",
        level=rule.level,
        outcome="noted" if accepted else OUTCOMES[rule.level],
        verdict="unmet",
        judged=1,
        failing=1,
        message=fault.message,
        waived=accepted,
        file=shown_path(place.file),
        line=place.line,
        fix=tuple(remedy),
        docs=rule.docs,
    )


def _unreadable_finding(model: str, error: str) -> PlacedFinding:
    """Return the finding of unreadable files, at the line that the error names."""
    place = _PLACED.match(error)
    return PlacedFinding(
        name=_UNREAD,
        kind="lint",
        level="gate",
        outcome="failed",
        verdict="unmet",
        judged=1,
        failing=1,
        message="; ".join(line.strip() for line in error.splitlines()),
        file=shown_path(Path(place["file"]).absolute()) if place else model.rstrip("/"),
        line=int(place["line"]) if place else 1,
        docs=f"{DOCS}#{_UNREAD}",
    )


def findings_of_lint(report: LintReport) -> Report:
    """Return the findings for annotations and SARIF."""
    return Report(
        title="contactlab lint",
        place=("lint",),
        headline=report.headline,
        passed=report.passed,
        record=report,
        facts=(("engine", f"mujoco {report.mujoco}"),),
        findings=report.findings,
        rules={rule.name: rule.about for rule in RULES.values()},
    )


def describe_lint(report: LintReport) -> Document:
    """Describe findings in the style of compilers, errors last, then the counts."""
    lines: list[str] = []
    for word in ("note", "warning", "error"):
        for finding in report.open(word):
            place = f"{finding.file}:{finding.line}"
            lines.append(f"{place}: {word}: {finding.message} [{finding.name}]")
            lines += [f"    {line}" for line in finding.fix]
    head = Sentence(report.headline)
    return document_of([Code(tuple(lines), indent=0), head] if lines else [head])
