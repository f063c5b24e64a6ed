"""What goes wrong with an object storage, in words: what, where, and what to do about it."""

import os
import re
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from contactlab.errors import ContactlabError, optional
from contactlab.store.store_address import ObjectAddress

if TYPE_CHECKING:
    from obstore.store import ObjectStore

_KEY_VARIABLES = {
    "s3": "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION",
    "gs": "GOOGLE_SERVICE_ACCOUNT",
    "az": "AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
}
_ENDPOINTS = {
    "s3": "AWS_ENDPOINT_URL",
    "gs": "GOOGLE_BASE_URL",
    "az": "AZURE_STORAGE_ENDPOINT",
}
_ALLOWING = {"s3": "AWS_ALLOW_HTTP", "gs": "GOOGLE_ALLOW_HTTP", "az": "AZURE_ALLOW_HTTP"}
# Where clients look for credentials that the environment does not give.
_CREDENTIALS = re.compile(
    r"169\.254\.169\.254|metadata\.google\.internal|metadata/identity|account must be specified",
    re.IGNORECASE,
)
_NO_BUCKET = re.compile(
    r"NoSuchBucket|bucket does not exist|ContainerNotFound|container does not exist",
    re.IGNORECASE,
)
_REFUSED = re.compile(r"\b40[13] (Unauthorized|Forbidden)|AccessDenied|InvalidAccessKeyId")
_AWAY = re.compile(r"error sending request|HTTP error|timed out|\b50[0-9] ", re.IGNORECASE)
_MESSAGE = re.compile(r"<Message>([^<\n]+)</Message>")
_PLAIN = re.compile(r"BadScheme|builder error")


@contextmanager
def told(address: ObjectAddress, kind: type[ContactlabError]) -> Generator[None]:
    """Turn what the library raises into an error that a user can act on.

    Raises:
        FileNotFoundError: there is no such object, in a bucket that there is.
        AlreadyExistsError: a condition does not hold, of the library's own; likewise
            PreconditionError.
    """
    from obstore.exceptions import (  # noqa: PLC0415 - an extra
        AlreadyExistsError,
        BaseError,
        PreconditionError,
    )

    try:
        yield
    except (AlreadyExistsError, PreconditionError):
        raise
    except FileNotFoundError as error:
        if _NO_BUCKET.search(str(error)):
            raise kind(reason(address, str(error))) from error
        raise
    except (BaseError, ValueError, OSError) as error:
        raise kind(reason(address, str(error))) from error


def reason(address: ObjectAddress, said: str) -> str:
    """Return what to tell of an error.

    Args:
        address: what was to be reached.
        said: the library's words.
    """
    bucket = f"{address.scheme}://{address.bucket}"
    keys, endpoint = _KEY_VARIABLES[address.scheme], _ENDPOINTS[address.scheme]
    if _NO_BUCKET.search(said):
        return f"cannot use {address}: there is no bucket {bucket}; make it, or name another"
    if _CREDENTIALS.search(said):
        return no_credentials(address)
    if _REFUSED.search(said):
        return f"cannot use {address}: access is refused; check {keys}, and what they may do there"
    if _PLAIN.search(said):
        return (
            f"cannot use {address}: {endpoint} is an http:// address; write https://, or set "
            f"{_ALLOWING[address.scheme]}=true if all between here and there can be trusted"
        )
    if _AWAY.search(said):
        return (
            f"cannot reach {address}: the server does not answer; check the network and "
            f"{endpoint}, then run the same command again"
        )
    own = _MESSAGE.search(said)
    first = said.partition("\n")[0]
    return f"cannot use {address}: {own[1] if own else first}"


def no_credentials(address: ObjectAddress) -> str:
    """Return what to tell who has no credentials."""
    return f"cannot use {address}: no credentials; set {_KEY_VARIABLES[address.scheme]}"


# A request fails after this long without a byte, so that nobody waits for a server that is away.
_SILENCE = timedelta(seconds=12)
_CONNECTING = timedelta(seconds=5)
_WHOLE = timedelta(minutes=10)
_RETRIES = 5
# One request moves so much at most; larger objects go in parts.
_PART = 5 << 20
_STORES = {"s3": "S3Store", "gs": "GCSStore", "az": "AzureStore"}
_PREFIXES = {"s3": "AWS", "gs": "GOOGLE", "az": "AZURE"}

_AT_ONCE = 1000
_YES = {"1", "true", "yes", "on"}
_KEYS = (
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_SKIP_SIGNATURE",
)

ObjectVersion = dict[str, str]
"""What tells one state of an object from another: its ETag, and its version where there is one."""


class StoredObject(NamedTuple):
    """An object's bytes and which state of it they are."""

    data: bytes
    version: ObjectVersion


def connect(address: ObjectAddress, kind: type[ContactlabError]) -> "ObjectClient":
    """Return a client for all objects below an address; make it in the process that uses it.

    Args:
        address: where they lie.
        kind: what is raised when something goes wrong.

    Raises:
        OutputError: the library is not installed.
    """
    with optional("objects", f"a store at {address.scheme}://"):
        from obstore import store as library  # noqa: PLC0415 - an extra
    if address.scheme == "s3" and _has_no_keys():
        raise kind(no_credentials(address))
    with told(address, kind):
        store: ObjectStore = getattr(library, _STORES[address.scheme])(
            address.bucket,
            prefix=address.prefix,
            retry_config={
                "max_retries": _RETRIES,
                "retry_timeout": _SILENCE,
                "backoff": {"max_backoff": timedelta(seconds=2)},
            },
            client_options=_options(_PREFIXES[address.scheme]),
        )
        return ObjectClient(address, store, kind)


def _options(prefix: str) -> Any:  # noqa: ANN401 - a dictionary type of the extra's
    """Return how requests are made; what the environment says of it has to be handed on."""
    options: dict[str, Any] = {
        "connect_timeout": _CONNECTING,
        "read_timeout": _SILENCE,
        "timeout": _WHOLE,
    }
    if os.environ.get(f"{prefix}_ALLOW_HTTP", "").lower() in _YES:
        options["allow_http"] = True
    if proxy := os.environ.get(f"{prefix}_PROXY_URL"):
        options["proxy_url"] = proxy
    return options


def _has_no_keys() -> bool:
    """Tell whether only the machine's own service could give keys, and must not be asked."""
    alone = os.environ.get("AWS_EC2_METADATA_DISABLED", "").lower() in _YES
    return alone and not any(map(os.environ.get, _KEYS))


class ObjectClient:
    """Objects below an address, by their names relative to it; safe to use from threads.

    Every method raises the kind of error that `connect` was told, where the server is away, does
    not let us, or has no such bucket.

    Attributes:
        address: where they lie.
        store: the library's own client.
    """

    def __init__(
        self, address: ObjectAddress, store: "ObjectStore", kind: type[ContactlabError]
    ) -> None:
        self.address = address
        self.store = store
        self._kind = kind

    def put(self, name: str, data: bytes | memoryview | Path) -> None:
        """Make or replace an object as a whole, from bytes or a file."""
        import obstore  # noqa: PLC0415 - an extra

        with told(self.address / name, self._kind):
            obstore.put(self.store, name, data, chunk_size=_PART, max_concurrency=2)

    def create(self, name: str, data: bytes) -> ObjectVersion | None:
        """Make an object, and return its version; None if there is another one of that name.

        One that has the same bytes is taken for ours, whose answer was lost on the way.
        """
        from obstore.exceptions import AlreadyExistsError  # noqa: PLC0415 - an extra

        try:
            return self._put_if(name, data, "create")
        except AlreadyExistsError:
            there = self.find(name)
            return there.version if there and there.data == data else None

    def replace(self, name: str, data: bytes, version: ObjectVersion) -> ObjectVersion | None:
        """Replace an object that is still at a version; None if it is at another one."""
        from obstore.exceptions import PreconditionError  # noqa: PLC0415 - an extra

        try:
            return self._put_if(name, data, version)
        except (PreconditionError, FileNotFoundError):
            there = self.find(name)
            return there.version if there and there.data == data else None

    def _put_if(self, name: str, data: bytes, mode: Any) -> ObjectVersion:  # noqa: ANN401 - see `put`
        import obstore  # noqa: PLC0415 - an extra

        with told(self.address / name, self._kind):
            return _version(obstore.put(self.store, name, data, mode=mode))

    def find(self, name: str) -> StoredObject | None:
        """Return an object; None if there is none of that name."""
        import obstore  # noqa: PLC0415 - an extra

        try:
            with told(self.address / name, self._kind):
                got = obstore.get(self.store, name)
                return StoredObject(bytes(got.bytes()), _version(got.meta))
        except FileNotFoundError:
            return None

    def fetch(self, name: str, target: Path) -> bool:
        """Write an object into a file, piece by piece; return whether there is one."""
        import obstore  # noqa: PLC0415 - an extra

        try:
            with told(self.address / name, self._kind):
                pieces = obstore.get(self.store, name).stream(min_chunk_size=_PART)
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("wb") as file:
                    for piece in pieces:
                        file.write(piece)
        except FileNotFoundError:
            return False
        return True

    def sizes(self, folder: str | None = None) -> Iterator[tuple[str, int]]:
        """Yield name and size [bytes] of all objects, or of those in a folder."""
        import obstore  # noqa: PLC0415 - an extra

        with told(self.address, self._kind):
            for batch in obstore.list(self.store, folder, chunk_size=1000):
                yield from ((each["path"], each["size"]) for each in batch)

    def top(self) -> set[str]:
        """Return the names of the folders and objects that lie right at the address."""
        import obstore  # noqa: PLC0415 - an extra

        with told(self.address, self._kind):
            found = obstore.list_with_delimiter(self.store)
        names = [*found["common_prefixes"], *(each["path"] for each in found["objects"])]
        return {name.strip("/") for name in names}

    def delete(self, names: Iterable[str]) -> None:
        """Delete objects; those that are not there are no error."""
        import obstore  # noqa: PLC0415 - an extra

        left = list(names)
        while some := left[:_AT_ONCE]:
            del left[:_AT_ONCE]
            with suppress(FileNotFoundError), told(self.address, self._kind):
                obstore.delete(self.store, some)


def _version(meta: Any) -> ObjectVersion:  # noqa: ANN401 - a dictionary type of the extra's
    return {key: meta[key] for key in ("e_tag", "version") if meta[key] is not None}
