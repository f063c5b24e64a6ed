"""Evidence holds every contact of a step, and says so where it does not."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from contactlab import resources
from contactlab.engines import Buffers
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.rollout_trace import make_trace
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.scene.scene import Scene
from contactlab.store.finished_store import Store

pytestmark = pytest.mark.long

CONTACTS = 52
"""Of a mug of twelve wall boxes and a bottom that stands on the floor: four points each."""

SWEEP = """\
version: 1
scene: {scene}
duration: 0.6
trace: all
axes: {{opening: [0.09], solref: ["0.005 1"]}}
"""


def swept(folder: Path, scene: str) -> dict[str, Any]:
    text = SWEEP.format(scene=scene)
    ask = read_request(text, "store", folder / "store", folder=folder, workers=0)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    (row,) = pq.read_table(folder / "store" / "runs.parquet").to_pylist()
    return row


def test_each_of_fifty_two_contacts_is_in_the_trace(tmp_path: Path) -> None:
    """What the file holds is what the engine's sensors reported, in single precision."""
    row = swept(tmp_path, "mug_drop")
    assert row["contacts_max"] == CONTACTS
    assert row["contacts_cut"] == 0
    assert row["label"] == "stable"
    store = Store.open(tmp_path / "store")
    stored = store.trace(store.record(row["run_id"]))
    scene = Scene.open("mug_drop")
    values = {"opening": 0.09, "solref": (0.005, 1.0)}
    run = scene.resolve(values, row["seed"], 0.6)
    base = scene.base(run.structure)
    prepared = base.prepare(run.list_edits())
    rollout = roll_out([prepared.model], scene.initial_states([run]), run.steps, Buffers())
    floor = make_trace(base, [prepared], rollout).pairs[2]
    filled = floor.touching[0].sum(axis=1)
    assert filled.max() == CONTACTS
    found = next(pair for pair in stored.pairs if pair.name == floor.name)
    assert found.steps.tolist() == np.flatnonzero(filled).tolist()
    assert found.contacts.tolist() == filled[filled > 0].tolist() == found.found.tolist()
    single = floor.slots[0][floor.touching[0]].astype(np.float32)
    assert found.points.tobytes() == single.astype(np.float64).tobytes()


def test_what_does_not_fit_is_labelled(tmp_path: Path) -> None:
    for name in ("mug_drop", "grasp_mug"):
        (tmp_path / name).mkdir()
        for file in (resources.MODELS / name).iterdir():
            (tmp_path / name / file.name).write_bytes(file.read_bytes())
    manifest = tmp_path / "mug_drop" / "scene.yaml"
    assert "slots: 64" in manifest.read_text()
    manifest.write_text(manifest.read_text().replace("slots: 64", "slots: 20"))
    row = swept(tmp_path, "./mug_drop")
    assert row["label"] == "contacts_cut"
    assert row["contacts_cut"] > 0
    assert "floor-mug had up to 52 contacts, but only 20 were recorded" in row["label_reason"]
