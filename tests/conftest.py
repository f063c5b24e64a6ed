"""What all tests share."""

import logging
import os
import runpy
import signal
import threading
import urllib.request
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from contactlab.run.sweep_request import SweepRequest
    from contactlab.run.tasks import FinishedRun
    from contactlab.schema.evidence import StoreManifest
    from contactlab.store.objects.client import ObjectClient
    from contactlab.store.store_files import ObjectAddress

# A busy machine is no defect of the code under test. HYPOTHESIS_PROFILE=thorough, as in `make
# test-night`, looks at three times as many examples; brief, as in `make test-lowest`, at a third.
settings.register_profile("brief", deadline=None, max_examples=10)
settings.register_profile("patient", deadline=None, max_examples=30)
settings.register_profile("thorough", deadline=None, max_examples=100)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "patient"))

# A shell makes what it runs in the background deaf to Ctrl-C, and all that is started from there.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and (
    threading.current_thread() is threading.main_thread()
):
    signal.signal(signal.SIGINT, signal.default_int_handler)


# CPU time that a test of the first tier should take at most, with its fixtures and the processes
# that it waits for [s]; `make test` would lose its two minutes one test at a time. What takes
# longer is named at the end and fails nothing: a busy machine needs twice the time for it.
FIRST_TIER_SECONDS = 1.5
_SLOW = "seconds of CPU above a first tier's"
_LATER_TIERS = ("long", "night", "timed")
FEW = 2
"""Cases of a test that are run where few are asked for."""

BALL = """
version: 1
scene: ball_drop
duration: 0.3
seeds: 3
axes:
  timestep: [1.0e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.1]
"""
# What depends on the clock, not on the run.
CLOCK = {"started", "finished", "compile_time"}
COSTS = ("cost_", "time_", "step_p")


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of the children that it has waited for [s]."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what `make test-lowest` asks for: interfaces of libraries, not laws once more."""
    parser.addoption(
        "--few-cases",
        action="store_true",
        help=f"run {FEW} cases of a test, and all of what is marked `interface`",
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files of thousands of tests for the night, unless they are asked for."""
    if collection_path.name.endswith("_at_night.py") and "not night" in config.option.markexpr:
        return True
    return None


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the later cases of a test, where few are asked for."""
    if not config.getoption("few_cases"):
        return
    cases = Counter[str]()
    few, others = list[pytest.Item](), list[pytest.Item]()
    for item in items:
        test, *_ = item.nodeid.split("[")
        cases[test] += 1
        wanted = cases[test] <= FEW or item.get_closest_marker("interface")
        (few if wanted else others).append(item)
    items[:] = few
    config.hook.pytest_deselected(items=others)


_cpu_at_start = pytest.StashKey[float]()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """Note the CPU time before a test's fixtures are made; the first test pays no imports."""
    import scipy.stats  # noqa: F401, PLC0415 # pyright: ignore[reportUnusedImport]
    from hypothesis import strategies as st  # noqa: PLC0415 - as above

    import contactlab.run.sweep_runner  # noqa: F401, PLC0415 # pyright: ignore[reportUnusedImport]

    # In a fresh clone, Hypothesis makes its table of characters when it first needs one.
    st.text().validate()
    item.stash[_cpu_at_start] = _cpu_seconds()
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Note how long a test of the first tier took that takes longer than such a test should."""
    result = yield
    spent = _cpu_seconds() - item.stash[_cpu_at_start]
    if spent > FIRST_TIER_SECONDS and not any(map(item.get_closest_marker, _LATER_TIERS)):
        item.user_properties.append((_SLOW, spent))
    return result


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the tests of the first tier that belong into a later one."""
    slow = {
        report.nodeid: properties[_SLOW]
        for report in terminalreporter.getreports("passed")
        if report.when == "call" and _SLOW in (properties := dict(report.user_properties))
    }
    if slow:
        terminalreporter.section(f"over {FIRST_TIER_SECONDS:g} s of CPU: make smaller, or `long`")
        for test in sorted(slow, key=slow.__getitem__, reverse=True):
            terminalreporter.line(f"{slow[test]:.1f} s  {test}")


@pytest.fixture(scope="session", autouse=True)
def _compiler_or_none() -> None:
    """Ask for no functions in C where there is no compiler: sweeps would say so beside all else."""
    from tests.compilers import has_compiler  # noqa: PLC0415 - as below

    if not has_compiler():
        os.environ["CONTACTLAB_KERNEL"] = "off"


@pytest.fixture
def _registries_restored() -> Iterator[None]:
    """Forget after the test what it adds to registries."""
    from contactlab.registry import REGISTRIES  # noqa: PLC0415 - as below

    before = [(registry, dict(registry)) for registry in REGISTRIES.values()]
    yield
    for registry, entries in before:
        registry.clear()
        registry.update(entries)


@dataclass
class ObjectServer:
    """A server that speaks as S3 does, on a port of this machine."""

    server: Any
    port: int

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def make_bucket(self) -> str:
        """Return the name of a new bucket."""
        name = f"bucket-{uuid.uuid4().hex[:12]}"
        asked = urllib.request.Request(f"{self.url}/{name}", method="PUT")  # noqa: S310 - our own
        urllib.request.urlopen(asked, timeout=10).close()  # noqa: S310
        return name


class OneByOne:
    """Answers one request after another: moto looks at a condition and writes in two steps."""

    def __init__(self, app: Callable[..., Any]) -> None:
        self._app = app
        self._turn = threading.Lock()

    def __call__(self, *request: Any) -> Any:
        with self._turn:
            return self._app(*request)


def outcome_of(store: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return a store's table without costs and clock, and its traces' bytes by path."""
    import pyarrow.parquet as pq  # noqa: PLC0415 - collection is quick without

    table = pq.read_table(store / "runs.parquet")
    lasting = [
        name for name in table.column_names if name not in CLOCK and not name.startswith(COSTS)
    ]
    traces = {
        path.relative_to(store).as_posix(): path.read_bytes()
        for path in (store / "traces").rglob("*.mcap")
    }
    return table.select(lasting).to_pydict(), traces


class Sweeper:
    """Runs sweep texts into stores below one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(
        self,
        text: str,
        name: str = "store",
        workers: int = 0,
        progress: "Callable[[Sequence[FinishedRun]], None]" = lambda _: None,
        *,
        repair: bool = False,
    ) -> "StoreManifest":
        from contactlab.run.sweep_runner import run_sweep  # noqa: PLC0415 - as below

        self.began: list[tuple[int, int]] = []
        return run_sweep(
            replace(self.ask(text, name, workers), repair=repair),
            begin=lambda total, done, *_: self.began.append((total, done)),
            progress=progress,
        )

    def ask(self, text: str, name: str = "store", workers: int = 0) -> "SweepRequest":
        from contactlab.run.sweep_request import (  # noqa: PLC0415 - collection is quick without
            read_request,
        )

        store = self.folder / name
        return read_request(text, "small", store, folder=self.folder, workers=workers)

    def rows(self, name: str = "store") -> list[dict[str, Any]]:
        import pyarrow.parquet as pq  # noqa: PLC0415 - as above

        return pq.read_table(self.folder / name / "runs.parquet").to_pylist()

    def outcome(self, name: str = "store") -> tuple[dict[str, Any], dict[str, bytes]]:
        return outcome_of(self.folder / name)


@pytest.fixture
def sweeper(tmp_path: Path) -> Sweeper:
    return Sweeper(tmp_path)


@pytest.fixture(scope="session")
def make_sweeper() -> Callable[[Path], Sweeper]:
    """Return a maker of sweepers, for sweeps that several tests look at."""
    return Sweeper


@pytest.fixture(scope="session")
def outcome() -> Callable[[Path], tuple[dict[str, Any], dict[str, bytes]]]:
    return outcome_of


@pytest.fixture(scope="session")
def ball() -> str:
    return BALL


@pytest.fixture(scope="session")
def _object_server() -> Iterator[ObjectServer]:
    pytest.importorskip("obstore", reason="obstore is an extra")
    moto = pytest.importorskip("moto.server", reason="moto is needed to test object stores")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    plain = moto.DomainDispatcherApplication
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(moto, "DomainDispatcherApplication", lambda *of: OneByOne(plain(*of)))
        server.start()
    _, port = server.get_host_and_port()
    yield ObjectServer(server, port)
    server.stop()


@pytest.fixture
def object_server(_object_server: ObjectServer, monkeypatch: pytest.MonkeyPatch) -> ObjectServer:
    """The server, which the environment leads to."""
    environment = {
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": _object_server.url,
        "AWS_ALLOW_HTTP": "true",
        "AWS_EC2_METADATA_DISABLED": "true",
    }
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    return _object_server


@pytest.fixture
def connect() -> "Callable[[ObjectAddress], ObjectClient]":
    """Return a function that makes a client of an address in object storage."""
    pytest.importorskip("obstore", reason="obstore is an extra")
    from contactlab.errors import OutputError  # noqa: PLC0415 - an extra
    from contactlab.store.objects.client import ObjectClient  # noqa: PLC0415 - an extra

    return lambda address: ObjectClient(address, OutputError)


@pytest.fixture
def bucket(object_server: ObjectServer) -> str:
    """The address of an empty bucket on the server."""
    return f"s3://{object_server.make_bucket()}"


@pytest.fixture(scope="session")
def make_trace() -> Callable[..., Any]:
    """Return a function that makes a random trace and the series of its pairs."""
    return runpy.run_path(str(Path(__file__).with_name("random_traces.py")))["random_trace"]


@pytest.fixture(scope="session")
def extras() -> Any:
    """What a trace file holds beside the arrays."""
    from tests.written_traces import TraceExtras  # noqa: PLC0415 - collection is quick without

    return TraceExtras(
        record_json=b'{"run_id": "r1", "label": "stable", "metrics": {"penetration": 1e-4}}',
        metadata={"run_id": "r1", "seed": "0", "unité": "m/s²"},
        model_xml=b"<mujoco><worldbody/></mujoco>",
    )
