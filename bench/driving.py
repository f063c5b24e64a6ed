"""What driving a run costs beside its physics: hold, noise and a file, against the same undriven.

Run: python -m bench.driving MODEL [MODEL ...]

Driven robots move, and what moves costs other steps. So the signals of noise and files are made
constant at what holds the posture: the trajectories of all drives are then equal to the bit, and
what a drive takes more is what it costs. Each sweep is a job of 8 runs: states and models are made,
and stepped. CPU times are interleaved; the ratio is that of the least of all rounds.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from contactlab.engines import Buffers, PreparedRuns, find_engine
from contactlab.scene.scene import Scene
from contactlab.schema.drive import FileDrive, NoiseDrive
from contactlab.store.control_tables import read_control_table

RUNS = 8
SECONDS = 1.0
ROUNDS = 9


def prepared(scene: Scene, held: PreparedRuns | None = None) -> PreparedRuns:
    """Return a job, its signals constant at the controls of `held` if given."""
    runs = [scene.resolve({}, seed, SECONDS) for seed in range(RUNS)]
    job = PreparedRuns.of(scene, *runs)
    if held is None:
        return job
    signals = tuple(
        replace(each, levels=np.repeat(held.starts.ctrl[:1].T, each.levels.shape[1], axis=1))
        for each in job.starts.signals
    )
    start = held.starts._replace(signals=signals)
    return replace(job, starts=start, prepared=held.prepared)


def least(job: Callable[[], object]) -> float:
    """Return the CPU time of one call [s]."""
    begin = time.thread_time()
    job()
    return time.thread_time() - begin


def measure(model: str, folder: Path) -> None:
    """Print what each drive costs for a model."""
    scene = Scene.open(model, tables=read_control_table)
    held = scene.with_drive("hold", folder)
    nu = scene.base({}).model.nu
    times = np.linspace(0, SECONDS, 1001)
    np.savez(folder / "controls.npz", time=times, ctrl=np.zeros((1001, nu)))
    drives = {
        "noise": scene.with_drive(NoiseDrive(noise=0.3), folder),
        "file": scene.with_drive(FileDrive(file="controls.npz"), folder),
    }
    base = prepared(held)
    jobs = {"undriven": base} | {name: prepared(each, base) for name, each in drives.items()}
    scenes = {"undriven": scene.with_drive("none", folder), "hold": held, **drives}
    engine, buffers = find_engine("mujoco"), Buffers()
    starts = dict.fromkeys(scenes, np.inf)
    steps = dict.fromkeys(jobs, np.inf)
    for _ in range(ROUNDS):
        for name, each in scenes.items():
            runs = [each.resolve({}, seed, SECONDS) for seed in range(RUNS)]
            starts[name] = min(
                starts[name], least(lambda each=each, runs=runs: each.initial_states(runs))
            )
        for name, job in jobs.items():
            steps[name] = min(steps[name], least(lambda job=job: engine.roll_out(job, buffers)))
    whole = starts["undriven"] + steps["undriven"]
    print(f"{model}: {nu} actuators, {1e6 * steps['undriven'] / RUNS / base.steps:.1f} us a step")
    for name in ("hold", *drives):
        more = starts[name] + steps.get(name, steps["undriven"]) - whole
        print(f"  {name:6s} {100 * more / whole:+.2f} % (starts {1e3 * starts[name]:.2f} ms)")


def main() -> None:
    """Measure the models that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("models", nargs="+")
    with TemporaryDirectory() as folder:
        for model in parser.parse_args().models:
            measure(model, Path(folder))


if __name__ == "__main__":
    main()
