"""The command of the prose check: compares, lowers and lists counts, and prints the rates."""

import argparse
import re
import subprocess
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.prose.counts import (
    ROOT,
    STORED,
    Rise,
    RisenError,
    count_findings,
    find_all,
    find_rises,
    lowered_counts,
    read_counts,
    total_counts,
    write_counts,
)
from tests.prose.rates import measure_rates
from tests.prose.rules import Finding, advice_on, find_problems
from tests.prose.texts import read_file

_DESCRIPTION = "Check prose and names against the style guide. Fails if a stored count rises."
# Sentences shown for one rule of one file, if the change itself does not say which is new.
_MOST_SHOWN = 10


def run_check(arguments: Sequence[str], root: Path = ROOT, stored_in: Path = STORED) -> int:
    """Run the command in a checkout; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.prose", description=_DESCRIPTION)
    parser.add_argument("files", nargs="*", type=Path, help="only list all findings of these files")
    parser.add_argument("--lower", action="store_true", help="store the counts, if none rose")
    parser.add_argument(
        "--moved", action="store_true", help="store them, if no sum rose: text moved between files"
    )
    parser.add_argument("--rates", action="store_true", help="print the rates over cli/")
    options = parser.parse_args(arguments)
    if options.files:
        for path in options.files:
            _print_findings(path.as_posix(), find_problems(read_file(path), path))
        print("Old lapses are listed, too; without FILES, only files with more than their count.")
        return 0
    if options.rates:
        _print_rates(root)
        return 0
    findings = find_all(root)
    counts, stored = count_findings(findings), read_counts(stored_in)
    rises = find_rises(counts, stored)
    if options.moved or (options.lower and not rises):
        try:
            write_counts(lowered_counts(counts, stored, moved=options.moved), stored_in)
        except RisenError as error:
            print(f"not stored, since these sums rose: {error}")
            return 1
        return 0
    _print_rises(rises, findings, root)
    return 1 if rises else 0


def _print_rises(rises: Sequence[Rise], findings: Mapping[str, list[Finding]], root: Path) -> None:
    changed = find_changed_lines(root) if rises else {}
    for rise in rises:
        print(f"{rise.path}: {rise.rule}: {rise.count} places, {rise.allowed} are allowed")
        rows = [finding for finding in findings[rise.path] if finding.rule == rise.rule]
        new = [row for row in rows if row.line in changed.get(rise.path, set())] or rows
        _print_findings(rise.path, new[:_MOST_SHOWN])
        if len(new) > _MOST_SHOWN:
            print(f"  and {len(new) - _MOST_SHOWN} more: python -m tests.prose {rise.path}")
    if rises:
        print("If text only moved here from another file: python -m tests.prose --moved")


def _print_findings(path: str, findings: list[Finding]) -> None:
    for finding in findings:
        print(f"{path}:{finding.line}: {finding.rule} '{finding.words}': {finding.text}")
        print(f"    {advice_on(finding)}")


def _print_rates(root: Path) -> None:
    for name, value in measure_rates(root).items():
        print(f"{name:<62}{value:>9.2f}" if isinstance(value, float) else f"{name:<62}{value:>9}")
    print("\nfindings in all checked files")
    for rule, count in sorted(total_counts(count_findings(find_all(root))).items()):
        print(f"  {rule:<60}{count:>9}")


def find_changed_lines(root: Path) -> dict[str, set[int]]:
    """Return the lines that differ from the last commit, per tracked file; none without git."""
    command = ["git", "-C", str(root), "diff", "-U0", "--no-ext-diff", "--no-textconv", "HEAD"]
    try:
        diff = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return {}
    lines: dict[str, set[int]] = defaultdict(set)
    path = ""
    for line in diff.splitlines():
        if line.startswith("+++ b/"):
            path = line.removeprefix("+++ b/")
        elif match := re.match(r"@@ -\S+ \+(\d+)(?:,(\d+))? @@", line):
            first, count = int(match[1]), int(match[2] or 1)
            lines[path].update(range(first, first + count))
    return lines
