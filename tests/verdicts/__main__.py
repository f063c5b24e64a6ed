"""Print what contactlab says of models that nobody here wrote, beside what is true of them.

    python -m tests.verdicts [corpus|public|all] [--only PATTERN] [--held-back]

The first table has the failing models of the corpus and their healthy twins; the second the models
of public wheels under three drives. The same is written as JSON.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.verdicts.cases import CASES
from tests.verdicts.corpus import Case
from tests.verdicts.deserved import deserved
from tests.verdicts.held_back import HELD_BACK
from tests.verdicts.held_back_2 import HELD_BACK_2
from tests.verdicts.held_back_3 import HELD_BACK_3
from tests.verdicts.held_back_4 import HELD_BACK_4
from tests.verdicts.held_back_5 import HELD_BACK_5
from tests.verdicts.held_back_6 import HELD_BACK_6
from tests.verdicts.judge import NO_MODEL, Job, Verdict, judged
from tests.verdicts.public_models import DRIVES, public_models

# Whatever else would drive the models would make others of them than the truth is known of.
AS_IT_IS = "none"
_UNDECIDED = ("refused", "failed", "died", "too slow")


@dataclass(frozen=True)
class Row:
    """One line of a table: what was run, what contactlab says, and how that compares."""

    part: str
    kind: str
    name: str
    run: str
    outcome: str
    label: str
    reason: str
    seconds: float


def of_corpus(case: Case, verdict: Verdict, part: str, *, healthy: bool) -> Row:
    """Return the row of a failing model or of its twin."""
    if verdict.label in _UNDECIDED:
        outcome = "no verdict"
    elif healthy:
        outcome = "sound" if verdict.sound else "FALSE ALARM"
    else:
        outcome = "MISSED" if verdict.sound else "found"
    return _row(part, case.kind, case.name, "twin" if healthy else "failing", outcome, verdict)


def of_public(job: Job, drive: str, verdict: Verdict) -> Row:
    """Return the row of a public model under a drive."""
    why = deserved(job.name, verdict.label)
    if verdict.label in _UNDECIDED:
        outcome = "no verdict"
    elif verdict.sound:
        outcome = "sound"
    else:
        outcome = f"deserved: {why}" if why else "FALSE ALARM"
    return _row("public", job.name.partition("/")[0], job.name, drive, outcome, verdict)


def _row(part: str, kind: str, name: str, run: str, outcome: str, verdict: Verdict) -> Row:
    return Row(part, kind, name, run, outcome, verdict.label, verdict.reason, verdict.seconds)


def corpus_rows(options: argparse.Namespace, folder: Path) -> list[Row]:
    """Judge each failing model of the corpus, and each twin."""
    parts = {"open": CASES}
    if options.held_back:
        parts |= {
            "held back": HELD_BACK,
            "held back 2": HELD_BACK_2,
            "held back 3": HELD_BACK_3,
            "held back 4": HELD_BACK_4,
            "held back 5": HELD_BACK_5,
            "held back 6": HELD_BACK_6,
        }
    asked: dict[Path, tuple[Case, str, bool]] = {}
    for part, cases in parts.items():
        for case in cases if options.part in {"", part} else ():
            for healthy in (False, True) if case.failing else (True,):
                if options.only in case.name or options.only in case.kind:
                    path = folder / f"model_{len(asked)}.xml"
                    path.write_text(case.text(healthy=healthy), encoding="utf-8")
                    asked[path] = (case, part, healthy)
    jobs = [Job(case.name, path, case.duration, (AS_IT_IS,)) for path, (case, *_) in asked.items()]
    found = {job.path: verdicts[0] for job, verdicts in _judged(jobs, options)}
    return [
        of_corpus(case, found[path], part, healthy=healthy)
        for path, (case, part, healthy) in asked.items()
    ]


def public_rows(options: argparse.Namespace, folder: Path) -> list[Row]:
    """Judge each public model under each drive."""
    models = public_models(folder, options.only)
    jobs = [Job(model.name, model.path, 2.0, DRIVES) for model in models]
    rows = [
        of_public(job, drive, verdict)
        for job, verdicts in _judged(jobs, options)
        for drive, verdict in zip(DRIVES, verdicts, strict=True)
        if verdict.label != NO_MODEL
    ]
    return sorted(rows, key=lambda row: row.name)


def _judged(
    jobs: Sequence[Job], options: argparse.Namespace
) -> Iterable[tuple[Job, tuple[Verdict, ...]]]:
    for done, each in enumerate(judged(jobs, workers=options.jobs, seconds=options.seconds), 1):
        if sys.stderr.isatty():
            print(f"\r{done}/{len(jobs)}", end="\r", file=sys.stderr)
        yield each


def print_rows(title: str, rows: Sequence[Row]) -> None:
    """Print a table."""
    print(f"\n{title}\n")
    width = max((len(row.name) for row in rows), default=0)
    for row in rows:
        outcome, _, why = row.outcome.partition(": ")
        print(
            f"{row.kind:17} {row.name:{width}} {row.run:17} {outcome:11} {row.label:21} "
            f"{row.reason}{f' [{why}]' if why else ''}"
        )


def print_totals(rows: Sequence[Row]) -> None:
    """Print how many were found and flagged, of each kind in each part."""
    for part in dict.fromkeys(row.part for row in rows):
        print(f"\n{part}")
        own = [row for row in rows if row.part == part]
        for kind in (*dict.fromkeys(row.kind for row in own), "all"):
            some = [row for row in own if kind in {row.kind, "all"}]
            counts = Counter(row.outcome.partition(":")[0] for row in some)
            failing = [row for row in some if row.run == "failing"]
            found = f"found {counts['found']:3} of {len(failing):3}, " if failing else " " * 18
            print(
                f"  {kind:18} {found}false alarms {counts['FALSE ALARM']:3} of "
                f"{len(some) - len(failing):3}, deserved {counts['deserved']:3}, "
                f"no verdict {counts['no verdict']:3}"
            )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser("python -m tests.verdicts", description=__doc__)
    parser.add_argument("table", nargs="?", choices=["corpus", "public", "all"], default="all")
    parser.add_argument("--only", default="", metavar="PATTERN", help="names or kinds with this")
    parser.add_argument("--held-back", action="store_true", help="also what rules may not know")
    parser.add_argument("--part", default="", help="of the corpus, this part alone")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="models side by side")
    parser.add_argument("--seconds", type=float, default=600, help="time limit for each model")
    parser.add_argument("--json", type=Path, default=Path("results/verdicts.json"))
    options = parser.parse_args(arguments)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, judge_all in {"corpus": corpus_rows, "public": public_rows}.items():
            if options.table in {name, "all"}:
                some = judge_all(options, Path(folder))
                rows += some
                text = json.dumps([asdict(row) for row in rows], indent=1)
                options.json.write_text(text, encoding="utf-8")
                print_rows(f"{name}: what each run is labelled", some)
                print_totals(some)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
