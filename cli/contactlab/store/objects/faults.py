"""What goes wrong with an object storage, in words: what, where, and what to do about it."""

import re
from collections.abc import Generator
from contextlib import contextmanager

from contactlab.errors import ContactlabError
from contactlab.store.address import ObjectAddress

_KEYS = {
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
    keys, endpoint = _KEYS[address.scheme], _ENDPOINTS[address.scheme]
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
    return f"cannot use {address}: no credentials; set {_KEYS[address.scheme]}"
