"""Policy files: read one, and add to it what is accepted."""

from datetime import date
from pathlib import Path
from typing import Any, cast

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from contactlab.errors import PolicyError, did_you_mean
from contactlab.plan import read_as
from contactlab.schema import AcceptedCheck, Check, ComparePolicy, ComparisonReport
from contactlab.store import replacing

_NEW = """\
# What `contactlab compare` accepts; see `contactlab schema policy`.
version: 1
"""


def read_policy(path: Path) -> ComparePolicy:
    """Read a policy file.

    Raises:
        SweepFileError: it cannot be read, or holds mistakes, all of which are in the message.
    """
    return read_as(path, ComparePolicy)


def acceptance(
    report: ComparisonReport, name: str, reason: str, until: date | None
) -> list[AcceptedCheck]:
    """Return the entries that accept what a check found now, one for each group that fell short.

    Args:
        report: of a comparison.
        name: the check's name.
        reason: why it is fine.
        until: last day on which it is; without end if None.

    Raises:
        PolicyError: there is no such check, it passed, or no reason is given.
    """
    if not reason.strip():
        raise PolicyError('what is accepted needs a reason: --reason "..."')
    checks = [check for check in report.checks if check.name == name]
    if not checks:
        names = [check.name for check in report.checks]
        raise PolicyError(f"there is no check '{name}'{did_you_mean(name, names)}")
    short = [check for check in checks if check.outcome in {"failed", "warned"}]
    if not short:
        raise PolicyError(f"'{name}' did not fail ({checks[0].message}): nothing to accept")
    return [_entry(check, reason, until) for check in short]


def accept(path: Path, entries: list[AcceptedCheck]) -> None:
    """Write entries into a policy file, whose comments stay; it is made if there is none.

    An earlier entry of the same check and group is replaced.

    Raises:
        OutputError: the file cannot be written.
        SweepFileError: it cannot be read, or holds mistakes.
    """
    if path.exists():
        read_policy(path)
    yaml = YAML()
    yaml.preserve_quotes = True
    text = path.read_text(encoding="utf-8") if path.exists() else _NEW
    document = cast("CommentedMap", yaml.load(text))
    listed = document.setdefault("accept", CommentedSeq())
    for entry in entries:
        data = entry.model_dump(exclude_none=True)
        same = [place for place, each in enumerate(listed) if _is_same(each, data)]
        for place in reversed(same):
            del listed[place]
        listed.append(CommentedMap(data))
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)


def _entry(check: Check, reason: str, until: date | None) -> AcceptedCheck:
    return AcceptedCheck(
        check=check.name,
        group=check.group or None,
        max=check.failing,
        reason=reason.strip(),
        until=until,
    )


def _is_same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return all(one.get(name) == other.get(name) for name in ("check", "group"))
