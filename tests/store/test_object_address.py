"""Addresses of stores: what they mean, what they are not, and which storage they lead to."""

import pickle
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.errors import OutputError
from contactlab.plugins import find_extensions
from contactlab.store.store_files import ObjectAddress, parse_address

pytestmark = pytest.mark.long

NAMES = st.text("abcdefghij0123456789-_. ", min_size=1, max_size=12).filter(
    lambda name: name not in {".", ".."}
)


@given(
    st.sampled_from(sorted(find_extensions("store"))),
    NAMES,
    st.lists(NAMES, min_size=1, max_size=4),
)
def test_text_and_back(scheme: str, bucket: str, parts: list[str]) -> None:
    text = f"{scheme}://{bucket}/{'/'.join(parts)}"
    address = parse_address(text)
    assert address == ObjectAddress(scheme, bucket, "/".join(parts))
    assert str(address) == text
    assert parse_address(text + "/") == address
    assert parse_address(address) == address
    assert address.name == parts[-1]
    assert str(address / "runs.parquet") == f"{text}/runs.parquet"
    assert pickle.loads(pickle.dumps(address)) == address  # noqa: S301 - our own


@pytest.mark.parametrize("text", ["results/bounce", "/a/b", ".", "../s3"])
def test_paths_stay_paths(text: str) -> None:
    assert parse_address(text) == Path(text)


def test_a_path_with_a_colon_is_no_url() -> None:
    assert parse_address("a:b/c") == Path("a:b/c").absolute()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("s3://", "BUCKET/PREFIX"),
        ("s3://bucket", "BUCKET/PREFIX"),
        ("s3://bucket/", "BUCKET/PREFIX"),
        ("s3:///prefix", "BUCKET/PREFIX"),
        ("s3://bucket/a//b", "BUCKET/PREFIX"),
        ("gs://bucket/../b", "BUCKET/PREFIX"),
        ("s3:/bucket/a", "BUCKET/PREFIX"),
        ("http://host/bucket", "az://, gs://, s3://"),
    ],
)
def test_no_address(text: str, said: str) -> None:
    with pytest.raises(OutputError, match=said) as raised:
        parse_address(text)
    assert text in str(raised.value)


@pytest.mark.parametrize(
    "text",
    [
        "s3://KEY:SECRET@bucket/prefix",
        "https://me:SECRET@host/x",
        "gs://SECRET@bucket",
        "s3://bucket/prefix?X-Amz-Signature=SECRET&X-Amz-Expires=1",
        "az://container/x?sig=SECRET",
    ],
)
def test_credentials_in_an_address_are_refused_and_not_repeated(text: str) -> None:
    with pytest.raises(OutputError, match="holds credentials") as raised:
        parse_address(text)
    assert "SECRET" not in str(raised.value)
    assert "KEY" not in str(raised.value)


@pytest.mark.parametrize(
    ("scheme", "kind"), [("s3", "S3Store"), ("gs", "GCSStore"), ("az", "AzureStore")]
)
def test_each_scheme_has_its_storage(
    scheme: str, kind: str, monkeypatch: pytest.MonkeyPatch, connect: Any
) -> None:
    """Nothing is asked of a network before an object is."""
    store = pytest.importorskip("obstore.store", reason="obstore is an extra")
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_NAME", "account")
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", "a2V5")
    made: Any = connect(ObjectAddress(scheme, "bucket", "a/b")).store
    assert isinstance(made, getattr(store, kind))
    assert made.prefix == "a/b"


def test_azure_without_account(monkeypatch: pytest.MonkeyPatch, connect: Any) -> None:
    monkeypatch.delenv("AZURE_STORAGE_ACCOUNT_NAME", raising=False)
    with pytest.raises(OutputError, match="no credentials; set AZURE_STORAGE_ACCOUNT_NAME"):
        connect(ObjectAddress("az", "container", "a"))
