"""Forecasts of sweeps against the time, memory and disk that these sweeps then take; Linux only.

Run: python -m bench.forecasts [sweep]...        # shipped sweeps, or of `OWN`; without one, all

Time is CPU time, since a busy machine stretches all else: that of the command, plus that of its
workers over their number. Memory is the largest sum of resident memory of all processes, disk the
size of the store. A forecast's time is the middle of its range. Each sweep has two lines: the
forecast, and the sweep with its ratios to the forecast.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bench.processes import adopt_orphans

CART = """\
<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="5 5 .1" pos="0 0 -1"/>
<body name="cart"><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/>
<body name="pole"><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 .6" size=".02" mass=".1"/></body></body></worldbody>
<actuator><motor joint="rail" ctrlrange="-50 50"/></actuator></mujoco>
"""
CLOTH = """\
<mujoco><option timestep=".002" solver="CG"/><worldbody><geom type="plane" size="1 1 .1"/>
<flexcomp name="cloth" type="grid" count="7 7 1" spacing=".05 .05 .05" pos="0 0 .3" mass=".2"
radius=".01" dim="2"><edge equality="true"/></flexcomp></worldbody></mujoco>
"""
POLICY = """\
class Balance:
    rate = 100.0

    def __init__(self, model):
        pass

    def __call__(self, time, qpos, qvel, sensordata):
        return 20 * qpos[:, 1:] + 4 * qvel[:, 1:]
"""
# Sweep text and workers.
OWN = {
    "contacts": (
        """\
scene: box_stack
axes: {boxes: [3, 6, 9], timestep: [1e-3, 2e-3, 4e-3]}
seeds: 4
""",
        2,
    ),
    "checks": (
        """\
scene: grasp_mug
checks: all
trace: none
axes: {timestep: [1e-3, 2e-3, 4e-3], cone: [elliptic, pyramidal]}
seeds: 3
""",
        2,
    ),
    "verdict": (
        """\
scene: box_slide
checks: verdict
axes: {timestep: [1e-3, 2e-3, 5e-3], friction.slide: [0.3, 0.6, 1.0]}
seeds: 3
""",
        1,
    ),
    "traces": (
        """\
scene: tower_20
trace: all
checks: none
axes: {timestep: [1e-3, 2e-3, 4e-3]}
seeds: 4
""",
        2,
    ),
    "compact": (
        """\
scene: pile
trace: all
trace_format: compact
checks: none
axes: {timestep: [1e-3, 2e-3, 4e-3]}
seeds: 4
""",
        1,
    ),
    "policy": (
        """\
scene: cart.xml
drive: {policy: 'policy.py:Balance'}
duration: 2s
axes: {timestep: [1e-3, 2e-3, 5e-3], friction.slide: [0.5, 1.0]}
seeds: 4
""",
        2,
    ),
    "flex": (
        """\
scene: cloth.xml
duration: 1s
axes: {timestep: [1e-3, 2e-3]}
seeds: 6
""",
        1,
    ),
    "seeds": (
        """\
scene: ball_drop
axes: {timestep: [5e-4, 2e-3]}
seeds: 1000
""",
        2,
    ),
    "long": (
        """\
scene: ragdoll
duration: 30s
axes: {timestep: [2e-3, 4e-3]}
seeds: 3
""",
        1,
    ),
    "robot": (
        """\
scene: menagerie:franka_emika_panda
duration: 2s
axes: {timestep: [1e-3, 2e-3, 4e-3], friction.slide: [0.5, 1.0]}
seeds: 3
""",
        2,
    ),
}
SHIPPED = Path(__file__).parents[1] / "sweeps"


@dataclass
class Usage:
    """Resources of a command with all that it starts: own and other CPU time [s], memory [B]."""

    own: float
    others: float
    memory: int
    output: str


def main() -> None:
    """Print a table of the sweeps with their forecasts."""
    adopt_orphans()
    names = sys.argv[1:] or [*sorted(path.stem for path in SHIPPED.glob("*.yaml")), *OWN]
    print(f"{'sweep':20} {'workers':>7} {'time [s]':>19} {'memory [MB]':>17} {'disk [MB]':>19}")
    for name in names:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
            print(compare_forecast(name, Path(folder)), flush=True)


def compare_forecast(name: str, folder: Path) -> str:
    """Run a sweep after its forecast, and return a line of both with their ratios."""
    text, workers = OWN.get(name, ("", 2))
    (folder / "cart.xml").write_text(CART, encoding="utf-8")
    (folder / "cloth.xml").write_text(CLOTH, encoding="utf-8")
    (folder / "policy.py").write_text(POLICY, encoding="utf-8")
    (folder / "own.yaml").write_text(f"version: 1\n{text}\n", encoding="utf-8")
    program = str(Path(sys.executable).with_name("contactlab"))
    source = str(folder / "own.yaml") if name in OWN else name
    sweep = [program, "sweep", source, "--allow-code", "--yes", "--workers", str(workers)]
    plan = json.loads(measure_command([*sweep, "--plan", "--format", "json"], {0, 1}).output)
    store = folder / "store"
    usage = measure_command([*sweep, "-o", str(store)], {0, 1})
    least, most = plan["seconds"]
    size = sum(file.stat().st_size for file in store.rglob("*") if file.is_file())
    pairs = (
        ((least * most) ** 0.5, usage.own + usage.others / plan["cores"]),
        (plan["memory_bytes"] / 1e6, usage.memory / 1e6),
        (plan_bytes(plan) / 1e6, size / 1e6),
    )
    cells = (f"{said:8.3g} {true:7.3g} x{true / said:.2f}" for said, true in pairs)
    return f"{name:20} {workers:7} {' '.join(cells)}"


def plan_bytes(plan: dict[str, object]) -> float:
    """Return the middle of a forecast of a store's size."""
    least, most = plan["bytes"]  # type: ignore[misc]
    return float((least + most) / 2) + float(plan["scene_bytes"] + plan["table_bytes"])  # type: ignore[arg-type, operator]


def measure_command(command: list[str], codes: set[int]) -> Usage:
    """Run a command, wait for all processes that it leaves behind, and return their usage."""
    peak, ended = [0], threading.Event()
    watch = threading.Thread(target=_watch_memory, args=(peak, ended), daemon=True)
    watch.start()
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8") as output,
        tempfile.TemporaryFile("w+", encoding="utf-8") as errors,
    ):
        process = subprocess.Popen(command, stdout=output, stderr=errors)
        used, code = dict[int, float](), 0
        with suppress(ChildProcessError):
            while True:
                child, status, usage = os.wait4(-1, 0)
                used[child] = usage.ru_utime + usage.ru_stime
                code = os.waitstatus_to_exitcode(status) if child == process.pid else code
        ended.set()
        watch.join()
        output.seek(0)
        errors.seek(0)
        if code not in codes:
            raise RuntimeError(f"{' '.join(command)} failed:\n{errors.read()}")
        own = used.pop(process.pid)
        return Usage(own, sum(used.values()), peak[0], output.read())


def _watch_memory(peak: list[int], ended: threading.Event) -> None:
    page, me = os.sysconf("SC_PAGE_SIZE"), os.getpid()
    while not ended.wait(0.05):
        parents, resident = dict[int, int](), dict[int, int]()
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, ValueError, IndexError):
                fields = (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
                parents[int(folder.name)] = int(fields[1])
                resident[int(folder.name)] = int(fields[21]) * page
        tree = {me}
        for _ in range(4):  # command, fork server, worker, compiler
            tree |= {child for child, parent in parents.items() if parent in tree}
        peak[0] = max(peak[0], sum(resident.get(child, 0) for child in tree - {me}))


if __name__ == "__main__":
    main()
