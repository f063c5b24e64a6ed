"""The package index is the user's: no file of the current folder, or above it, names another."""

import os
import shutil
import subprocess
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler
from importlib.metadata import version
from pathlib import Path
from socketserver import ThreadingTCPServer
from threading import Thread

import pytest

from contactlab.errors import EngineError
from contactlab.run import mujoco_environment
from contactlab.run.mujoco_environment import find_interpreter, make_environment
from contactlab.studies.lock import versions

ROOT = Path(__file__).parents[2]
OTHER = "3.17.0" if version("mujoco") != "3.17.0" else "3.16.0"


class Index:
    """A package index that has nothing, and keeps the addresses that were asked for."""

    def __init__(self) -> None:
        self.requests: list[str] = []
        index = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                index.requests.append(self.path)
                self.send_error(404)

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - its name
                pass

        # An HTTPServer would look for its own name first, which takes seconds without a network.
        self.server = ThreadingTCPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self.server.server_address[1]}/simple"


@contextmanager
def served_index() -> Generator[Index]:
    index = Index()
    with index.server:
        thread = Thread(target=index.server.serve_forever, args=(0.01,))
        thread.start()
        yield index
        index.server.shutdown()
        thread.join()


@pytest.fixture
def own() -> Iterator[Index]:
    with served_index() as index:
        yield index


@pytest.fixture
def planted() -> Iterator[Index]:
    with served_index() as index:
        yield index


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, planted: Index) -> Path:
    """A folder, and one above it: each file that an installer could read names an index."""
    folder = tmp_path / "stranger" / "inner"
    folder.mkdir(parents=True)
    table = f'[[index]]\nurl = "{planted.address}"\ndefault = true\n'
    pip = f"[global]\nindex-url = {planted.address}\nextra-index-url = {planted.address}\n"
    for place in (folder, folder.parent):
        project = f'[project]\nname = "x"\nversion = "1"\n{table.replace("index", "tool.uv.index")}'
        (place / "pyproject.toml").write_text(project)
        (place / "uv.toml").write_text(table)
        for name in ("pip.conf", "pip.ini", ".pip/pip.conf", ".config/pip/pip.conf"):
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_text(pip)
        (place / "setup.cfg").write_text(f"[easy_install]\nindex_url = {planted.address}\n")
        (place / ".env").write_text(f"UV_DEFAULT_INDEX={planted.address}\n")
        (place / ".python-version").write_text("2.7\n")
    monkeypatch.chdir(folder)
    for name in [*os.environ]:
        if name.startswith(("UV_", "PIP_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return folder


@pytest.fixture
def uv(monkeypatch: pytest.MonkeyPatch) -> str:
    """The real uv, with a cache of its own, as what it holds would be asked of no index."""
    path = os.pathsep.join([os.environ["PATH"], str(ROOT / ".uv" / "bin")])
    found = shutil.which("uv", path=path) or pytest.skip("uv is not installed")
    monkeypatch.setattr(mujoco_environment, "_find_uv", lambda: [found, "--no-cache"])
    return found


@pytest.mark.usefixtures("stranger")
def test_the_attack_reaches_an_installer_that_is_called_here(uv: str, planted: Index) -> None:
    """Otherwise, the other tests would show nothing."""
    command = [
        uv,
        "pip",
        "install",
        "--no-cache",
        "--dry-run",
        "--python",
        sys.executable,
        "absent",
    ]
    subprocess.run(command, capture_output=True, check=False)
    assert planted.requests


@pytest.mark.usefixtures("stranger", "uv")
def test_another_mujoco_is_asked_of_the_index_of_the_user(
    monkeypatch: pytest.MonkeyPatch, own: Index, planted: Index
) -> None:
    monkeypatch.setenv("UV_DEFAULT_INDEX", own.address)
    with pytest.raises(EngineError, match="cannot be installed"):
        find_interpreter(OTHER, lambda _: None)
    assert own.requests
    assert not planted.requests


@pytest.mark.usefixtures("stranger", "uv")
def test_an_engine_is_asked_of_the_index_of_the_user(
    tmp_path: Path, own: Index, planted: Index
) -> None:
    """One that a configuration of the user's own names, as uv reads it."""
    file = tmp_path / "config" / "uv" / "uv.toml"
    file.parent.mkdir(parents=True)
    file.write_text(f'[[index]]\nurl = "{own.address}"\ndefault = true\n')
    with pytest.raises(EngineError, match="cannot be installed"):
        make_environment(tmp_path / "cache" / "a", ["absent"], "an engine", "", lambda _: None)
    assert own.requests
    assert not planted.requests


@pytest.mark.usefixtures("stranger", "uv")
def test_a_configuration_that_the_user_names_wins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own: Index, planted: Index
) -> None:
    file = tmp_path / "named.toml"
    file.write_text(f'[[index]]\nurl = "{own.address}"\ndefault = true\n')
    monkeypatch.setenv("UV_CONFIG_FILE", str(file))
    with pytest.raises(EngineError, match="cannot be installed"):
        make_environment(tmp_path / "cache" / "a", ["absent"], "an engine", "", lambda _: None)
    assert own.requests
    assert not planted.requests


@pytest.mark.long
@pytest.mark.usefixtures("stranger")
def test_pip_asks_the_index_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own: Index, planted: Index
) -> None:
    monkeypatch.setattr(mujoco_environment, "_find_uv", lambda: None)
    monkeypatch.setenv("PIP_INDEX_URL", own.address)
    with pytest.raises(EngineError, match="cannot be installed"):
        make_environment(tmp_path / "cache" / "a", ["absent"], "an engine", "", lambda _: None)
    with pytest.raises(EngineError, match="list the releases"):
        versions.find_releases("3.9.0", "3.10.0")
    assert own.requests
    assert not planted.requests
