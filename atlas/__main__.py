"""The command line of the atlas: `python -m atlas --help`."""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco

from atlas.comparing import differences
from atlas.confirming import confirmation, write_inputs
from atlas.entry import ROOT, Entry, entries, judge_digest, recorded
from atlas.examining import unexamined
from atlas.wheels import Robot, families

Family = tuple[Robot, ...]


def is_current(family: Family, entry: Entry | None) -> bool:
    """Return whether a family was examined as it is, by this judge and this MuJoCo."""
    now = (family[0].digest, judge_digest(), mujoco.__version__)
    return entry is not None and (entry.digest, entry.judge, entry.mujoco) == now


def to_examine(folder: Path, pattern: str) -> Iterator[Family]:
    """Yield the families that have no current record: first those that have none at all."""
    known = [(family, recorded(family[0].name)) for family in families(folder)]
    known = [(family, entry) for family, entry in known if pattern in family[0].name]
    yield from (family for family, entry in known if entry is None)
    yield from (family for family, entry in known if entry and not is_current(family, entry))


def run(folder: Path, pattern: str, most: int | None, seconds: int, jobs: int) -> None:
    """Examine what has no current record, each family in a process of its own; confirm causes."""
    for entry in entries():
        if entry.flagged and entry.confirmation is None and pattern in entry.name:
            _confirmed(folder, entry)
    wanted = [*to_examine(folder, pattern)][:most]
    with ThreadPoolExecutor(jobs) as pool:
        for entry in pool.map(lambda family: _examined(folder, family, seconds), wanted):
            said = entry.refused or (entry.examination.sentence if entry.examination else "")
            print(f"{entry.cpu or 0:6.1f} s  {entry.word:12} {entry.name}: {said}", flush=True)


def _examined(folder: Path, family: Family, seconds: int) -> Entry:
    names = [robot.name for robot in family]
    asked = [sys.executable, "-m", "atlas.examining", str(folder), str(seconds)]
    done = subprocess.run([*asked, *names], capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [""])[-1]
        reason = (
            f"no answer within {seconds} s of CPU" if done.returncode < 0 else f"crashed: {last}"
        )
        unexamined(family, reason).save()
    entry = recorded(names[0])
    assert entry is not None
    return _confirmed(folder, entry) if entry.flagged else entry


def _confirmed(folder: Path, entry: Entry) -> Entry:
    entry = entry.model_copy(update={"confirmation": confirmation(entry, folder)})
    entry.save()
    return entry


def compare(before: Path, changelog: Path) -> bool:
    """Print which verdicts are others than before; return whether the changelog names them all.

    What counts is its first section, of the release to come.
    """
    told = changelog.read_text(encoding="utf-8").split("\n## ")[1]
    others = list(differences(entries(before), entries()))
    for each in others:
        print(f"{'told' if each.name in told else 'UNTOLD':7} {each}")
    untold = [each.name for each in others if each.name not in told]
    if untold:
        print(f"{changelog} says nothing of {len(untold)} verdicts that changed; name each there")
    return not untold


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(prog="python -m atlas", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    asks = verbs.add_parser("run", help="examine what has no current record")
    asks.add_argument("wheels", type=Path, help="folder of unpacked wheels, a folder each")
    asks.add_argument("--only", default="", metavar="TEXT", help="families whose name has it")
    asks.add_argument("--most", type=int, help="how many are examined at most")
    asks.add_argument("--seconds", type=int, default=300, help="of CPU for each, all included")
    asks.add_argument("--jobs", type=int, default=1, help="how many at once")
    compares = verbs.add_parser("compare", help="say which verdicts changed, and fail if untold")
    compares.add_argument("before", type=Path, help="folder of the records of another release")
    compares.add_argument("--changelog", type=Path, default=ROOT / "CHANGELOG.md")
    writes = verbs.add_parser("inputs", help="write the controls of a model's task, for confirm.py")
    writes.add_argument("model", type=Path)
    writes.add_argument("file", type=Path, help="FILE.npz")
    writes.add_argument("--seed", type=int, default=0, help="place among those of the task")
    asked = parser.parse_args()
    if asked.verb == "inputs":
        write_inputs(asked.model, asked.file, asked.seed)
    elif asked.verb == "run":
        run(asked.wheels, asked.only, asked.most, asked.seconds, asked.jobs)
    elif not compare(asked.before, asked.changelog):
        sys.exit(1)


if __name__ == "__main__":
    main()
