"""Small stores, made by hand and without the engine, to compare."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from contactlab.schema.evidence import (
    Cost,
    Engine,
    EvidenceRecord,
    Host,
    InitialState,
    LabelEntry,
    Provenance,
    SweepIdentity,
)
from contactlab.store.atomic_files import sha256_of
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import (
    REAL,
    SHARED_FIELDS,
    Column,
    axis_column,
    record_to_row,
    struct_column,
)

# Name to unit, direction and resolution; `found` is of the second pass.
METRICS = {
    "depth": ("m", "lower", 1e-9),
    "grip": ("N", "higher", 1e-9),
    "slip": ("m", "none", 1e-9),
    "solver_iterations": ("1", "lower", 0.0),
    "found": ("1", "lower", 0.0),
}
SEVERITY = ("crashed", "diverged", "tunneling", "chatter", "stable")
HOST = Host(cpu_model="cpu", cpu_flags="f", cores=2, os="Linux")
PROVENANCE = Provenance(contactlab="0.1.0", git_revision=None, python="3.11", numpy="2", host=HOST)


@dataclass
class SceneFile:
    """A scene of one file."""

    def copy_to(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.xml").write_text("<mujoco/>")


@dataclass
class Given:
    """Runs to be stored, and what their store says of them.

    Attributes:
        runs: the records.
        identity: fields of the sweep's identity that differ from the usual.
        provenance: who wrote it.
        versions: of the metrics' definitions.
    """

    runs: list[EvidenceRecord]
    identity: dict[str, Any] = field(default_factory=dict[str, Any])
    provenance: Provenance = PROVENANCE
    versions: dict[str, int] = field(default_factory=lambda: dict.fromkeys(METRICS, 1))

    def change(self, index: int, **changes: Any) -> None:
        """Change fields of one record."""
        self.runs[index] = self.runs[index].model_copy(update=changes)

    def cost(self, index: int, cpu_s: float) -> None:
        """Give one record another CPU time [s]."""
        run = self.runs[index]
        timestep = run.settings["timestep"]
        assert isinstance(timestep, float)
        self.change(index, cost=Cost.of_steps(cpu_s, run.steps, timestep, None))

    def measure(self, index: int, **metrics: float | None) -> None:
        """Change metrics of one record, and its trajectory, from which metrics follow."""
        measured = {**self.runs[index].metrics, **metrics}
        moved = blake2b(repr(measured).encode(), digest_size=16).hexdigest()
        self.change(index, metrics=measured, trajectory_hash=moved)

    def label(self, index: int, *labels: str) -> None:
        """Give one record other labels, the worst first."""
        entries = tuple(LabelEntry(label=label, reason="because", step=1) for label in labels)
        self.change(index, labels=entries, label=labels[0] if labels else "stable")


def record(index: int, cone: str, timestep: float) -> EvidenceRecord:
    """Return the record of a stable run."""
    metrics = {"depth": 1e-3, "grip": 10.0, "slip": 0.5, "solver_iterations": 100.0, "found": None}
    return EvidenceRecord(
        run_id=f"{index + 1:016x}",
        index=index,
        sweep="tried",
        scene="ball",
        scene_hash="abc",
        engine=Engine(name="mujoco", version="4.0.0"),
        axes={"cone": cone, "timestep": timestep},
        settings={"cone": cone, "timestep": timestep},
        effects={"refsafe": True},
        pairs={},
        edited_geoms=(),
        seed=0,
        initial=InitialState(qpos=(0.0,), qvel=(0.0,)),
        duration=1.0,
        status="ok",
        status_reason=None,
        steps=10,
        steps_asked=10,
        warnings={},
        metrics=metrics,
        metric_versions={},
        units={name: unit for name, (unit, _, _) in METRICS.items()},
        label="stable",
        labels=(),
        expected=None,
        expectation_met=None,
        expectation_reason=None,
        tolerances_met=None,
        trajectory_hash=f"{index:032x}",
        provenance=PROVENANCE,
        cost=Cost.of_steps(1.0, 10, timestep, None),
    )


def eight() -> Given:
    """Return eight stable runs: two cones and four timesteps."""
    values = product(("elliptic", "pyramidal"), (1e-3, 2e-3, 4e-3, 8e-3))
    return Given([record(index, *each) for index, each in enumerate(values)])


def write(path: Path, given: Given) -> Path:
    """Write a store."""
    told: dict[str, Any] = {
        "name": "tried",
        "source": "version: 1\n",
        "overrides": (),
        "resolved": {"version": 1, "scene": "ball", "checks": "flagged", "thresholds": {}},
        "scene": "ball",
        "scene_hash": "abc",
        "scene_model": "scene.xml",
        "engine": Engine(name="mujoco", version="4.0.0"),
        "metric_versions": given.versions,
        "definitions": "d" * 64,
        "runs_asked": len(given.runs),
        "plan_hash": "b",
    }
    identity = SweepIdentity(**{**told, **given.identity})
    runs = [run.model_copy(update={"metric_versions": given.versions}) for run in given.runs]
    shared = {name: getattr(record(0, "", 0.0), name) for name in SHARED_FIELDS}
    shared |= {"metric_versions": given.versions, "severity": list(SEVERITY)}
    with open_writer(path, identity, SceneFile(), fresh=False) as store:
        assert isinstance(store, StoreWriter)
        store.append_rows([json.dumps(record_to_row(run)).encode() for run in runs])
        store.finish_store(_columns(runs), shared, given.provenance)
    return path


def _columns(runs: Sequence[EvidenceRecord]) -> list[Any]:
    names = dict.fromkeys(name for run in runs for name in run.axes)
    axes = [axis_column(name, [run.axes.get(name) for run in runs], "", name) for name in names]
    metrics = [
        Column(name, REAL, unit, name, better, least, second_pass=name == "found")
        for name, (unit, better, least) in METRICS.items()
    ]
    first: Mapping[str, Any] = runs[0].settings if runs else {"cone": "elliptic"}
    return [
        *axes,
        *metrics,
        struct_column("settings", [first]),
        struct_column("effects", [{"refsafe": True}]),
    ]


def edit(store: Path, name: str, row: int, value: object) -> None:
    """Change one value of the table, its hash with it."""
    table = pq.read_table(store / "runs.parquet")
    values = table[name].to_pylist()
    values[row] = value
    place = table.schema.get_field_index(name)
    field = table.schema.field(name)
    changed = table.set_column(place, field, pa.array(values, field.type, from_pandas=False))
    if name == "trace_file":
        for other, first in (("trace_bytes", 1), ("trace_sha256", "0" * 64)):
            place = table.schema.get_field_index(other)
            known = pa.array([first, *[None] * (len(values) - 1)], table.schema.field(other).type)
            changed = changed.set_column(place, table.schema.field(other), known)
        substitute(store / "manifest.json", '"traces": 0', '"traces": 1')
    rewrite(store, changed)


def rewrite(store: Path, table: pa.Table) -> None:
    """Replace the table, its hash with it."""
    pq.write_table(table, store / "runs.parquet")
    rehash(store)


def without_metrics(table: pa.Table, *names: str) -> pa.Table:
    """Return a table as of a release without some metrics."""
    meta = dict(table.schema.metadata)
    shared = json.loads(meta[b"contactlab.shared"])
    for each in ("units", "metric_versions"):
        shared[each] = {name: value for name, value in shared[each].items() if name not in names}
    meta[b"contactlab.shared"] = json.dumps(shared).encode()
    return table.drop_columns([*names]).replace_schema_metadata(meta)


def rehash(store: Path) -> None:
    path = store / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["files"] = {name: sha256_of(store / name) for name in manifest["files"]}
    if (store / "sweep.json").is_file():
        manifest["sweep"] = json.loads((store / "sweep.json").read_text())
    path.write_text(json.dumps(manifest, indent=2))


def reshare(store: Path, name: str, value: object) -> None:
    """Change what all runs have in common."""
    table = pq.read_table(store / "runs.parquet")
    meta = dict(table.schema.metadata)
    shared = json.loads(meta[b"contactlab.shared"]) | {name: value}
    meta[b"contactlab.shared"] = json.dumps(shared).encode()
    rewrite(store, table.replace_schema_metadata(meta))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def substitute(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.fixture
def runs() -> Callable[[], Given]:
    """Return eight stable runs, to be changed."""
    return eight


@pytest.fixture
def many() -> Callable[[int], Given]:
    """Return so many stable runs, to be changed."""
    return lambda count: Given(
        [record(index, "elliptic", 1e-3 * (index + 1)) for index in range(count)]
    )


@pytest.fixture
def stored(tmp_path: Path) -> Callable[[str, Given], Path]:
    """Write a store of this name."""
    return lambda name, given: write(tmp_path / name, given)


@pytest.fixture
def baseline(tmp_path: Path) -> Path:
    """A store of eight stable runs."""
    return write(tmp_path / "baseline", eight())


@pytest.fixture(scope="session")
def tampering() -> SimpleNamespace:
    """Ways to change a stored store so that only what it holds is wrong, not its hashes."""
    return SimpleNamespace(
        edit=edit,
        rewrite=rewrite,
        without_metrics=without_metrics,
        rehash=rehash,
        reshare=reshare,
        cut=cut,
        substitute=substitute,
    )
