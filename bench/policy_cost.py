"""What a policy at 50 Hz adds to a sweep beside its own calls, in jobs of 32 runs.

    python -m bench.policy_cost

Each model is swept with a policy that holds it and without one, in turns, in this process; CPU
times are the least of the rounds. The policy clocks its own calls.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep

ROUNDS = 3
RUNS = 256
"""Jobs of 32 runs, but for the last ones."""
POLICY = """
import time
import mujoco
import numpy as np

spent = []

class Hold:
    def __init__(self, model):
        begin = time.thread_time()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self.actuators, self.weight = model.nu, data.qfrc_bias.copy()
        spent.append(time.thread_time() - begin)

    def __call__(self, now, qpos, qvel, sensordata):
        begin = time.thread_time()
        wanted = (self.weight - 2.0 * qpos - 0.2 * qvel)[:, : self.actuators]
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
    """Sweep once; return the CPU time [s]."""
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
        begin = time.process_time()
        run_sweep(replace(ask, allow_code=True), lambda *_: None, lambda *_: None)
        return time.process_time() - begin


def own_time() -> float:
    """Return what the policy took since it was last asked [s]."""
    spent: list[float] = sys.modules["contactlab_policy_hold"].spent
    total = sum(spent)
    spent.clear()
    return total


def measure(links: int) -> None:
    """Print what a policy adds for a chain of links."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "model.xml").write_text(chain(links), encoding="utf-8")
        (folder / "hold.py").write_text(POLICY, encoding="utf-8")
        policy = {"policy": "hold.py:Hold", "rate": 50.0}
        without, with_policy, calls = [], [], []
        for _ in range(ROUNDS):
            without.append(swept(folder, "without", "none"))
            whole = swept(folder, "with", policy)
            calls.append(own_time())
            with_policy.append(whole - calls[-1])
    added = min(with_policy) / min(without) - 1
    print(
        f"{links} links: {min(without):.2f} s without a policy, {min(with_policy):.2f} s with it "
        f"and {min(calls):.2f} s in it: {added:+.1%} beside its own calls"
    )


def main() -> None:
    """Measure small models and larger ones."""
    for links in (1, 7, 30):
        measure(links)


if __name__ == "__main__":
    main()
