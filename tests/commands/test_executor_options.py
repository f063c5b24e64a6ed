"""Options of where a sweep runs that do not go together, or lead nowhere."""

import socket
import sys
from typing import Any

import pytest


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--address", "auto"), "--address is for a cluster; add --executor ray"),
        (("--executor", "rya"), "no executor 'rya'; installed are local, ray, slurm"),
        (("--executor", "ray", "--workers", "0"), "--workers 0 runs in this process"),
    ],
)
def test_options_that_do_not_go_together(
    contactlab: Any, small: Any, options: tuple[str, ...], says: str
) -> None:
    code, out, err = contactlab("sweep", str(small), *options)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: {says}")


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("127.0.0.1:1", "no Ray cluster at 127.0.0.1:1: "),
        ("nowhere", "nowhere: write HOST:PORT of the cluster's head, or auto"),
        ("127.0.0.1:99999", "no Ray cluster at 127.0.0.1:99999: "),
        ("ray://127.0.0.1:10001", "ray://127.0.0.1:10001: the sweep must run on a node"),
    ],
)
def test_a_wrong_address(contactlab: Any, small: Any, address: str, says: str) -> None:
    pytest.importorskip("ray", reason="contactlab[ray] is not installed")
    code, out, err = contactlab("sweep", str(small), "--executor", "ray", "--address", address)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: {says}")
    assert len(err.splitlines()) == 1


@pytest.mark.long
def test_an_address_where_something_else_listens(
    contactlab: Any, small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ray", reason="contactlab[ray] is not installed")
    monkeypatch.setattr("contactlab.run.ray.connection._ANSWER_TIMEOUT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        code, out, err = contactlab("sweep", str(small), "--executor", "ray", "--address", address)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: no Ray cluster answers at {address} within 0.5 s")


def test_without_ray(contactlab: Any, small: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    code, out, err = contactlab("sweep", str(small), "--executor", "ray")
    assert (code, out) == (2, "")
    assert err.endswith("which is not installed; pip install 'ray>=2.60'\n")
