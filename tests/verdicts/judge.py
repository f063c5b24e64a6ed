"""What contactlab says of a model: the label of a sweep of one run, in a process of its own."""

import os
import tempfile
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing import connection, get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from tests.verdicts.public_models import moves

import contactlab
from contactlab.errors import ContactlabError

SOUND = "stable"
NO_MODEL = "no model"
_CONTEXT = get_context("forkserver")


@dataclass(frozen=True)
class Verdict:
    """A label, and why; what is no run has a word of its own: refused, failed, died, too slow."""

    label: str
    reason: str
    seconds: float = 0.0

    @property
    def sound(self) -> bool:
        return self.label == SOUND


@dataclass(frozen=True)
class Job:
    """A model to judge under each of some drives."""

    name: str
    path: Path
    duration: float
    drives: tuple[str, ...]


@dataclass
class _Trial:
    job: Job
    process: BaseProcess
    deadline: float
    verdicts: list[Verdict] = field(default_factory=list)

    def finish(self, label: str, reason: str) -> tuple[Job, tuple[Verdict, ...]]:
        """Return the verdicts, with what ended the process for those that it never reached."""
        missing = len(self.job.drives) - len(self.verdicts)
        return self.job, (*self.verdicts, *[Verdict(label, reason)] * missing)


def judge(path: Path, duration: float, drive: str) -> Verdict:
    """Return what one run of a model is labelled."""
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


def judged(
    jobs: Iterable[Job], *, workers: int, seconds: float
) -> Iterator[tuple[Job, tuple[Verdict, ...]]]:
    """Judge models side by side, each within a time; yield them as they are done."""
    _CONTEXT.set_forkserver_preload(["tests.verdicts.judge", "contactlab.api.running_functions"])
    waiting, running = deque(jobs), dict[Connection, _Trial]()
    while waiting or running:
        while waiting and len(running) < workers:
            receiver, trial = _start(waiting.popleft(), seconds)
            running[receiver] = trial
        patience = min(trial.deadline for trial in running.values()) - time.monotonic()
        for receiver in connection.wait(list(running), max(patience, 0.0)):
            assert isinstance(receiver, Connection)
            try:
                running[receiver].verdicts.append(receiver.recv())
            except EOFError:
                trial = running.pop(receiver)
                trial.process.join()
                yield trial.finish("died", f"exit code {trial.process.exitcode}")
        for receiver, trial in list(running.items()):
            if time.monotonic() > trial.deadline:
                del running[receiver]
                trial.process.kill()
                yield trial.finish("too slow", f"no verdict within {seconds:g} s for the model")


def _start(job: Job, seconds: float) -> tuple[Connection, _Trial]:
    receiver, sender = _CONTEXT.Pipe(duplex=False)
    process = _CONTEXT.Process(target=_tell, args=(job, sender), daemon=True)
    process.start()
    sender.close()
    return receiver, _Trial(job, process, time.monotonic() + seconds)


def _tell(job: Job, sender: Connection) -> None:
    with tempfile.TemporaryDirectory() as folder, Path(os.devnull).open("w") as nothing:
        os.chdir(folder)  # The engine writes its warnings into a file there.
        for stream in (1, 2):
            os.dup2(nothing.fileno(), stream)
        for drive in job.drives:
            if moves(job.path):
                sender.send(judge(job.path, job.duration, drive))
            else:
                sender.send(Verdict(NO_MODEL, "part of others, or nothing in it can move"))
