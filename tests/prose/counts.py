"""How often each file breaks each rule, and the stored counts, which may not rise.

A line of `counts.txt` is a file with its counts. A file that is not there has none. The allowance
of a file that is gone serves the files whose counts rise, so that a rename or a merge of modules
passes. Two branches may both change the file: git keeps the lines of both (`.gitattributes`), and
the larger count is the one that is allowed until `--lower` writes it again.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from tests.prose.rules import Finding, find_problems
from tests.prose.texts import read_file

ROOT = Path(__file__).parents[2]
STORED = Path(__file__).with_name("counts.txt")

Counts = Mapping[str, Mapping[str, int]]


class RisenError(Exception):
    """Counts that may not be written, since they rose."""


@dataclass(frozen=True)
class Rise:
    """A file that breaks a rule more often than it may."""

    path: str
    rule: str
    count: int
    allowed: int


def list_files(root: Path = ROOT) -> Iterator[Path]:
    """Yield the checked files: the package, adapters, the atlas, documentation and examples.

    Tests and other benchmarks are not checked: users do not read them, and their names are
    sentences.
    """
    for folder in ("adapters", "bench/atlas", "changelog.d", "cli", "docs", "examples"):
        for suffix in ("py", "md"):
            yield from sorted((root / folder).rglob(f"*.{suffix}"))
    yield from sorted(root.glob("*.md"))
    yield from sorted((root / ".github").glob("*.md"))


def find_all(root: Path = ROOT) -> dict[str, list[Finding]]:
    """Return the findings of each checked file."""
    return {
        path.relative_to(root).as_posix(): find_problems(read_file(path), path)
        for path in list_files(root)
    }


def count_findings(findings: Mapping[str, list[Finding]]) -> dict[str, Counter[str]]:
    """Return how often each file breaks each rule."""
    return {path: Counter(each.rule for each in rows) for path, rows in findings.items()}


def find_rises(counts: Counts, stored: Counts) -> list[Rise]:
    """Return the counts above the stored ones that no file that is gone makes up for."""
    spare = total_counts({path: row for path, row in stored.items() if path not in counts})
    rises = [
        Rise(path, rule, count, stored.get(path, {}).get(rule, 0))
        for path, row in counts.items()
        for rule, count in row.items()
        if count > stored.get(path, {}).get(rule, 0)
    ]
    excess: Counter[str] = Counter()
    for rise in rises:
        excess[rise.rule] += rise.count - rise.allowed
    return [rise for rise in rises if excess[rise.rule] > spare[rise.rule]]


def lowered_counts(counts: Counts, stored: Counts, *, moved: bool) -> dict[str, dict[str, int]]:
    """Return the counts to store, without zeros.

    With `moved`, a count may rise if the sum over all files does not: text moved between files.

    Raises:
        RisenError: if counts rose.
    """
    if moved:
        before, now = total_counts(stored), total_counts(counts)
        risen = [f"{rule}: {now[rule]} of {before[rule]}" for rule in now - before]
    else:
        risen = [f"{each.path}: {each.rule}" for each in find_rises(counts, stored)]
    if risen:
        raise RisenError(", ".join(risen))
    return {path: {rule: n for rule, n in row.items() if n} for path, row in counts.items()}


def total_counts(counts: Counts) -> Counter[str]:
    """Return the sum over all files, per rule."""
    total: Counter[str] = Counter()
    for row in counts.values():
        total.update(row)
    return total


def read_counts(path: Path = STORED) -> dict[str, dict[str, int]]:
    """Return the stored counts; of a file with several lines the larger ones."""
    counts: dict[str, dict[str, int]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        name, *cells = line.split()
        row = counts.setdefault(name, {})
        for cell in cells:
            rule, count = cell.split("=")
            row[rule] = max(int(count), row.get(rule, 0))
    return counts


def write_counts(counts: Counts, path: Path = STORED) -> None:
    """Write one line for each file that has findings."""
    lines = [
        " ".join([name, *(f"{rule}={row[rule]}" for rule in sorted(row))])
        for name, row in sorted(counts.items())
        if row
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
