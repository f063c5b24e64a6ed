"""One sweep at a time writes a store in object storage; a lock that nobody holds hinders nobody."""

import logging
import subprocess
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from contactlab.errors import OutputError
from contactlab.store.objects.lease import LockHolder, StoreLease, hold_lease
from contactlab.store.store_files import LOCK, ObjectAddress, parse_address

if TYPE_CHECKING:
    from contactlab.store.objects.client import ObjectClient

Connect = Callable[[ObjectAddress], "ObjectClient"]


@pytest.fixture
def client(bucket: str, connect: Connect) -> "ObjectClient":
    address = parse_address(f"{bucket}/store")
    assert isinstance(address, ObjectAddress)
    return connect(address)


def holder_of(client: "ObjectClient") -> LockHolder:
    found = client.find_object(LOCK)
    assert found is not None
    holder = LockHolder.parse_holder(found.data)
    assert holder is not None
    return holder


def ended_process() -> int:
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def elsewhere(**changes: object) -> LockHolder:
    """Return a process of another machine."""
    plain = LockHolder.current_process().model_copy(update={"host": "far", "machine": "another"})
    return plain.model_copy(update=changes)


def test_a_second_sweep_is_refused(client: "ObjectClient") -> None:
    with (
        hold_lease(client),
        pytest.raises(OutputError, match=f"{client.address} is in use by process"),
        hold_lease(client),
    ):
        pass


def test_given_back(client: "ObjectClient") -> None:
    for _ in range(2):
        with hold_lease(client):
            assert not holder_of(client).released
        assert holder_of(client).released


def test_given_back_after_a_failure(client: "ObjectClient") -> None:
    with pytest.raises(ValueError, match="planted"), hold_lease(client):
        raise ValueError("planted")
    assert holder_of(client).is_gone


@pytest.mark.parametrize("case", ["ended", "another with its number"])
def test_of_a_dead_process_of_this_machine(client: "ObjectClient", case: str) -> None:
    """It is taken over at once: the lease is an hour."""
    this = LockHolder.current_process()
    changes = {"pid": ended_process()} if case == "ended" else {"started": this.started - 1}
    client.put_file(LOCK, this.model_copy(update=changes).to_json_bytes())
    with hold_lease(client, seconds=3600) as lease:
        lease.check_held()


def test_of_another_machine_is_waited_out(
    client: "ObjectClient", caplog: pytest.LogCaptureFixture
) -> None:
    """Whatever its process number: it is another machine's."""
    client.put_file(LOCK, elsewhere(pid=ended_process()).to_json_bytes())
    start = time.monotonic()
    with caplog.at_level(logging.WARNING), hold_lease(client, seconds=0.5) as lease:
        assert time.monotonic() - start >= 0.5
        lease.check_held()
    assert f"{client.address} is locked by a sweep on far; waiting" in caplog.text


def test_of_another_version_is_waited_out(client: "ObjectClient") -> None:
    client.put_file(LOCK, b'{"what": "is this"}')
    with hold_lease(client, seconds=0.2):
        pass


@pytest.mark.long
def test_of_another_machine_that_is_alive(client: "ObjectClient") -> None:
    """It shows signs of life; the wait ends with the first, however long the lease."""
    other = elsewhere()
    version = client.create_object(LOCK, other.to_json_bytes())
    assert version is not None
    lease = StoreLease(client, other, version, seconds=0.6)
    try:
        with pytest.raises(OutputError, match="in use by a sweep on far"), hold_lease(client, 30):
            pass
    finally:
        lease.release_lock()
    with hold_lease(client, 3600):
        pass


def test_lost(client: "ObjectClient") -> None:
    """Somebody else has waited it out: whoever notices writes no more."""
    taken = f"another sweep has taken over {client.address}"
    with hold_lease(client, seconds=3600) as lease:
        client.put_file(LOCK, elsewhere().to_json_bytes())
        for act in (lease.renew_lock, lease.check_held, lease.renew_lock):
            with pytest.raises(OutputError, match=taken):
                act()
    assert holder_of(client).host == "far"
    assert not holder_of(client).released


def test_one_of_many_gets_it(client: "ObjectClient", connect: Connect) -> None:
    """Eight threads want it at once, eight times; at no time do two of them hold it."""
    inside: list[int] = []
    most: list[int] = []

    def compete(number: int) -> None:
        own = connect(client.address)
        for _ in range(8):
            try:
                with hold_lease(own, seconds=60):
                    inside.append(number)
                    most.append(len(inside))
                    inside.remove(number)
            except OutputError:
                continue

    threads = [threading.Thread(target=compete, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(most) == {1}
