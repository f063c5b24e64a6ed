"""A naive loop: `mj_step` from Python, every contact of every step kept, metrics, Parquet.

Run: python -m bench.naive_loop RUNS.json TABLE.parquet
"""

import multiprocessing
import sys
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from bench.plain import PlainRun, load
from numpy.typing import NDArray

PROCESSES = 2


def simulate(run: PlainRun) -> dict[str, float]:
    """Step one run and return its metrics by name."""
    model, data = run.start()
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    states: list[NDArray[np.float64]] = []
    contacts: list[NDArray[np.float64]] = []
    energy, force = np.empty(run.steps), np.empty(6)
    for step in range(run.steps):
        mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel]))
        energy[step] = data.energy.sum()
        for index in range(data.ncon):
            contact = data.contact[index]
            mujoco.mj_contactForce(model, data, index, force)
            contacts.append(np.array([step, contact.dist, *contact.pos, *force]))
    rows = np.array(contacts).reshape(-1, 11)
    speed = np.array(states)[:, model.nq :]
    touching = np.bincount(rows[:, 0].astype(int), minlength=run.steps) > 0
    return {
        "penetration_max": float(-rows[:, 1].min(initial=0.0)),
        "penetration_mean": float(-rows[:, 1].mean()) if len(rows) else 0.0,
        "energy_gain": float(energy.max() - energy[0]),
        "energy_drift": float(energy[-1] - energy[0]),
        "speed_max": float(np.linalg.norm(speed[:, :3], axis=1).max()),
        "force_max": float(rows[:, 5].max(initial=0.0)),
        "impulse": float(rows[:, 5].sum() * model.opt.timestep),
        "impacts": float(np.count_nonzero(np.diff(touching)) / 2),
        "contacts_mean": len(rows) / run.steps,
        "height": float(data.qpos[2]),
    }


def main() -> None:
    """Simulate every run and write the table."""
    with multiprocessing.Pool(PROCESSES) as pool:
        rows = pool.map(simulate, load(Path(sys.argv[1])), chunksize=4)
    pq.write_table(pa.Table.from_pylist(rows), sys.argv[2])


if __name__ == "__main__":
    main()
