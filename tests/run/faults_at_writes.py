"""Lives of a store with a fault at each of its writes, a process a fault; prints what came of them.

Run: python -m tests.run.faults_at_writes LIFE STRIDE folder|s3://BUCKET, where `failing_calls.c` is
preloaded. A point is a call that changes what is stored: of a folder one of the system's calls, as
`failing_calls.c` has them, of a bucket a request to put, create or delete an object. Every so
many-th point is tried in every manner:

- error: the call fails once and does nothing; a request was done, but its answer is lost
- refused: a request fails once, and was not done
- full: from then on no file grows, after half of a write
- kill: the process dies, after half of a write; or after a request

After each the same command goes on, in a process of its own. A store then is sound, has the physics
of one whose life had no fault, and no run was made again that had been finished before.
"""

import ctypes
import itertools
import json
import os
import shutil
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Protocol

import contactlab
from contactlab.errors import ContactlabError, OutputError
from contactlab.store.finished_store import Store
from contactlab.store.objects.client import ObjectClient
from contactlab.store.row_journal import read_lines
from contactlab.store.store_files import JOURNAL, parse_address
from contactlab.store.verify_store import find_problems, write_baseline

SWEEP: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.005,
    "checks": "none",
    "axes": {"timestep": [1e-3, 2e-3]},
}
CALLS = ("open", "write", "sync", "rename", "remove", "make", "close", "truncate")
MANNERS = ("count", "error", "full", "kill")
GROWS = {"open", "write", "make"}
REQUESTS = ("put_file", "create_object", "delete_files")


class Life(NamedTuple):
    """What is done to a store, and how the same is gone on with; both are given its place."""

    live: Callable[[str], object]
    resume: Callable[[str], object]
    prepare: Callable[[str], object] = lambda _: None
    at: str = ""


GRADED = {**SWEEP, "accuracy": {}}


def sweep(place: str, **options: Any) -> Store:
    return contactlab.sweep(SWEEP, output=place, workers=0, **options)


def grow(place: str) -> None:
    """Make a shard, and fill it up, which opens a finished store again."""
    sweep(place, shard="1/2")
    sweep(place)


def grade(place: str) -> None:
    """Sweep, and compare runs with references, which leaves notes on the way."""
    contactlab.sweep(GRADED, output=place, workers=0)


def tear(place: str) -> None:
    """Leave a sweep as one that died in the middle of a row, and whose first trace was lost."""
    sweep(place, shard="1/2")
    store = Path(place)
    rows = Store.open(store).table.drop_columns([]).to_pylist()
    (store / "manifest.json").unlink()
    text = json.dumps(rows[0], default=str).encode()
    (store / JOURNAL).write_bytes(text[: len(text) // 2])


def damage(place: str) -> None:
    """Leave a finished store that has lost a trace."""
    sweep(place)
    next(Path(place).rglob("*.mcap")).unlink()


def repair(place: str) -> None:
    sweep(place, repair=True)


def shards_of(place: str) -> list[str]:
    return [f"{place}parts/{number}" for number in (1, 2)]


def make_shards(place: str) -> None:
    for number, part in enumerate(shards_of(place), 1):
        sweep(part, shard=f"{number}/2")


def merge(place: str) -> None:
    contactlab.sweep(shards_of(place), merge=True, output=f"{place}whole")


def merge_again(place: str) -> None:
    """Merge, unless the merge that was killed had come to its very end."""
    whole = f"{place}whole"
    if not is_finished(whole) or any(
        "left over" in problem for problem in find_problems(parse_address(whole))
    ):
        merge(place)


def is_finished(place: str) -> bool:
    try:
        Store.open(parse_address(place))
    except ContactlabError:
        return False
    return True


def make_baseline(place: str) -> None:
    sweep(f"{place}source")
    write_baseline(Path(f"{place}source"), Path(f"{place}kept/ball"))


def keep(place: str) -> None:
    write_baseline(Path(f"{place}source"), Path(f"{place}kept/ball"))


LIVES = {
    "sweep": Life(grow, sweep),
    "graded": Life(grade, grade),
    "torn": Life(sweep, sweep, tear),
    "repaired": Life(repair, repair, damage),
    "merge": Life(merge, merge_again, make_shards, "whole"),
    "baseline": Life(keep, keep, make_baseline, "kept/ball"),
}


class Points(Protocol):
    """Calls of a life, of which one can fail."""

    @property
    def manners(self) -> tuple[str, ...]:
        """How a call can fail."""
        ...

    def watch(self, place: str, point: int = -1, manner: str = "count") -> None:
        """Count what is done at a place; fail at a point."""
        ...

    def seen(self) -> list[str]:
        """Return the names of the calls that were made."""
        ...


class CallPoints:
    """The system's calls, of the preloaded library."""

    manners = MANNERS[1:]

    def __init__(self) -> None:
        self._library = ctypes.CDLL(None)

    def watch(self, place: str, point: int = -1, manner: str = "count") -> None:
        self._library.watch(os.fsencode(place), point, MANNERS.index(manner))

    def seen(self) -> list[str]:
        return [CALLS[self._library.call_at(at)] for at in range(self._library.points())]


@dataclass
class RequestPoints:
    """Requests of object storage."""

    manners: tuple[str, ...] = ("error", "refused", "kill")
    _made: list[str] = field(default_factory=list[str])
    _due: tuple[str, int, str] = ("\n", -1, "")

    def __post_init__(self) -> None:
        for name in REQUESTS:
            setattr(ObjectClient, name, self._watched(name, getattr(ObjectClient, name)))

    def watch(self, place: str, point: int = -1, manner: str = "count") -> None:
        self._made.clear()
        self._due = place, point, manner

    def seen(self) -> list[str]:
        return self._made.copy()

    def _watched(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def request(client: ObjectClient, *given: Any) -> Any:
            place, point, manner = self._due
            if place not in f"{client.address}/":
                return call(client, *given)
            self._made.append(name)
            due = len(self._made) - 1 == point
            if due and manner == "refused":
                raise OutputError(f"cannot use {client.address}: refused for a test")
            answer = call(client, *given)
            if due and manner == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            if due and manner == "error":
                raise OutputError(f"cannot reach {client.address}: no answer, for a test")
            return answer

        return request


def in_child(act: Callable[[], object]) -> tuple[str, Any]:
    """Do an act in a process of its own; return how it ended, and what it gave.

    It is done, refused in words, killed, or came to an end that nobody meant it to have.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            said: tuple[str, Any] = "done", act()
        except ContactlabError as error:
            said = "refused", str(error)
        except BaseException:  # noqa: BLE001 - it is told
            said = "fell", traceback.format_exc()
        with os.fdopen(writing, "w") as answer:
            json.dump(said, answer)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as answer:
        text = answer.read()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return "killed", os.WTERMSIG(status)
    return tuple(json.loads(text)) if text else ("fell", f"exit {status}")


def finished_runs(place: str) -> dict[str, int]:
    """Return the traces of runs that are finished, and the files that hold them."""
    store = Path(place)
    try:
        named = Store.open(store).table["trace_file"].to_pylist()
    except ContactlabError:
        named = [row.get("trace_file") for row in read_lines(store / JOURNAL)]
    there = [store / name for name in named if name and (store / name).is_file()]
    return {path.name: path.stat().st_ino for path in there}


def looked_at(place: str) -> dict[str, Any]:
    """Return what a store is: its defects, its physics, and the files of its runs."""
    address = parse_address(place)
    files = finished_runs(place) if isinstance(address, Path) else {}
    store = Store.open(address)
    return {"problems": find_problems(store.address), "physics": store.physics, "files": files}


class Fault(NamedTuple):
    """How a life is to fail, at which of its calls."""

    call: str
    manner: str
    point: int


def faults_of(made: list[str], points: Points, stride: int) -> Iterator[Fault]:
    """Yield the faults that are tried of a life with these calls."""
    for manner in points.manners:
        for point in range(stride // 2, len(made), stride):
            if manner != "full" or made[point] in GROWS:
                yield Fault(made[point], manner, point)


def undisturbed(life: Life, points: Points, place: str) -> list[Any]:
    """Return the calls of a life without a fault, and the physics of what it leaves."""
    life.prepare(place)
    points.watch(place)
    life.live(place)
    made = points.seen()
    points.watch("\n")
    return [made, looked_at(place + life.at)["physics"]]


def come_of(life: Life, points: Points, place: str, fault: Fault, physics: str) -> dict[str, Any]:
    """Return what comes of a life with a fault that is then gone on with."""

    def fail() -> None:
        points.watch(place, fault.point, fault.manner)
        life.live(place)

    def go_on() -> dict[str, Any]:
        before = {} if life.at else finished_runs(place)
        life.resume(place)
        return looked_at(place + life.at) | {"before": before}

    ready, why = in_child(lambda: life.prepare(place))
    assert ready == "done", why
    ended, why = in_child(fail)
    after, found = in_child(go_on)
    if ended == "fell" or after != "done":
        wrong = [str(why if ended == "fell" else found)]
    else:
        again = {*found["before"].items()} - {*found["files"].items()}
        other = ["other physics"] if found["physics"] != physics else []
        wrong = [*found["problems"], *other, *(f"{name} was made again" for name, _ in again)]
    return fault._asdict() | {"ended": ended, "wrong": wrong}


def tried(
    life: Life, points: Points, places: Iterator[str], stride: int
) -> Iterator[dict[str, Any]]:
    """Fail at points of a life, go on, and yield what came of each."""
    whole = next(places)
    # What a process does but once, as checks of functions in C, is done before it is copied; in a
    # folder, since a client of a bucket has threads, which are not copied.
    with TemporaryDirectory() as here:
        grow(f"{here}/first")
        looked_at(f"{here}/first")
    how, found = in_child(lambda: undisturbed(life, points, whole))
    assert how == "done", found
    made, physics = found
    for fault in faults_of(made, points, stride):
        yield come_of(life, points, place := next(places), fault, physics)
        if "://" not in place:
            for left in Path(place).parent.glob(Path(place).name + "*"):
                shutil.rmtree(left)


def main() -> None:
    """Print each fault as a line of JSON, and a table of them to stderr."""
    name, stride, where = sys.argv[1:]
    points = RequestPoints() if "://" in where else CallPoints()
    places = (f"{where}/{name}-{number}-" for number in itertools.count())
    held, made = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for fault in tried(LIVES[name], points, places, int(stride)):
        sys.stdout.write(json.dumps(fault) + "\n")
        sys.stdout.flush()
        made[fault["call"], fault["manner"]] += 1
        held[fault["call"], fault["manner"]] += not fault["wrong"]
    for (call, manner), count in sorted(made.items()):
        sys.stderr.write(f"{call:9} {manner:8} {count:4} faults, {held[call, manner]:4} held\n")


if __name__ == "__main__":
    main()
