"""Addresses of stores: a local folder, or a prefix in object storage."""

import re
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import OutputError

SCHEMES = ("s3", "gs", "az")
# NAME:SECRET@HOST, and the parameters of signed addresses.
_CREDENTIALS = re.compile(r"^[^/]*@|\?.*(key|secret|token|sig)", re.IGNORECASE | re.DOTALL)
_URL = re.compile(r"(?P<scheme>[a-z][a-z0-9+.-]*)://(?P<rest>.*)", re.DOTALL)


@dataclass(frozen=True)
class ObjectAddress:
    """A store in object storage, or an object in it."""

    scheme: str  # s3, gs or az
    bucket: str  # the bucket; for az, the container
    prefix: str  # key prefix in the bucket, without leading or trailing slashes; not empty

    @property
    def name(self) -> str:
        """The last part of the prefix."""
        return self.prefix.rpartition("/")[2]

    def __truediv__(self, name: object) -> "ObjectAddress":
        return ObjectAddress(self.scheme, self.bucket, f"{self.prefix}/{name}")

    def __str__(self) -> str:
        return f"{self.scheme}://{self.bucket}/{self.prefix}"


Address = Path | ObjectAddress


def parse_address(text: str | Address) -> Address:
    """Return the address of a store: `s3://bucket/prefix`, `gs://...`, `az://...`, or a path.

    Raises an OutputError if it is a URL, but not of a store, or it holds credentials.
    """
    if not isinstance(text, str):
        return text
    url = _URL.fullmatch(text)
    if url is None:
        return Path(text)
    if _CREDENTIALS.search(url["rest"]):
        # The text is not repeated: it would stand in the logs of CI jobs.
        raise OutputError(
            f"the {url['scheme']}:// address holds credentials; write it without them, and set the "
            "environment variables of the provider (see docs/stores.md)"
        )
    if url["scheme"] not in SCHEMES:
        known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise OutputError(f"{text}: a store is a folder or an address with {known}")
    bucket, *parts = url["rest"].rstrip("/").split("/")
    if not bucket or not parts or not all(part not in {"", ".", ".."} for part in parts):
        raise OutputError(f"{text}: write {url['scheme']}://BUCKET/PREFIX, without empty parts")
    return ObjectAddress(url["scheme"], bucket, "/".join(parts))
