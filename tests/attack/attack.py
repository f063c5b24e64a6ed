"""Bend a store in thousands of ways, and count which of them `contactlab verify` finds.

    python -m tests.attack.attack --count 2030 --seed 1

A change is detected if `verify` names it, or refuses the store: by what needs no engine, by making
the plan again, or by `--simulate` of all runs; harmless if all that the store says is as before.
Some changes leave out what `verify` then says it could not verify. Of the rest, those of the
manifest are found by whoever pins its digest; what is left is undetected.
"""

import argparse
import json
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Generator
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any
from unittest.mock import patch

from tests.attack.mutations import MANIFEST, Mutation, Target, mutations, redo, reseal

from contactlab.errors import ContactlabError
from contactlab.parts import register_parts
from contactlab.run import planned_runs
from contactlab.run.recomputed_runs import (
    recomputed_problems,
    simulate_again,
    why_ids_unverifiable,
    why_plan_unverifiable,
)
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import ProgressCallback
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems, unverifiable_parts, write_baseline

register_parts()
MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body pos="0 0 {height}"><freejoint/><geom name="ball" size="0.1" mass="1"/></body>
    <body pos="0 1 1">
      <joint name="rail" type="slide" axis="1 0 0"/><geom name="cart" size="0.1" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="rail" ctrlrange="-50 50"/></actuator>
</mujoco>
"""
SWEEP = """
version: 1
scene: ./model.xml
duration: 0.02
seeds: 2
trace: all
drive: {drive}
axes: {{timestep: [1.0e-3, 2.0e-3]}}
"""
CONTROLS = "time,push\n0,1\n0.01,-1\n0.02,0.5\n"
POLICY = """
class Push:
    def __init__(self, model):
        self.actuators = model.nu

    def __call__(self, time, qpos, qvel, sensordata):
        return 1.0 - 10.0 * qpos[:, -1:]
"""
DRIVES = {"plain": "hold", "file": "{file: controls.csv}", "policy": '{policy: "push.py:Push"}'}
_SECONDS = 60
_BYTES = 6 << 30
OUTCOMES = (
    "detected",
    "harmless",
    "detected by resolving the plan",
    "detected by simulating again",
    "not verified, as verify says",
    "found by a pinned digest only",
    "undetected",
)


def request_in(folder: Path, height: float = 0.12, drive: str = "plain") -> SweepRequest:
    """Return a sweep of four runs with traces, whose store is `store` in a folder."""
    folder.mkdir(exist_ok=True)
    (folder / "model.xml").write_text(MODEL.format(height=height))
    (folder / "controls.csv").write_text(CONTROLS)
    (folder / "push.py").write_text(POLICY)
    text = SWEEP.format(drive=DRIVES[drive])
    ask = read_request(text, "small", folder / "store", folder=folder, workers=0)
    return replace(ask, allow_code=True)


def resume(request: SweepRequest, progress: ProgressCallback = lambda _: None) -> None:
    """Run what is left of a sweep."""
    run_sweep(request, lambda *_: None, progress)


def make_store(folder: Path, height: float = 0.12, drive: str = "plain") -> Path:
    """Write a store of four runs, with traces."""
    request = request_in(folder, height, drive)
    resume(request)
    assert isinstance(request.store, Path)
    return request.store


def begin_store(folder: Path, height: float = 0.12) -> Path:
    """Write a store whose sweep was stopped after three of its runs."""
    left = iter(range(2))

    def stop(_: object) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt

    request = request_in(folder, height)
    with suppress(KeyboardInterrupt), patch.multiple(planned_runs, LEAST_WORK=0, SMALL_WORK=0):
        resume(request, stop)
    assert isinstance(request.store, Path)
    return request.store


def meaning(store: Path) -> Any:
    """Return all that a store says; what cannot be read raises an error."""
    opened = Store.open(store)
    records = [record.model_dump(mode="json") for record in opened.records()]
    traces = {
        path.relative_to(store).as_posix(): path.read_bytes() for path in store.rglob("*.mcap")
    }
    scene = [path.read_bytes() for path in sorted(opened.scene_folder.rglob("*")) if path.is_file()]
    manifest = opened.manifest.model_dump(mode="json", exclude={"files"})
    return json.dumps([manifest, records], sort_keys=True), traces, scene


def use(store: Path) -> None:
    """Read a store by all its readers.

    Raises:
        ContactlabError: one of them refuses it.
    """
    opened = Store.open(store)
    for record in opened.records():
        opened.record(record.run_id)
        if record.trace is not None and not opened.manifest.traces_left_out:
            opened.trace(record)


@dataclass
class Attack:
    """Counts of what became of mutations.

    Attributes:
        counts: by outcome.
        by_kind: by mutation and level, then by outcome.
        cases: what was undetected or failed, with the seed that repeats it.
    """

    counts: Counter[str] = field(default_factory=Counter[str])
    by_kind: defaultdict[str, Counter[str]] = field(
        default_factory=lambda: defaultdict[str, Counter[str]](Counter[str])
    )
    cases: list[str] = field(default_factory=list[str])

    def add(self, mutation: Mutation, level: int, outcome: str, said: str) -> None:
        kind = f"{mutation.__name__} {level}"
        self.counts[outcome] += 1
        self.by_kind[kind][outcome] += 1
        if outcome not in OUTCOMES[:5]:
            self.cases.append(f"{outcome}: {kind}: {said}")


def attack(folder: Path, count: int, seed: int) -> Attack:
    """Bend stores so many times: with each drive, a baseline, and one whose sweep has not ended.

    The current folder is in no repository: its state, which records name, may change meanwhile.
    """
    kinds = {
        drive: (
            make_store(folder / drive, 0.12, drive),
            make_store(folder / f"{drive} 2", 0.13, drive),
        )
        for drive in DRIVES
    }
    now, before = (folder / each / "baseline" for each in ("plain", "plain 2"))
    for target in (now, before):
        write_baseline(target.parent / "store", target)
    begun = begin_store(folder / "begun"), begin_store(folder / "begun 2", 0.13)
    kinds |= {"baseline": (now, before), "unfinished": begun}
    whole, found = meaning(kinds["plain"][0]), Attack()
    for number, (kind, mutation, level) in enumerate(islice(mutations(tuple(kinds)), count)):
        store, older = kinds[kind]
        with tempfile.TemporaryDirectory(dir=folder) as name:
            bent = shutil.copytree(store, Path(name) / "store")
            (Path(name) / "outside").mkdir()
            target = Target(bent, older, Path(name) / "outside", random.Random(f"{seed} {number}"))
            said = f"{mutation(target)} of {kind}"
            if kind == "unfinished":
                reseal(bent) if level else None
                outcome = judge_resumed(bent, whole)
            else:
                redo(bent, level) if level else None
                outcome = judge_against(bent, store)
            found.add(mutation, level, outcome, f"{said} (seed {seed}, number {number})")
    return found


def judge_against(bent: Path, store: Path) -> str:
    """Return what became of a bent copy of a store."""
    outcome = judge(bent, meaning(store))
    if outcome == "undetected" and left_out(Store.open_unchecked(bent)) != left_out(
        Store.open(store)
    ):
        return OUTCOMES[4]
    if (
        outcome == "undetected"
        and (bent / MANIFEST).read_bytes() != (store / MANIFEST).read_bytes()
    ):
        return OUTCOMES[5]
    return outcome


def judge_resumed(store: Path, whole: Any) -> str:
    """Return what became of a bent store whose sweep goes on: it ends as one that was not bent."""
    try:
        with bounded():
            try:
                resume(request_in(store.parent))
                if lasting(meaning(store)) == lasting(whole):
                    return "harmless"
            except ContactlabError:
                return "detected"
        return "detected" if find_problems(store) else judge_runs(Store.open(store))
    except Exception as error:  # noqa: BLE001 - whatever it is, it is no message to a user
        return f"failed: {type(error).__name__}: {error}"[:200]


def lasting(said: Any) -> object:
    """Return what a store says, but for what differs from sweep to sweep: its clocks."""
    content, *rest = said
    _, records = json.loads(content)
    clocks = ("cost", "started", "finished")
    return [{key: each for key, each in row.items() if key not in clocks} for row in records], rest


def left_out(store: Store) -> list[str | None]:
    """Return what of a store `verify` says that it could not verify."""
    return [*unverifiable_parts(store), why_ids_unverifiable(store), why_plan_unverifiable(store)]


def judge(store: Path, before: object) -> str:
    """Return what became of a bent store."""
    try:
        with bounded():
            try:
                sound = not find_problems(store)
            except ContactlabError:
                sound = False
            try:
                use(store)
            except ContactlabError:
                return "detected" if not sound else "failed: a reader refuses what is sound"
        if not sound:
            return "detected"
        if meaning(store) == before:
            return "harmless"
        return judge_runs(Store.open(store))
    except Exception as error:  # noqa: BLE001 - whatever it is, it is no message to a user
        return f"failed: {type(error).__name__}: {error}"[:200]


def judge_runs(store: Store) -> str:
    """Return whether the engine finds out a store whose files and records are sound."""
    if why_ids_unverifiable(store) is None:
        if any(recomputed_problems(store)):
            return OUTCOMES[2]
        if simulate_again(store, store.manifest.runs).problems:
            return OUTCOMES[3]
    return "undetected"


@contextmanager
def bounded() -> Generator[None]:
    """End what takes too long."""

    def end(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, end)
    signal.alarm(_SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)


def main() -> None:
    """Print counts by outcome and by kind, and every case that was not found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2_030)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="contactlab-attack-") as name, chdir(name):
        found = attack(Path(name), given.count, given.seed)
    print(f"{sum(found.counts.values())} mutations in {time.monotonic() - started:.0f} s")
    for outcome, count in found.counts.most_common():
        print(f"  {count:6} {outcome}")
    for kind, counts in sorted(found.by_kind.items()):
        print(f"  {kind:26} {', '.join(f'{count} {outcome}' for outcome, count in counts.items())}")
    print("\n".join(found.cases))
    sys.exit(any(each.startswith(("undetected:", "failed")) for each in found.cases))


if __name__ == "__main__":
    main()
