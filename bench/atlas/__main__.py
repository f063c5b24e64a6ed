"""The command line of the atlas: `python -m bench.atlas --help`."""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
from bench.atlas.comparing import differences
from bench.atlas.confirming import asked_again, write_inputs
from bench.atlas.confirming import nearer as nearer_of
from bench.atlas.entry import RECORDS, ROOT, Entry, judge_digest, read_all, recorded, records_of
from bench.atlas.examining import unexamined
from bench.atlas.mending import judged_again
from bench.atlas.views import apart, contradictions, of_report, of_views
from bench.atlas.wheels import Robot, families

Family = tuple[Robot, ...]


def is_current(family: Family, entry: Entry | None) -> bool:
    """Return whether a family was examined as it is, by this judge and this MuJoCo."""
    now = (family[0].digest, judge_digest(), mujoco.__version__)
    return entry is not None and (entry.digest, entry.judge, entry.mujoco) == now


def to_examine(wanted: Sequence[Family], records: Path) -> Iterator[Family]:
    """Yield the families that have no current record: first those that have none at all."""
    known = [(family, recorded(family[0].name, records)) for family in wanted]
    yield from (family for family, entry in known if entry is None)
    yield from (family for family, entry in known if entry and not is_current(family, entry))


def named(folder: Path, patterns: Sequence[str]) -> list[Family]:
    """Return the families whose names have one of some texts; all if there are none."""
    found = families(folder)
    return [one for one in found if not patterns or any(text in one[0].name for text in patterns)]


def run(asked: argparse.Namespace) -> None:
    """Examine what has no current record, each family in a process of its own."""
    kind, wanted = "verdict" if asked.verdict else "whole", named(asked.wheels, asked.only)
    if asked.verdict:
        wanted = [one for one in wanted if (entry := recorded(one[0].name)) and entry.examination]
    wanted = [*(wanted if asked.again else to_examine(wanted, records_of(kind)))][: asked.most]
    with ThreadPoolExecutor(asked.jobs) as pool:
        work = partial(_examined, asked.wheels, kind, asked.seconds)
        for entry in pool.map(work, wanted):
            said = entry.refused or (entry.examination.headline if entry.examination else "")
            print(f"{entry.cpu or 0:6.1f} s  {entry.word:12} {entry.name}: {said}", flush=True)


def current(
    asked: argparse.Namespace, wanted: Callable[[Entry], object]
) -> Iterator[tuple[Entry, Path, Path]]:
    """Yield current records that are wanted, the cheapest first, their files, and a folder each."""
    known = ((family, recorded(family[0].name)) for family in named(asked.wheels, asked.only))
    entries = [one for family, one in known if one and is_current(family, one) and wanted(one)]
    for entry in sorted(entries, key=lambda entry: entry.cpu or 0.0)[: asked.most]:
        with TemporaryDirectory(prefix="atlas-") as folder:
            yield entry, asked.wheels / entry.name, Path(folder)


def tune(asked: argparse.Namespace) -> None:
    """Add what tune recommends to current records of sound models that have it not."""
    for entry, _, _ in current(asked, lambda entry: entry.passed and entry.tuned is None):
        done = _process(asked.wheels, "tuned", asked.seconds, entry.family)
        again = recorded(entry.family[0])
        said = again.tuned.sentence if again and again.tuned else _last_line(done)
        print(f"{entry.name}: {said}", flush=True)


def confirm(asked: argparse.Namespace) -> bool:
    """Ask plain MuJoCo again for causes of current records; return whether it shows them all."""
    whole = True
    for entry, file, folder in current(asked, lambda entry: entry.flagged):
        again = asked_again(entry, file, folder)
        again.save(RECORDS)
        shown = again.confirmation
        holds = shown is not None and shown.holds
        whole &= holds
        text = shown.shown if shown else "there is no question for what it names"
        print(f"{'shown' if holds else 'NOT shown':9} {entry.name}: {text}", flush=True)
    return whole


def views(asked: argparse.Namespace) -> bool:
    """Ask each view of models for what current records say; return whether none contradicts."""
    whole = True
    for entry, file, folder in current(asked, lambda entry: entry.examination):
        report = entry.examination
        assert report is not None
        said = list(contradictions(report))
        for view, answer in of_views(str(file), report.task, folder):
            said += [f"{view}: {other}" for other in apart(of_report(report), answer)]
        whole &= not said
        print(f"{'; '.join(said) or 'one answer'}: {entry.name}", flush=True)
    return whole


def mended(asked: argparse.Namespace) -> bool:
    """Judge models with the fixes of current records again; return whether all pass."""
    whole = True
    for entry, file, folder in current(asked, lambda entry: entry.working_fix):
        passed, text = judged_again(entry, file, folder)
        whole &= passed
        print(f"{'passes' if passed else 'FAILS':9} {entry.name}: {text}", flush=True)
    return whole


def nearer(asked: argparse.Namespace) -> bool:
    """Print whether changes come nearer to what is meant, in plain MuJoCo; return whether all."""
    whole = True
    for entry, file, folder in current(asked, lambda entry: entry.fixed):
        for name, near, text in nearer_of(entry, file, folder):
            whole &= near
            word = "nearer" if near else "NOT nearer"
            print(f"{word:10} {entry.name}, {name}: {text}", flush=True)
    return whole


def _process(
    folder: Path, kind: str, seconds: int, names: Sequence[str]
) -> subprocess.CompletedProcess[str]:
    asked = [sys.executable, "-m", "bench.atlas.examining", kind, str(folder), str(seconds)]
    drawn = {"MUJOCO_GL": "egl", **os.environ}
    return subprocess.run([*asked, *names], capture_output=True, text=True, check=False, env=drawn)


def _last_line(done: subprocess.CompletedProcess[str]) -> str:
    return (done.stderr.strip().splitlines() or [""])[-1]


def _examined(folder: Path, kind: str, seconds: int, family: Family) -> Entry:
    done = _process(folder, kind, seconds, [robot.name for robot in family])
    if done.returncode:
        slow = f"no answer within {seconds} s of CPU"
        reason = slow if done.returncode < 0 else f"crashed: {_last_line(done)}"
        unexamined(family, reason).save(records_of(kind))
    entry = recorded(family[0].name, records_of(kind))
    assert entry is not None
    return entry


def compare(before: Path, changelog: Path) -> bool:
    """Print the verdicts that changed; return whether the changelog names the model of each.

    Fragments of changes since the last release count, and the newest section, which they become.
    """
    news = _read_news(changelog)
    changed = list(differences(read_all(before), read_all(RECORDS)))
    for each in changed:
        print(f"{'named' if each.name in news else 'UNNAMED':8} {each}")
    unnamed = [each.name for each in changed if each.name not in news]
    if unnamed:
        print(f"{len(unnamed)} verdicts changed without a fragment; name each in changelog.d")
    return not unnamed


def _read_news(changelog: Path) -> str:
    _, newest, *_ = [*changelog.read_text(encoding="utf-8").split("\n## "), ""]
    fragments = sorted((changelog.parent / "changelog.d").glob("*.*.md"))
    return "\n".join([newest, *(each.read_text(encoding="utf-8") for each in fragments)])


_OF_CURRENT = {
    "confirm": (confirm, "ask plain MuJoCo again for the causes that current records name"),
    "mended": (mended, "judge models with their working fixes on unused seeds"),
    "nearer": (nearer, "ask plain MuJoCo whether changes of current records come nearer"),
    "views": (views, "ask stability, check and sweep for what they say, the cheapest first"),
}


def _name_families(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("wheels", type=Path, help="folder of unpacked wheels, a folder each")
    verb.add_argument("--only", default=[], nargs="*", metavar="TEXT", help="part of a name")
    verb.add_argument("--most", type=int, help="how many at most")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench.atlas", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    asks = verbs.add_parser("run", help="examine what has no current record")
    asks.add_argument(
        "--verdict", action="store_true", help="verdicts alone, of this release of MuJoCo"
    )
    asks.add_argument("--again", action="store_true", help="also what has a current record")
    tunes = verbs.add_parser("tune", help="add what tune recommends to records of sound models")
    for each, seconds in ((asks, 600), (tunes, 90)):
        _name_families(each)
        each.add_argument("--seconds", type=int, default=seconds, help="of CPU for each")
    for verb, (_, does) in _OF_CURRENT.items():
        _name_families(verbs.add_parser(verb, help=does))
    asks.add_argument("--jobs", type=int, default=1, help="how many at once")
    compares = verbs.add_parser("compare", help="say which verdicts changed, and fail if untold")
    compares.add_argument("before", type=Path, help="folder of the records of another release")
    compares.add_argument("--changelog", type=Path, default=ROOT / "CHANGELOG.md")
    writes = verbs.add_parser("inputs", help="write the controls of a model's task, for confirm.py")
    writes.add_argument("model", type=Path)
    writes.add_argument("file", type=Path, help="FILE.npz")
    writes.add_argument("--seed", type=int, default=0, help="place among those of the task")
    return parser


def main() -> None:
    """Run what is asked for."""
    asked = _parser().parse_args()
    if asked.verb == "inputs":
        write_inputs(asked.model, asked.file, asked.seed)
    elif asked.verb == "run":
        run(asked)
    elif asked.verb == "tune":
        tune(asked)
    elif asked.verb in _OF_CURRENT:
        ask, _ = _OF_CURRENT[asked.verb]
        sys.exit(not ask(asked))
    elif not compare(asked.before, asked.changelog):
        sys.exit(1)


if __name__ == "__main__":
    main()
