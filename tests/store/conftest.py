"""Records made by hand, and stores of them with small traces, in folders and in a bucket."""

import contextlib
import hashlib
import json
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.written_traces import TraceExtras, write_trace

from contactlab.contact.trace_arrays import Trace, hash_of_states
from contactlab.schema.evidence import (
    Cost,
    Engine,
    EvidenceRecord,
    Host,
    InitialState,
    PairRecord,
    Provenance,
    StoreManifest,
    SweepIdentity,
    TraceFile,
)
from contactlab.store.store_files import ObjectAddress, parse_address
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import (
    REAL,
    SHARED_FIELDS,
    Column,
    axis_column,
    record_to_row,
    struct_column,
)

if TYPE_CHECKING:
    from contactlab.store.objects.client import ObjectClient

STEPS = 4
SCENE = "<mujoco/>"
SCENE_HASH = hashlib.sha256(f"scene.xml\0{len(SCENE)}\0{SCENE}".encode()).hexdigest()[:16]
TIMES = np.linspace(0, STEPS * 1e-3, STEPS + 1)
PROVENANCE = Provenance(
    contactlab="0.1.0",
    git_revision=None,
    python="3.11",
    numpy="2",
    host=Host(cpu_model="cpu", cpu_flags="f", cores=2, os="Linux"),
)
ENGINE = Engine(name="mujoco", version="4.0.0")
UNITS = {"depth": "m", "gain": "1"}


@dataclass
class SceneFile:
    """A scene of one file."""

    text: str = SCENE

    def copy_to(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.xml").write_text(self.text)


def make_record(index: int = 0, **changes: Any) -> EvidenceRecord:
    """Return the record of a stable run, and the changes."""
    plain = EvidenceRecord(
        run_id=f"{index:016x}",
        index=index,
        sweep="tried",
        scene="ball",
        scene_hash=SCENE_HASH,
        engine=ENGINE,
        axes={"timestep": 1e-3 * (index + 1)},
        settings={"timestep": 1e-3 * (index + 1), "cone": "elliptic", "solref": (0.02, 1.0)},
        effects={"refsafe": True},
        pairs={
            "floor-ball": PairRecord(
                condim=3,
                friction=(1, 1, 0.005, 1e-4, 1e-4),
                solref=(0.02, 1),
                solimp=(0.9, 0.95, 1e-3, 0.5, 2),
                margin=0,
                gap=0,
            )
        },
        edited_geoms=("ball",),
        seed=index,
        initial=InitialState(qpos=(0.0,), qvel=(0.0,)),
        duration=STEPS * 1e-3,
        status="ok",
        status_reason=None,
        steps=STEPS,
        steps_asked=STEPS,
        warnings={},
        metrics={"depth": 1e-3, "gain": None},
        metric_versions={"depth": 1, "gain": 1},
        units=UNITS,
        label="stable",
        labels=(),
        expected=None,
        expectation_met=None,
        expectation_reason=None,
        tolerances_met=None,
        trajectory_hash=hash_of_states(np.stack([TIMES, 0 * TIMES, 0 * TIMES], axis=1)),
        provenance=PROVENANCE,
        cost=Cost.of_steps(1.0, STEPS, 1e-3 * (index + 1), None),
        started="2026-01-01T00:00:00.000+00:00",
        finished="2026-01-01T00:00:01.000+00:00",
    )
    return plain.model_copy(update=changes)


def shared(record: EvidenceRecord) -> dict[str, Any]:
    """Return what a store keeps once for all of its runs."""
    return {name: getattr(record, name) for name in SHARED_FIELDS}


def columns(records: Sequence[EvidenceRecord]) -> list[Column]:
    """Return the columns of records beside the fixed ones."""
    names = dict.fromkeys(name for record in records for name in record.axes)
    axes = [
        axis_column(
            name,
            [record.axes[name] for record in records if name in record.axes],
            "s",
            f"what {name} is",
        )
        for name in names
    ]
    metrics = [Column(name, REAL, unit, f"what {name} is", "none") for name, unit in UNITS.items()]
    settings = {name: value for record in records for name, value in record.settings.items()}
    structs = [
        struct_column("settings", [settings]),
        struct_column("effects", [records[0].effects]),
    ]
    return [*axes, *metrics, *structs]


def identity(runs: int, **changes: Any) -> SweepIdentity:
    plain = SweepIdentity(
        name="tried",
        source="version: 1\n",
        overrides=(),
        resolved={},
        scene="ball",
        scene_hash=SCENE_HASH,
        scene_model="scene.xml",
        engine=ENGINE,
        metric_versions={"depth": 1, "gain": 1},
        definitions="d" * 64,
        runs_asked=runs,
        plan_hash=hashlib.sha256("".join(f"{i:016x}" for i in range(runs)).encode()).hexdigest()[
            :32
        ],
    )
    return plain.model_copy(update=changes)


def write_run(store: Path, record: EvidenceRecord) -> EvidenceRecord:
    """Write a run's trace, a body at rest, and return its record with it."""
    zeros = np.zeros((1, STEPS))
    counts = zeros.astype(np.int32)
    trace = Trace(
        timestep=np.full(1, 1e-3),
        steps_asked=STEPS,
        time=TIMES[None],
        qpos=np.zeros((1, STEPS + 1, 1)),
        qvel=np.zeros((1, STEPS + 1, 1)),
        kinetic=zeros,
        potential=zeros,
        contacts=counts,
        least_distance=zeros,
        iterations=counts,
        iterations_most=counts,
        momentum=None,
        angular_momentum=None,
        pairs=(),
        warnings=({},),
    )
    file = f"traces/{record.run_id[-2:]}/{record.run_id}.mcap"
    path = store / file
    path.parent.mkdir(parents=True, exist_ok=True)
    extras = TraceExtras(
        record.model_dump_json().encode(),
        {"activations": "0"},
        SCENE.encode(),
    )
    summary = write_trace(path, trace, 0, [], extras)
    stored = TraceFile(
        file=file, sha256=summary.sha256, bytes=summary.size, messages=dict(summary.messages)
    )
    return record.model_copy(update={"trace": stored})


def write_store(path: Path, records: Sequence[EvidenceRecord]) -> StoreManifest:
    """Write a store of runs with their traces; those that were lost left none."""
    lost = {"crashed", "timeout"}
    with open_writer(path, identity(len(records)), SceneFile(), fresh=False) as store:
        assert isinstance(store, StoreWriter)
        written = [each if each.status in lost else write_run(path, each) for each in records]
        store.append_rows([encode(record) for record in written])
        return store.finish_store(columns(records), shared(records[0]), PROVENANCE)


def encode(record: EvidenceRecord) -> bytes:
    """Return a record as a line of the journal."""
    return json.dumps(record_to_row(record)).encode()


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A sound store of three runs."""
    path = tmp_path / "store"
    write_store(path, [make_record(index) for index in range(3)])
    return path


@pytest.fixture(scope="session")
def store_of() -> Callable[[Path, Sequence[EvidenceRecord]], StoreManifest]:
    return write_store


@pytest.fixture(scope="session")
def record_of() -> Callable[..., EvidenceRecord]:
    return make_record


@pytest.fixture(scope="session")
def identity_of() -> Callable[..., SweepIdentity]:
    return identity


@pytest.fixture(scope="session")
def columns_of() -> Callable[..., list[Column]]:
    return columns


@pytest.fixture(scope="session")
def shared_part() -> Callable[..., dict[str, Any]]:
    return shared


@pytest.fixture(scope="session")
def scene_file() -> SceneFile:
    return SceneFile()


@pytest.fixture(scope="session")
def write_run_to() -> Callable[[Path, EvidenceRecord], EvidenceRecord]:
    return write_run


@pytest.fixture(params=["memory", pytest.param("server", marks=pytest.mark.long)])
def bucket(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The address of an empty bucket: in the memory of this process, and on a server."""
    if request.param == "server":
        return f"s3://{request.getfixturevalue('object_server').make_bucket()}"
    pytest.importorskip("obstore", reason="obstore is an extra")
    from obstore.store import MemoryStore  # noqa: PLC0415 - an extra

    from contactlab.store.objects import client  # noqa: PLC0415 - an extra

    stores: dict[tuple[str, str], MemoryStore] = {}

    def in_memory(bucket: str, *, prefix: str, **_: object) -> MemoryStore:
        return stores.setdefault((bucket, prefix), MemoryStore())

    monkeypatch.setitem(client._STORE_CLASSES, "s3", in_memory)  # pyright: ignore[reportPrivateUsage]
    for name in ("AWS_ENDPOINT_URL", "AWS_EC2_METADATA_DISABLED"):
        monkeypatch.delenv(name, raising=False)
    # What a process fetched of a store, it knows by the store's address.
    return f"s3://{uuid.uuid4().hex}"


@dataclass
class Kit:
    """An address, what is written there, and a client to look at it."""

    address: ObjectAddress
    folder: Path
    client: "ObjectClient"
    records: Sequence[EvidenceRecord]
    identity: Any
    finish: Callable[[StoreWriter], StoreManifest]
    scene: Any

    def opened(
        self, *, fresh: bool = False, retry_failed: bool = False
    ) -> contextlib.AbstractContextManager[StoreWriter | StoreManifest]:
        identity = self.identity(len(self.records))
        return open_writer(
            self.address, identity, self.scene, fresh=fresh, retry_failed=retry_failed
        )

    def add(self, store: StoreWriter | StoreManifest, *places: int) -> None:
        """Put traces, as a worker does, then rows."""
        assert isinstance(store, StoreWriter)
        for place in places:
            self.put_trace(place)
            store.append_rows([self.row(place)])

    def put_trace(self, place: int) -> None:
        trace = self.records[place].trace
        assert trace is not None
        self.client.put_file(trace.file, self.folder / trace.file)

    def row(self, place: int) -> bytes:
        return json.dumps(record_to_row(self.records[place])).encode()

    def write(self, *places: int, fresh: bool = False) -> StoreManifest:
        """Go on with some runs and finish."""
        with self.opened(fresh=fresh) as store:
            self.add(store, *places)
            assert isinstance(store, StoreWriter)
            return self.finish(store)

    def interrupt(self, *places: int) -> None:
        with contextlib.suppress(KeyboardInterrupt), self.opened() as store:
            self.add(store, *places)
            raise KeyboardInterrupt

    def done(self) -> frozenset[str]:
        """Return what a resumed sweep finds done, and leave it so."""
        with contextlib.suppress(KeyboardInterrupt), self.opened() as store:
            assert isinstance(store, StoreWriter)
            found = store.done
            raise KeyboardInterrupt
        return found  # pyright: ignore[reportPossiblyUnboundVariable]

    def ids(self, *places: int) -> set[str]:
        return {self.records[place].run_id for place in places}

    def names(self) -> set[str]:
        return {name for name, _ in self.client.list_sizes()}


@pytest.fixture
def kit(  # noqa: PLR0917 - one a fixture
    bucket: str,
    connect: "Callable[[ObjectAddress], ObjectClient]",
    tmp_path: Path,
    record_of: Any,
    identity_of: Any,
    columns_of: Any,
    shared_part: Any,
    scene_file: Any,
    write_run_to: Any,
) -> Kit:
    address = parse_address(f"{bucket}/some/store")
    assert isinstance(address, ObjectAddress)
    records = [write_run_to(tmp_path / "made", record_of(index)) for index in range(3)]

    def finish(store: StoreWriter) -> StoreManifest:
        provenance = records[0].provenance
        return store.finish_store(columns_of(records), shared_part(records[0]), provenance)

    client = connect(address)
    return Kit(address, tmp_path / "made", client, records, identity_of, finish, scene_file)
