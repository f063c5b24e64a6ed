"""The operations that a store needs from object storage, with plain error messages.

It is imported only for stores in object storage, because obstore is an extra.
"""

import os
import re
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import obstore
from obstore.exceptions import (
    AlreadyExistsError,
    BaseError,
    GenericError,
    PermissionDeniedError,
    PreconditionError,
    UnauthenticatedError,
)
from obstore.store import AzureStore, GCSStore, ObjectStore, S3Store

from contactlab.errors import ContactlabError
from contactlab.store.store_files import MOST_DOCUMENT, ObjectAddress

if TYPE_CHECKING:
    from obstore import UpdateVersion
    from obstore.store import ClientConfig

_READ_TIMEOUT = timedelta(seconds=12)  # a request fails after this long without a byte
_RETRIES = 5
_PART_SIZE = 5 << 20  # larger objects are sent and received in parts of this size [bytes]

_STORE_CLASSES = {"s3": S3Store, "gs": GCSStore, "az": AzureStore}
_VARIABLE_PREFIXES = {"s3": "AWS", "gs": "GOOGLE", "az": "AZURE"}
_ENDPOINT_VARIABLES = {
    "s3": "AWS_ENDPOINT_URL",
    "gs": "GOOGLE_BASE_URL",
    "az": "AZURE_STORAGE_ENDPOINT",
}
_KEY_VARIABLES = {
    "s3": "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION",
    "gs": "GOOGLE_SERVICE_ACCOUNT",
    "az": "AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
}
_S3_CREDENTIALS = (
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_SKIP_SIGNATURE",
)
_TRUE_WORDS = {"1", "true", "yes", "on"}

# The library has one class for most errors; their text distinguishes them.
_STATUS_CODE = re.compile(r"status code: (\d{3})")
_METADATA_SERVICE = re.compile(
    r"169\.254\.169\.254|metadata\.google\.internal|Account must be specified"
)
_MESSAGE_TAG = re.compile(r"<Message>([^<\n]+)</Message>")
_NO_RESPONSE = "HTTP error"


class StoredObject(NamedTuple):
    """An object's content and its version."""

    data: bytes
    version: "UpdateVersion"


class ObjectClient:
    """Objects below an address, by their names relative to it; safe to use from threads.

    All methods raise an error of the given class if the server cannot be reached, refuses access,
    or has no such bucket.
    """

    def __init__(self, address: ObjectAddress, error: type[ContactlabError]) -> None:
        self.address = address
        self._error = error
        self._bucket_exists = False
        # The library would report these late, or unclearly.
        # Without the machine's credential service, only these variables can provide S3 credentials.
        disabled = _is_set("AWS_EC2_METADATA_DISABLED")
        if address.scheme == "s3" and disabled and not any(map(os.environ.get, _S3_CREDENTIALS)):
            raise error(_no_credentials(address))
        endpoint = _ENDPOINT_VARIABLES[address.scheme]
        allow = f"{_VARIABLE_PREFIXES[address.scheme]}_ALLOW_HTTP"
        if os.environ.get(endpoint, "").startswith("http://") and not _is_set(allow):
            raise error(
                f"cannot use {address}: {endpoint} is an http:// address; write https://, or set "
                f"{allow}=true if the network can be trusted"
            )
        with self._plain_errors(address):
            prefix = _VARIABLE_PREFIXES[address.scheme]
            options: ClientConfig = {
                "connect_timeout": timedelta(seconds=5),
                "read_timeout": _READ_TIMEOUT,
                # A part of a large file takes minutes on a slow line.
                "timeout": timedelta(minutes=10),
            }
            if _is_set(f"{prefix}_ALLOW_HTTP"):
                options["allow_http"] = True
            if proxy := os.environ.get(f"{prefix}_PROXY_URL"):
                options["proxy_url"] = proxy
            self.store: ObjectStore = _STORE_CLASSES[address.scheme](
                address.bucket,
                prefix=address.prefix,
                retry_config={
                    "max_retries": _RETRIES,
                    "retry_timeout": _READ_TIMEOUT,
                    "backoff": {"max_backoff": timedelta(seconds=2)},
                },
                client_options=options,
            )

    def put_file(self, name: str, data: bytes | memoryview | Path) -> None:
        """Create or replace an object as a whole, from bytes or a file."""
        with self._plain_errors(self.address / name):
            obstore.put(self.store, name, data, chunk_size=_PART_SIZE, max_concurrency=2)

    def create_object(
        self, name: str, data: bytes, over: "UpdateVersion | None" = None
    ) -> "UpdateVersion | None":
        """Create an object, or replace one that still has a version. Return its new version.

        It is None if another object with that name, or version, exists by now. An object with the
        same bytes counts as ours: the response to an earlier attempt was lost.
        """
        try:
            with self._plain_errors(self.address / name, missing_ok=over is not None):
                put_result = obstore.put(self.store, name, data, mode=over or "create")
                return _update_version(put_result["e_tag"], put_result["version"])
        except (AlreadyExistsError, PreconditionError, FileNotFoundError):
            stored_object = self.find_object(name)
            return stored_object.version if stored_object and stored_object.data == data else None

    def find_object(self, name: str) -> StoredObject | None:
        """Return an object; None if no object has that name."""
        try:
            with self._plain_errors(self.address / name, missing_ok=True):
                result = obstore.get(self.store, name)
                if (size := result.meta["size"]) > MOST_DOCUMENT:
                    raise ValueError(f"{name} has {size:,} bytes, more than {MOST_DOCUMENT:,}")
                version = _update_version(result.meta["e_tag"], result.meta["version"])
                return StoredObject(bytes(result.bytes()), version)
        except FileNotFoundError:
            self._check_bucket()
            return None

    def fetch_object(self, name: str, target: Path) -> bool:
        """Write an object into a file, part by part. Return whether the object exists."""
        try:
            with self._plain_errors(self.address / name, missing_ok=True):
                parts = obstore.get(self.store, name).stream(min_chunk_size=_PART_SIZE)
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("wb") as file:
                    for part in parts:
                        file.write(part)
        except FileNotFoundError:
            self._check_bucket()
            return False
        return True

    def list_sizes(self, folder: str | None = None) -> Iterator[tuple[str, int]]:
        """Yield name and size [bytes] of all objects, or of those in a folder."""
        with self._plain_errors(self.address):
            for batch in obstore.list(self.store, folder, chunk_size=1000):
                yield from ((entry["path"], entry["size"]) for entry in batch)

    def top_names(self) -> set[str]:
        """Return the names of the folders and objects right below the address."""
        with self._plain_errors(self.address):
            listing = obstore.list_with_delimiter(self.store)
        names = [*listing["common_prefixes"], *(entry["path"] for entry in listing["objects"])]
        return {name.strip("/") for name in names}

    def delete_files(self, names: Iterable[str]) -> None:
        """Delete objects; missing ones are ignored."""
        with suppress(FileNotFoundError), self._plain_errors(self.address, missing_ok=True):
            obstore.delete(self.store, list(names))

    def _check_bucket(self) -> None:
        """Check once that the bucket exists: otherwise all of its objects seem missing."""
        if not self._bucket_exists:
            self.top_names()
            self._bucket_exists = True

    @contextmanager
    def _plain_errors(self, address: ObjectAddress, *, missing_ok: bool = False) -> Generator[None]:
        """Convert the library's errors into one that the user can act on.

        Raises a FileNotFoundError if an object that may be missing is missing, but not the whole
        bucket; an AlreadyExistsError or PreconditionError if a condition of a write does not hold.
        """
        try:
            yield
        except (AlreadyExistsError, PreconditionError):
            raise
        except (BaseError, ValueError, OSError) as error:
            if missing_ok and isinstance(error, FileNotFoundError):
                raise
            raise self._error(_error_message(address, error)) from error


def _error_message(address: ObjectAddress, error: Exception) -> str:
    text = str(error)
    match = _STATUS_CODE.search(text)
    status = int(match[1]) if match else None
    keys, endpoint = _KEY_VARIABLES[address.scheme], _ENDPOINT_VARIABLES[address.scheme]
    if _METADATA_SERVICE.search(text):
        return _no_credentials(address)
    if isinstance(error, PermissionDeniedError | UnauthenticatedError) or status in {401, 403}:
        return f"cannot use {address}: access is refused; check {keys}, and their permissions"
    if status == 404:
        bucket = f"{address.scheme}://{address.bucket}"
        return f"cannot use {address}: there is no bucket {bucket}; create it, or name another"
    unreachable = isinstance(error, GenericError) and status is None and _NO_RESPONSE in text
    if unreachable or (status is not None and status >= 500):
        return (
            f"cannot reach {address}: the server does not respond; check the network and "
            f"{endpoint}, then run the same command again"
        )
    message = _MESSAGE_TAG.search(text)
    return f"cannot use {address}: {message[1] if message else text.partition(chr(10))[0]}"


def _no_credentials(address: ObjectAddress) -> str:
    return f"cannot use {address}: no credentials; set {_KEY_VARIABLES[address.scheme]}"


def _is_set(variable: str) -> bool:
    return os.environ.get(variable, "").lower() in _TRUE_WORDS


def _update_version(e_tag: str | None, version: str | None) -> "UpdateVersion":
    # A condition on a server without versions must not contain one.
    return {"e_tag": e_tag} if version is None else {"e_tag": e_tag, "version": version}
