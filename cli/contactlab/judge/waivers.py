"""Waivers: failed checks that pass for a stated reason, and the file that lists them."""

from collections.abc import Collection, Sequence
from datetime import date
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from contactlab.errors import PolicyError
from contactlab.plan.sweep_file import read_yaml_as
from contactlab.schema.comparison import ComparePolicy
from contactlab.schema.finding import Finding, Waiver
from contactlab.store.atomic_files import atomic_write

_FAILING = {"failed", "warned"}
_NEW_FILE = """\
# Policy of `contactlab compare`; see `contactlab list schemas policy`.
version: 1
"""


def waivers_for(
    findings: Sequence[Finding], name: str, reason: str, until: date | None
) -> list[Waiver]:
    """Return the waivers of a failed check until a day, one for each group that fails.

    Raises:
        PolicyError: there is no such check, it passed, or the reason is missing.
    """
    if not reason.strip():
        raise PolicyError('a waiver needs a reason: --reason "..."')
    findings_of_name = [finding for finding in findings if finding.name == name]
    names = [finding.name for finding in findings]
    PolicyError.unless_known(name, names, f"there is no check '{name}'")
    failing = [finding for finding in findings_of_name if finding.outcome in _FAILING]
    if not failing:
        raise PolicyError(
            f"'{name}' did not fail ({findings_of_name[0].message}): nothing to waive"
        )
    reason = reason.strip()
    return [
        Waiver(
            check=name, group=finding.group or None, max=finding.failing, reason=reason, until=until
        )
        for finding in failing
    ]


def add_waivers(path: Path, waivers: Sequence[Waiver]) -> None:
    """Write waivers into a policy file and keep its comments; create a missing file.

    An earlier waiver of the same check and group is replaced.

    Raises:
        OutputError: the file cannot be written.
        SweepFileError: the existing file has a mistake.
    """
    if path.exists():
        read_yaml_as(path, ComparePolicy)
    yaml = YAML()
    yaml.preserve_quotes = True
    document = yaml.load(path.read_text(encoding="utf-8") if path.exists() else _NEW_FILE)
    entries = document.setdefault("waive", CommentedSeq())
    for waiver in waivers:
        target = (waiver.check, waiver.group)
        for old in [entry for entry in entries if (entry["check"], entry.get("group")) == target]:
            entries.remove(old)
        entries.append(CommentedMap(waiver.model_dump(exclude_none=True)))
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)


def apply_waivers(
    findings: Sequence[Finding],
    waivers: Sequence[Waiver],
    today: date,
    known_names: Collection[str] = (),
) -> list[Finding]:
    """Return the findings; failed ones with a waiver become notes.

    Waivers may also name known checks that were not made this time.

    Raises:
        PolicyError: a waiver names any other check.
    """
    names = {*known_names, *(finding.name for finding in findings)}
    for waiver in waivers:
        message = f"the policy waives '{waiver.check}', which is not a check"
        PolicyError.unless_known(waiver.check, names, message)
    return [_apply_waiver(finding, waivers, today) for finding in findings]


def unused_waivers(findings: Sequence[Finding], waivers: Sequence[Waiver]) -> list[Waiver]:
    """Return the waivers of checks that were made and did not fail."""
    made_checks = {finding.name for finding in findings if finding.outcome != "skipped"}
    return [
        waiver
        for waiver in waivers
        if waiver.check in made_checks
        and not any(
            finding.outcome in _FAILING or finding.waived
            for finding in findings
            if _matches_finding(waiver, finding)
        )
    ]


def _matches_finding(waiver: Waiver, finding: Finding) -> bool:
    return waiver.check == finding.name and waiver.group in {None, finding.group}


def _apply_waiver(finding: Finding, waivers: Sequence[Waiver], today: date) -> Finding:
    if finding.outcome not in _FAILING:
        return finding
    waiver = next((waiver for waiver in waivers if _matches_finding(waiver, finding)), None)
    if waiver is None:
        return finding
    if waiver.until is not None and waiver.until < today:
        obstacle = f"until {waiver.until}"
    elif finding.failing > waiver.max:
        obstacle = f"for {waiver.max:,}, but {finding.failing:,} fail"
    else:
        return finding.model_copy(update={"outcome": "noted", "waived": waiver.reason})
    message = f"{finding.message}; waived {obstacle} ({waiver.reason})"
    return finding.model_copy(update={"message": message})
