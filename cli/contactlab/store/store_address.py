"""Where a store lies: a folder of this machine, or a prefix of a bucket."""

import re
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import OutputError

SCHEMES = ("s3", "gs", "az")
_URL = re.compile(r"(?P<scheme>[a-z][a-z0-9+.-]*)://(?P<rest>.*)", re.DOTALL)


@dataclass(frozen=True)
class ObjectAddress:
    """A store, or something in it, in an object storage.

    Attributes:
        scheme: s3, gs or az.
        bucket: the bucket; for az, the container.
        prefix: where in the bucket, without slashes at its ends; not empty.
    """

    scheme: str
    bucket: str
    prefix: str

    @property
    def name(self) -> str:
        """The last part of it."""
        return self.prefix.rpartition("/")[2]

    def __truediv__(self, name: object) -> "ObjectAddress":
        return ObjectAddress(self.scheme, self.bucket, f"{self.prefix}/{name}")

    def __str__(self) -> str:
        return f"{self.scheme}://{self.bucket}/{self.prefix}"


Address = Path | ObjectAddress


def parse_address(text: str | Address) -> Address:
    """Return what an address means: `s3://bucket/prefix`, `gs://...`, `az://...`, or a path.

    Raises:
        OutputError: it is a URL, but none of a store.
    """
    if not isinstance(text, str):
        return text
    url = _URL.fullmatch(text)
    if url is None:
        return Path(text)
    if url["scheme"] not in SCHEMES:
        known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise OutputError(f"{text}: stores lie in a folder or at {known}")
    bucket, *parts = url["rest"].rstrip("/").split("/")
    if not bucket or not parts or not all(part not in {"", ".", ".."} for part in parts):
        raise OutputError(f"{text}: write {url['scheme']}://BUCKET/PREFIX, each part with a name")
    return ObjectAddress(url["scheme"], bucket, "/".join(parts))


def absolute_address(address: Address) -> Address:
    """Return an address that means the same in every folder of this machine."""
    return address.resolve() if isinstance(address, Path) else address
