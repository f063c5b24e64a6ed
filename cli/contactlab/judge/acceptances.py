"""Failures that are known and accepted: what they change, and the file that lists them."""

from collections.abc import Collection, Sequence
from datetime import date
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from contactlab.errors import PolicyError
from contactlab.plan.sweep_file import read_yaml_as
from contactlab.schema.comparison import ComparePolicy
from contactlab.schema.finding import Acceptance, Finding
from contactlab.store.atomic_files import atomic_write

_FAILING = {"failed", "warned"}
_NEW_FILE = """\
# What `contactlab compare` accepts; see `contactlab schema policy`.
version: 1
"""


def acceptance(
    findings: Sequence[Finding], name: str, reason: str, until: date | None
) -> list[Acceptance]:
    """Return the entries that accept a failing check until a day, one for each group that fails.

    A PolicyError says that there is no such check, that it passed, or that no reason is given.
    """
    if not reason.strip():
        raise PolicyError('an accepted check needs a reason: --reason "..."')
    named = [finding for finding in findings if finding.name == name]
    names = [finding.name for finding in findings]
    PolicyError.unless_known(name, names, f"there is no check '{name}'")
    failing = [finding for finding in named if finding.outcome in _FAILING]
    if not failing:
        raise PolicyError(f"'{name}' did not fail ({named[0].message}): nothing to accept")
    reason = reason.strip()
    return [
        Acceptance(
            check=name, group=finding.group or None, max=finding.failing, reason=reason, until=until
        )
        for finding in failing
    ]


def accept(path: Path, entries: Sequence[Acceptance]) -> None:
    """Write entries into a policy file, whose comments stay; a missing file is created.

    An earlier entry of the same check and group is replaced. An OutputError says that the file
    cannot be written, a SweepFileError what is wrong with the one that is there.
    """
    if path.exists():
        read_yaml_as(path, ComparePolicy)
    yaml = YAML()
    yaml.preserve_quotes = True
    document = yaml.load(path.read_text(encoding="utf-8") if path.exists() else _NEW_FILE)
    listed = document.setdefault("accept", CommentedSeq())
    for entry in entries:
        named = (entry.check, entry.group)
        for old in [
            listed_entry
            for listed_entry in listed
            if (listed_entry["check"], listed_entry.get("group")) == named
        ]:
            listed.remove(old)
        listed.append(CommentedMap(entry.model_dump(exclude_none=True)))
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)


def apply_acceptances(
    findings: Sequence[Finding],
    accepted: Sequence[Acceptance],
    today: date,
    known: Collection[str] = (),
) -> list[Finding]:
    """Return the findings; those that fail and are accepted become notes.

    Entries may also name checks that are known, but were not made this time; any other name is a
    PolicyError.
    """
    names = {*known, *(finding.name for finding in findings)}
    for entry in accepted:
        message = f"the policy accepts '{entry.check}', which is not a check"
        PolicyError.unless_known(entry.check, names, message)
    return [_accepted(finding, accepted, today) for finding in findings]


def stale_acceptances(
    findings: Sequence[Finding], accepted: Sequence[Acceptance]
) -> list[Acceptance]:
    """Return the entries whose check was made, and does not fail."""
    made = {finding.name for finding in findings if finding.outcome != "skipped"}
    return [
        entry
        for entry in accepted
        if entry.check in made
        and not any(
            finding.outcome in _FAILING or finding.accepted
            for finding in findings
            if _covers(entry, finding)
        )
    ]


def _covers(entry: Acceptance, finding: Finding) -> bool:
    return entry.check == finding.name and entry.group in {None, finding.group}


def _accepted(finding: Finding, entries: Sequence[Acceptance], today: date) -> Finding:
    if finding.outcome not in _FAILING:
        return finding
    entry = next((accepted for accepted in entries if _covers(accepted, finding)), None)
    if entry is None:
        return finding
    if entry.until is not None and entry.until < today:
        obstacle = f"until {entry.until}"
    elif finding.failing > entry.max:
        obstacle = f"for {entry.max:,}, but {finding.failing:,} fall short"
    else:
        return finding.model_copy(update={"outcome": "noted", "accepted": entry.reason})
    message = f"{finding.message}; accepted {obstacle} ({entry.reason})"
    return finding.model_copy(update={"message": message})
