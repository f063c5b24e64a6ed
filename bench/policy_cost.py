"""What a policy at 50 Hz adds to a sweep beside its own calls, in jobs of 32 runs.

    python -m bench.policy_cost

Each model is swept with a policy and without one, in turns, in this process. The policy's controls
differ from run to run, but are so small that the motion is the same. It clocks its own calls. Times
are medians of the rounds, of this process in user mode: what the system takes for the files of
controls depends on the disk.
"""

import resource
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from statistics import median

from contactlab.parts import register_parts
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep

ROUNDS = 7
RUNS = 256
"""Jobs of 32 runs, but for the last ones."""
POLICY = """
import time

spent = []

class Faint:
    def __init__(self, model):
        self.actuators = model.nu

    def __call__(self, now, qpos, qvel, sensordata):
        begin = time.thread_time()
        wanted = -1e-12 * (qpos + 0.1 * qvel)[:, : self.actuators]
        spent.append(time.thread_time() - begin)
        return wanted
"""


def chain(links: int) -> str:
    """Return a chain of links, each with a motor."""
    bodies = "".join(
        f'<body pos=".2 0 0"><joint name="j{link}" axis="0 1 0" damping=".1"/>'
        '<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>'
        for link in range(links)
    )
    motors = "".join(f'<motor joint="j{link}"/>' for link in range(links))
    return (
        '<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{bodies}{'</body>' * links}</worldbody>"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def swept(folder: Path, name: str, drive: object) -> float:
    """Sweep once; return the CPU time in user mode [s]."""
    sweep = {
        "version": 1,
        "scene": "model.xml",
        "duration": 2.0,
        "seeds": RUNS,
        "trace": "none",
        "checks": "none",
        "drive": drive,
    }
    with tempfile.TemporaryDirectory(dir=folder) as store:
        ask = read_request(sweep, name, Path(store), folder=folder, workers=0)
        begin = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        run_sweep(replace(ask, allow_code=True), lambda *_: None, lambda *_: None)
        return resource.getrusage(resource.RUSAGE_SELF).ru_utime - begin


def own_time() -> float:
    """Return what the policy took since it was last asked [s]."""
    spent: list[float] = sys.modules["contactlab_policy_faint"].spent
    total = sum(spent)
    spent.clear()
    return total


def measure(links: int) -> None:
    """Print what a policy adds for a chain of links."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "model.xml").write_text(chain(links), encoding="utf-8")
        (folder / "faint.py").write_text(POLICY, encoding="utf-8")
        policy = {"policy": "faint.py:Faint", "rate": 50.0}
        without, with_policy, calls = [], [], []
        for _ in range(ROUNDS):
            without.append(swept(folder, "without", "none"))
            whole = swept(folder, "with", policy)
            calls.append(own_time())
            with_policy.append(whole - calls[-1])
    added = median(with_policy) / median(without) - 1
    print(
        f"{links} links: {median(without):.2f} s without a policy, {median(with_policy):.2f} s "
        f"with it and {median(calls):.2f} s in it: {added:+.1%} beside its own calls"
    )


def main() -> None:
    """Measure small models and larger ones."""
    for links in (1, 7, 30):
        measure(links)


if __name__ == "__main__":
    register_parts()
    main()
