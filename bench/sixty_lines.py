"""What someone who knows MuJoCo writes: native rollouts, a contact sensor, NumPy, Parquet.

Run: python -m bench.sixty_lines RUNS.json TABLE.parquet

Of each step it keeps the nearest contact of all; no traces, no provenance, no resuming.
"""

import copy
import multiprocessing
import sys
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from bench.plain import PlainRun, load
from mujoco import rollout
from numpy.typing import NDArray

PROCESSES = 2
CHUNK = 32
SENSORS = """<sensor>
  <contact num="1" reduce="mindist" data="found force dist"/><e_potential/><e_kinetic/>
</sensor></mujoco>"""


def model_of(run: PlainRun) -> mujoco.MjModel:
    """Return the model of a run, with sensors."""
    text = Path(run.model).read_text(encoding="utf-8")
    return mujoco.MjModel.from_xml_string(text.replace("</mujoco>", SENSORS))


def simulate(runs: list[PlainRun]) -> dict[str, NDArray[np.float64]]:
    """Step runs of one structure and return their metrics by name."""
    first = model_of(runs[0])
    models = [copy.copy(first) for _ in runs]
    data = mujoco.MjData(first)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.zeros((len(runs), mujoco.mj_stateSize(first, kind)))
    for model, run, start in zip(models, runs, starts, strict=True):
        if run.solref is not None:
            model.geom_solref[:] = run.solref
        data.qpos[:], data.qvel[:] = run.qpos, run.qvel
        mujoco.mj_getState(first, data, start, kind)
    made = rollout.rollout(models, data, starts, nstep=runs[0].steps)
    states, sensed = (np.asarray(each, np.float64) for each in made)
    found, force, distance = sensed[..., 0], sensed[..., 1], sensed[..., 4]
    energy = sensed[..., 5] + sensed[..., 6]
    depth, speed = np.where(found > 0, -distance, 0.0), states[..., 1 + first.nq : 1 + first.nq + 3]
    late = slice(-(runs[0].steps // 5), None)
    return {
        "penetration_max": depth.max(axis=1),
        "penetration_mean": depth.sum(axis=1) / np.maximum((found > 0).sum(axis=1), 1),
        "penetration_steady": depth[:, late].mean(axis=1),
        "energy_gain": energy.max(axis=1) - energy[:, 0],
        "energy_drift": energy[:, -1] - energy[:, 0],
        "speed_max": np.linalg.norm(speed, axis=2).max(axis=1),
        "force_max": force.max(axis=1),
        "impulse": force.sum(axis=1) * first.opt.timestep,
        "impacts": np.count_nonzero(np.diff(found > 0, axis=1), axis=1) / 2,
        "height": states[:, -1, 3],
    }


def main() -> None:
    """Simulate every run and write the table."""
    runs = load(Path(sys.argv[1]))
    chunks = [runs[at : at + CHUNK] for at in range(0, len(runs), CHUNK)]
    with multiprocessing.Pool(PROCESSES) as pool:
        parts = pool.map(simulate, chunks, chunksize=1)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    pq.write_table(pa.table(columns), sys.argv[2])


if __name__ == "__main__":
    main()
