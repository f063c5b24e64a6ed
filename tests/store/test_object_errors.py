"""What goes wrong with an object storage is told in one message, soon, and leaves no traceback."""

import socket
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import timedelta
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

import pytest

from contactlab.errors import ContactlabError, OutputError, StoreError
from contactlab.store.finished_store import Store
from contactlab.store.store_files import Address, ObjectAddress, parse_address
from contactlab.store.store_writer import open_writer

pytestmark = pytest.mark.long

KEYS = "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION"


class Refusing(BaseHTTPRequestHandler):
    """A server that lets nobody in."""

    status = 403

    def _refuse(self) -> None:
        body = b"<Error>\n<Message>expecting the region eu-west-1</Message></Error>"
        self.send_response(self.status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    do_GET = do_PUT = do_POST = _refuse  # noqa: N815 - as the library calls them

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - as it is called
        """Keep quiet."""


class Misled(Refusing):
    """A server of another region."""

    status = 400


class Busy(Refusing):
    """A server that refuses the first three requests, and takes the next one."""

    requests = 0

    def do_PUT(self) -> None:
        type(self).requests += 1
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(503 if self.requests < 4 else 200)
        self.send_header("ETag", '"1"')
        self.send_header("Content-Length", "0")
        self.end_headers()


@contextmanager
def serving(handler: type[BaseHTTPRequestHandler]) -> Generator[int]:
    server = HTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@contextmanager
def listening(backlog: int = 16) -> Generator[int]:
    """Accept connections and never answer."""
    with socket.create_server(("127.0.0.1", 0), backlog=backlog) as server:
        yield server.getsockname()[1]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@pytest.fixture(params=["sweep", "read"])
def use(request: pytest.FixtureRequest, identity_of: Any, scene_file: Any) -> Any:
    """Return what a sweep, or a command that reads, does first, and the error that it makes."""

    def sweep(address: Address) -> None:
        with open_writer(address, identity_of(1), scene_file, fresh=False):
            pass

    if request.param == "sweep":
        return sweep, OutputError
    return Store.open, StoreError


Use = tuple[Callable[[Address], object], type[ContactlabError]]


def said(use: Use, address: str = "s3://bucket/store") -> str:
    act, kind = use
    with pytest.raises(kind) as raised:
        act(parse_address(address))
    text = str(raised.value)
    assert address in text
    assert "\n" not in text
    return text


def point_to(monkeypatch: pytest.MonkeyPatch, port: int) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")


@pytest.mark.usefixtures("object_server")
def test_no_such_bucket(use: Use) -> None:
    text = said(use, "s3://nowhere-at-all/store")
    assert text.endswith("there is no bucket s3://nowhere-at-all; create it, or name another")


@pytest.mark.usefixtures("object_server")
def test_no_credentials(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    assert said(use).endswith(f"no credentials; set {KEYS}")


@pytest.mark.usefixtures("object_server")
def test_no_access(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(Refusing) as port:
        point_to(monkeypatch, port)
        assert f"access is refused; check {KEYS}" in said(use)


@pytest.mark.usefixtures("object_server")
def test_in_the_servers_own_words(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(Misled) as port:
        point_to(monkeypatch, port)
        assert said(use).endswith(": expecting the region eu-west-1")


@pytest.mark.usefixtures("object_server")
def test_nobody_listens(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    point_to(monkeypatch, free_port())
    monkeypatch.setattr("contactlab.store.objects.client._RETRIES", 1)
    start = time.monotonic()
    assert "the server does not respond; check the network and AWS_ENDPOINT_URL" in said(use)
    assert time.monotonic() - start < 15


@pytest.mark.usefixtures("object_server")
def test_nobody_answers(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the patience of a second instead of twelve."""
    monkeypatch.setattr("contactlab.store.objects.client._READ_TIMEOUT", timedelta(seconds=1))
    with listening() as port:
        point_to(monkeypatch, port)
        start = time.monotonic()
        assert "the server does not respond" in said(use)
    assert time.monotonic() - start < 15


@pytest.mark.usefixtures("object_server")
def test_plain_http_is_not_taken_for_safe(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AWS_ALLOW_HTTP")
    assert "AWS_ALLOW_HTTP=true" in said(use)


def test_not_installed(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("backend", "client"):
        monkeypatch.delitem(sys.modules, f"contactlab.store.objects.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "obstore", None)
    act, _ = use
    with pytest.raises(OutputError) as raised:
        act(parse_address("s3://bucket/store"))
    assert str(raised.value) == (
        "a store at s3:// needs obstore, which is not installed; pip install 'obstore>=0.12'"
    )


@pytest.mark.usefixtures("object_server")
def test_a_failed_request_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("obstore")
    from contactlab.store.objects.client import ObjectClient  # noqa: PLC0415

    address = parse_address("s3://bucket/store")
    assert isinstance(address, ObjectAddress)
    with serving(Busy) as port:
        point_to(monkeypatch, port)
        ObjectClient(address, OutputError).put_file("name", b"content")
    assert Busy.requests == 4
