"""Small objects on their way: a far bucket must not hold up who makes them."""

import uuid
from collections import deque
from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

from contactlab.errors import OutputError
from contactlab.store.objects.object_client import ObjectClient

_THREADS = 8
_MOST = 64
"""Objects that may be on their way at once."""


class Outbox:
    """Puts objects of unique names in the background, so many at a time."""

    def __init__(self, client: ObjectClient) -> None:
        self._client = client
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="outbox")
        self._sent: deque[Future[None]] = deque()
        self._author = uuid.uuid4().hex
        self._count = 0

    def send(self, folder: str, data: bytes) -> None:
        """Put an object of a new name into a folder; waits while too many are on their way.

        Raises:
            OutputError: it, or one before it, cannot be put.
        """
        name = f"{folder}/{self._author}-{self._count:08d}.jsonl"
        self._count += 1
        with self._dropping():
            while self._sent and (len(self._sent) >= _MOST or self._sent[0].done()):
                self._sent.popleft().result()
        self._sent.append(self._pool.submit(self._put, name, data))

    def close(self) -> None:
        """Wait until all objects are there, and end.

        Raises:
            OutputError: one cannot be put; the others still on their way are given up.
        """
        with self._dropping():
            while self._sent:
                self._sent.popleft().result()
        self._pool.shutdown()

    @contextmanager
    def _dropping(self) -> Generator[None]:
        """Give up what is not on its way yet, where something goes wrong."""
        try:
            yield
        except BaseException:
            self._sent.clear()
            self._pool.shutdown(cancel_futures=True)
            raise

    def _put(self, name: str, data: bytes) -> None:
        if self._client.create(name, data) is None:
            raise OutputError(f"{self._client.address / name} is there already, as another object")
