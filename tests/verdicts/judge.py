"""What contactlab says of a model: the label of a sweep of one run, in a process of its own."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tests.verdicts.public_models import moves

import contactlab
from contactlab.errors import ContactlabError

SOUND = "stable"
NO_MODEL = "no model"
_ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Verdict:
    """A label, and why; what is no run has a word of its own: refused, failed, died, too slow."""

    label: str
    reason: str
    seconds: float = 0.0


@dataclass(frozen=True)
class Job:
    """A model to judge under a drive."""

    name: str
    path: Path
    duration: float
    drive: str


def judge(path: Path, duration: float, drive: str) -> Verdict:
    """Return what one run of a model is labelled."""
    if not moves(path):
        return Verdict(NO_MODEL, "part of others, or nothing in it can move")
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        try:
            store = contactlab.sweep(
                {"version": 1, "scene": str(path), "duration": duration, "trace": "none"},
                output=Path(folder) / "store",
                drive=drive,
                workers=0,
            )
            label, reason = (store.table[column][0].as_py() for column in ("label", "label_reason"))
        except ContactlabError as error:
            label, reason = "refused", str(error)
        except Exception as error:  # noqa: BLE001 A table of verdicts has a row for this too.
            label, reason = "failed", f"{type(error).__name__}: {error}"
    return Verdict(label, " ".join(reason.split()), time.perf_counter() - started)


def judged(jobs: Iterable[Job], *, workers: int, seconds: float) -> Iterator[tuple[Job, Verdict]]:
    """Judge models side by side, each within a time; yield them as they are done."""
    with ThreadPoolExecutor(workers) as pool:
        trials = {pool.submit(_tried, job, seconds): job for job in jobs}
        for trial in as_completed(trials):
            yield trials[trial], trial.result()


def _tried(job: Job, seconds: float) -> Verdict:
    asked = ["tests.verdicts.judge", str(job.path), str(job.duration), job.drive]
    said = said_in_its_own_process(asked, seconds)
    return Verdict(*said) if isinstance(said, tuple) else Verdict(**said)


def said_in_its_own_process(
    module: Sequence[str], seconds: float
) -> dict[str, Any] | tuple[str, str]:
    """Return what a module with its arguments prints last, as JSON; else a word, and why."""
    # The engine writes its warnings into a file of the current folder.
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                [sys.executable, "-m", *module],
                cwd=folder,
                env=os.environ | {"PYTHONPATH": str(_ROOT)},
                capture_output=True,
                timeout=seconds,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return "too slow", f"no verdict within {seconds:g} s for the model"
    if done.returncode:
        return "died", f"exit code {done.returncode}"
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    sys.stdout.write(json.dumps(asdict(judge(Path(sys.argv[1]), float(sys.argv[2]), sys.argv[3]))))
