"""What one would write in an afternoon: a Python step loop, metrics, and MCAP with JSON.

Run: python -m bench.straightforward RUNS.json FOLDER
"""

import csv
import json
import multiprocessing
import sys
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from bench.plain import PlainRun, load
from mcap.writer import Writer

PROCESSES = 2
_SCHEMA = b'{"type": "object"}'

Numbers = list[float]


@dataclass
class Recorded:
    """What the metrics are made of, one entry a step."""

    energy: Numbers = field(default_factory=list[float])
    depth: Numbers = field(default_factory=list[float])
    speed: Numbers = field(default_factory=list[float])
    contacts: list[int] = field(default_factory=list[int])
    iterations: list[int] = field(default_factory=list[int])


class TraceFile:
    """One run's messages, as the mcap package writes them by itself."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._writer = Writer(self._file)
        self._writer.start()
        schema = self._writer.register_schema("State", "jsonschema", _SCHEMA)
        self._state = self._writer.register_channel("/state", "json", schema)
        schema = self._writer.register_schema("Contacts", "jsonschema", _SCHEMA)
        self._contacts = self._writer.register_channel("/contacts", "json", schema)

    def add(self, data: mujoco.MjData, contacts: list[dict[str, object]]) -> None:
        """Add what one step left."""
        now = round(data.time * 1e9)
        state = {
            "time": data.time,
            "qpos": data.qpos.tolist(),
            "qvel": data.qvel.tolist(),
            "energy": data.energy.tolist(),
        }
        self._writer.add_message(self._state, now, json.dumps(state).encode(), now)
        if contacts:
            message = json.dumps({"contacts": contacts}).encode()
            self._writer.add_message(self._contacts, now, message, now)

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()
        self._file.close()


def read_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> list[dict[str, object]]:
    """Return the contacts of a state with their forces."""
    found: list[dict[str, object]] = []
    force = np.empty(6)
    for index in range(data.ncon):
        contact = data.contact[index]
        mujoco.mj_contactForce(model, data, index, force)
        found.append(
            {
                "geom1": int(contact.geom1),
                "geom2": int(contact.geom2),
                "distance": float(contact.dist),
                "position": contact.pos.tolist(),
                "frame": contact.frame.tolist(),
                "force": force.tolist(),
            }
        )
    return found


def simulate(folder: Path, job: tuple[int, PlainRun]) -> dict[str, float]:
    """Run one simulation, write its trace, return its row of the table."""
    number, run = job
    model, data = run.start()
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    recorded = Recorded()
    trace = TraceFile(folder / f"{number}.mcap")
    for _ in range(run.steps):
        mujoco.mj_step(model, data)
        contacts = read_contacts(model, data)
        recorded.energy.append(float(data.energy.sum()))
        recorded.depth.append(-min((data.contact.dist), default=0.0))
        recorded.speed.append(float(data.qvel[2]))
        recorded.contacts.append(data.ncon)
        recorded.iterations.append(int(data.solver_niter[0]))
        trace.add(data, contacts)
    trace.close()
    return {"run": number, **metrics(recorded)}


def metrics(recorded: Recorded) -> dict[str, float]:
    """Return the numbers that a run is judged by."""
    energy, depth, speed = (
        np.array(each) for each in (recorded.energy, recorded.depth, recorded.speed)
    )
    touching = np.array(recorded.contacts) > 0
    switches = np.flatnonzero(np.diff(touching.astype(int)))
    return {
        "penetration_max": float(depth.max()),
        "penetration_mean": float(depth[touching].mean()) if touching.any() else 0.0,
        "penetration_steady": float(depth[-len(depth) // 5 :].mean()),
        "energy_gain": float(energy.max() - energy[0]),
        "energy_drift": float(energy[-1] - energy[0]),
        "speed_max": float(np.abs(speed).max()),
        "impacts": len(switches) / 2,
        "contacts_max": max(recorded.contacts),
        "iterations_mean": float(np.mean(recorded.iterations)),
    }


def main() -> None:
    """Run every simulation and write the table."""
    folder = Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    jobs = list(enumerate(load(Path(sys.argv[1]))))
    with multiprocessing.Pool(PROCESSES) as pool:
        rows = list(pool.imap_unordered(partial(simulate, folder), jobs))
    with (folder / "runs.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
