"""What lies in a bucket beside what a manifest names, for those who check a store."""

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

from contactlab.errors import StoreError
from contactlab.store.objects.fetching import checked
from contactlab.store.objects.object_client import connect
from contactlab.store.objects.resuming import FOUND, ROWS
from contactlab.store.store_address import ObjectAddress
from contactlab.store.store_writer import TRACES

_THREADS = 8
_AHEAD = 16
"""Traces that are fetched before they are asked for."""


class ObjectHoldings:
    """The traces and leftovers of a store in object storage; see `Holdings`."""

    def __init__(self, address: ObjectAddress) -> None:
        self._address = address
        self._client = connect(address, StoreError)

    @cached_property
    def _sizes(self) -> dict[str, int]:
        return dict(self._client.sizes(TRACES))

    def size(self, name: str) -> int | None:
        """Return how large a trace is [bytes]; None if there is none."""
        return self._sizes.get(name)

    def traces(self) -> list[str]:
        """Return the names of all traces."""
        return sorted(self._sizes)

    def leftovers(self) -> list[str]:
        """Return the names of what an interrupted write left."""
        return sorted(name for folder in (ROWS, FOUND) for name, _ in self._client.sizes(folder))

    def files(self, names: Iterable[str]) -> Iterator[Path | None]:
        """Yield a file with each trace, which is there until the next one; None if it is missing.

        Some are fetched ahead, so that a far bucket is not waited for again and again.
        """
        coming: deque[Future[Path | None]] = deque()
        with (
            TemporaryDirectory(prefix="contactlab-") as folder,
            ThreadPoolExecutor(_THREADS) as pool,
        ):
            for number, name in enumerate(names):
                target = Path(folder) / str(number)
                coming.append(pool.submit(self._fetched, checked(name, self._address), target))
                if len(coming) > _AHEAD:
                    yield from _first(coming)
            while coming:
                yield from _first(coming)

    def _fetched(self, name: str, target: Path) -> Path | None:
        return target if self._client.fetch(name, target) else None


def _first(coming: deque[Future[Path | None]]) -> Iterator[Path | None]:
    path = coming.popleft().result()
    yield path
    if path is not None:
        path.unlink()
