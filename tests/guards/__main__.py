"""Records guards, or compares with what they recorded.

`python -m tests.guards [--slow] [--compare] [KIND...]`, or `make guards`: of all kinds if none is
named; of the slow ones if they are named or with `--slow`. `--compare` says what changed in words,
records nothing, and fails if anything did.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from tests.guards.comparing import compare, joined, summary
from tests.guards.guards import Guard, UnavailableError, guards_of
from tests.guards.records import Record


def main(words: Sequence[str]) -> int:
    """Run the command, and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.guards", description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND")
    parser.add_argument("--slow", action="store_true", help="also those whose tests run at night")
    parser.add_argument("--compare", action="store_true", help="say what changed; record nothing")
    given = parser.parse_args(words)
    try:
        guards = guards_of(given.kinds, slow=given.slow)
    except ValueError as error:
        parser.error(str(error))
    changed = False
    for kind, several in groupby(guards, key=lambda guard: guard.kind):
        pairs = [pair for guard in several if (pair := _made(guard, write=not given.compare))]
        before, after = (joined(pair[side] for pair in pairs) for side in (0, 1))
        text = summary(kind, compare(before, after))
        print(text or f"{kind}: unchanged")
        changed |= bool(text)
    return int(changed and given.compare)


def _made(guard: Guard, *, write: bool) -> tuple[Record, Record] | None:
    """Return the stored record of a guard and the one that is made now; None if there is none."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            before, after = guard.read(), guard.record(Path(folder))
        except UnavailableError as error:
            print(f"{guard.key}: not made: {error}", file=sys.stderr)
            return None
    if write:
        guard.write(after)
    elif before.versions != after.versions:
        print(f"{guard.key}: recorded with {before.versions}, made with {after.versions}")
    return before, after


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
