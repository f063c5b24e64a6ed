"""What planning costs: sweeps of up to 1,000,000 runs, of which none is run.

Run: python -m bench.planning [runs]...

`--plan` is the whole command; "before" is all that the parent does until it can hand out its first
job, imports included; "handing out" is what it then does for each run until the last job is packed,
without sending it. Each line is a process of its own; memory is that process's peak.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contactlab.parts import register_parts

if TYPE_CHECKING:
    from contactlab.run.tasks import FinishedRun

SIZES = (10_000, 100_000, 1_000_000)
# Ten values an axis and ten seeds; the number of axes decides how many runs there are.
AXES = {
    "timestep": "{logspace: [5e-4, 5e-3, 10]}",
    "restitution": "{linspace: [0.1, 0.9, 10]}",
    "drop_height": "{values: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0], role: scenario}",
    "friction.slide": "{linspace: [0.1, 1.0, 10]}",
    "impratio": "{logspace: [1, 100, 10]}",
}
MIXED = """
version: 1
scene: ball_drop
seeds: 5
axes:
  drop_height: {{loguniform: [0.1, 2]}}
  friction.slide: {{uniform: [0.1, 1]}}
  cone: [pyramidal, elliptic]
sample: {{n: {points}}}
zip:
  - timestep: [5e-4, 1e-3, 2e-3, 4e-3, 5e-3]
    restitution: [0.9, 0.8, 0.7, 0.6, 0.5]
exclude:
  - {{where: "timestep > 3e-3 and restitution < 0.7", cone: elliptic}}
  - {{timestep: 5e-4, cone: pyramidal}}
"""


def main() -> None:
    """Plan each size in processes of their own, or be one of them."""
    if sys.argv[1:2] == ["--one"]:
        hand_out(Path(sys.argv[2]))
        return
    sizes = [int(each) for each in sys.argv[1:]] or SIZES
    print(f"{'sweep':6} {'runs':>9}  {'':12} {'wall [s]':>8} {'CPU [s]':>8} {'peak [MB]':>9}")
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        for kind, text_of in (("grid", grid), ("mixed", mixed)):
            for runs in sizes:
                file = Path(name) / f"{kind}{runs}.yaml"
                file.write_text(text_of(runs), encoding="utf-8")
                measure(kind, runs, file)


def grid(runs: int) -> str:
    """Return a sweep of a product of axes, ten values each."""
    axes = list(AXES.items())[: len(str(runs)) - 2]
    lines = "".join(f"  {name}: {values}\n" for name, values in axes)
    return f"version: 1\nscene: ball_drop\nseeds: 10\naxes:\n{lines}"


def mixed(runs: int) -> str:
    """Return a sweep with zipped and sampled axes, from which rows are left out."""
    # Of ten rows a point three are left out, and each has five seeds.
    return MIXED.format(points=runs // 35)


def measure(kind: str, runs: int, file: Path) -> None:
    """Print what planning one sweep costs."""
    program = str(Path(sys.executable).with_name("contactlab"))
    command = ["sweep", str(file), "--plan", "--workers", "2"]
    plan = spent_by([program, *command])
    print(f"{kind:6} {runs:9,}  {'--plan':12} {plan}", flush=True)
    whole = spent_by([sys.executable, "-m", "bench.planning", "--one", str(file)])
    said = json.loads(whole.output)
    before = Spent(said["wall"], said["cpu"], said["peak"])
    print(f"{kind:6} {runs:9,}  {'before':12} {before}", flush=True)
    each = 1e6 * said["handing_out"] / said["runs"]
    print(f"{kind:6} {said['runs']:9,}  {'handing out':12} {each:.1f} us a run", flush=True)


@dataclass(frozen=True)
class Spent:
    """What a process took: wall and CPU time [s], peak memory [B], what it printed."""

    wall: float
    cpu: float
    peak: float
    output: str = ""

    def __str__(self) -> str:
        return f"{self.wall:8.2f} {self.cpu:8.2f} {self.peak / 1e6:9,.0f}"


def spent_by(command: list[str]) -> Spent:
    """Run a command and return what it took."""
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    # A process of its own in between, whose only child is measured: the peak is of all children.
    measuring = "import json,resource,subprocess,sys; done = subprocess.run(sys.argv[1:], "
    measuring += "stdout=subprocess.PIPE, text=True, check=True); "
    measuring += "peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss; "
    measuring += "print(json.dumps([peak, done.stdout]))"
    arguments = [sys.executable, "-c", measuring, *command]
    done = subprocess.run(arguments, stdout=subprocess.PIPE, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    peak, output = json.loads(done.stdout)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(time.perf_counter() - start, cpu, peak * 1024, output)


def _ignore(*_: object) -> None:
    """Show no progress."""


class EnoughError(Exception):
    """All jobs are packed."""


@dataclass
class Taker:
    """An executor that takes every job and runs none.

    Attributes:
        workers: as many as jobs are made for.
        begun: when it got its first job, wall and CPU time [s], and the peak memory then [kB].
        runs: of all jobs.
    """

    workers: int = 2
    begun: tuple[float, float, int] = (0.0, 0.0, 0)
    runs: int = 0

    def run(
        self, task: object, jobs: Iterable[tuple[object, ...]], stop: object
    ) -> "Iterator[list[FinishedRun]]":
        """Take all jobs, then end the sweep."""
        del task, stop
        for job in jobs:
            if not self.runs:
                peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
                self.begun = (time.time(), time.process_time(), peak)
            self.runs += len(job)
        raise EnoughError
        yield []


def hand_out(file: Path) -> None:
    """Plan a sweep, pack all its jobs, and print what that took as JSON."""
    start = time.time()
    from contactlab.run.sweep_request import read_request  # noqa: PLC0415 - imports are measured
    from contactlab.run.sweep_runner import run_sweep  # noqa: PLC0415 - imports are measured

    taker = Taker()
    ask = read_request(file, file.stem, file.with_suffix(""), folder=file.parent, workers=2)
    ask.__dict__["cluster"] = taker
    try:
        run_sweep(ask, _ignore, _ignore)
    except EnoughError:
        wall, cpu, peak = taker.begun
        spent = {"wall": wall - start, "cpu": cpu, "peak": peak * 1024, "runs": taker.runs}
        print(json.dumps(spent | {"handing_out": time.process_time() - cpu}))


if __name__ == "__main__":
    register_parts()
    main()
