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
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from tests.attack.mutations import MANIFEST, Mutation, Target, mutations, redo

from contactlab.errors import ContactlabError
from contactlab.plan.sweep_file import read_sweep
from contactlab.run.recomputed_runs import (
    recomputed_problems,
    simulated_problems,
    unplanned,
    unresolved,
)
from contactlab.run.sweep_request import SceneLoader, SweepRequest
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import unverified, verify

MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body pos="0 0 {height}"><freejoint/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
SWEEP = """
version: 1
scene: ./model.xml
duration: 0.02
seeds: 2
trace: all
axes: {timestep: [1.0e-3, 2.0e-3]}
"""
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


def make_store(folder: Path, height: float) -> Path:
    """Write a store of four runs, with traces."""
    folder.mkdir()
    (folder / "model.xml").write_text(MODEL.format(height=height))
    scenes = SceneLoader(folder)
    read = read_sweep(SWEEP, scenes.vocabulary)
    scene, store = scenes.open(read.sweep.scene), folder / "store"
    request = SweepRequest(
        plan=read.plan,
        scene=scene,
        name="small",
        source=SWEEP,
        overrides=(),
        store=store,
        workers=0,
    )
    run_sweep(request, lambda *_: None, lambda _: None)
    return store


def meaning(store: Path) -> object:
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
    """Bend a store so many times."""
    store, older = make_store(folder / "now", 0.12), make_store(folder / "before", 0.13)
    before, pinned = meaning(store), (store / MANIFEST).read_bytes()
    left_open = left_out(Store.open(store))
    found = Attack()
    for number, (mutation, level) in enumerate(islice(mutations(), count)):
        with tempfile.TemporaryDirectory(dir=folder) as name:
            bent = Path(name) / "store"
            shutil.copytree(store, bent)
            (Path(name) / "outside").mkdir()
            target = Target(bent, older, Path(name) / "outside", random.Random(f"{seed} {number}"))
            said = mutation(target)
            redo(bent, level) if level else None
            outcome = judge(bent, before)
            if outcome == "undetected" and left_out(Store.unchecked(bent)) != left_open:
                outcome = OUTCOMES[4]
            if outcome == "undetected" and (bent / MANIFEST).read_bytes() != pinned:
                outcome = OUTCOMES[5]
            found.add(mutation, level, outcome, f"{said} (seed {seed}, number {number})")
    return found


def left_out(store: Store) -> list[str | None]:
    """Return what of a store `verify` says that it could not verify."""
    return [*unverified(store), unresolved(store), unplanned(store)]


def judge(store: Path, before: object) -> str:
    """Return what became of a bent store."""
    try:
        with bounded():
            try:
                sound = not verify(store)
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
    if unresolved(store) is None:
        if any(recomputed_problems(store)):
            return OUTCOMES[2]
        if any(simulated_problems(store, store.manifest.runs)):
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
    with tempfile.TemporaryDirectory(prefix="contactlab-attack-") as name:
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
