"""Tables and manifests with redone hashes: every command refuses them in one line, by code 3."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.run.test_bound_evidence import rewrite

pytestmark = pytest.mark.long
Bend = Callable[[pa.Table], pa.Table]
SHARED = b"contactlab.shared"


def replaced(name: str, kind: pa.DataType, value: Any) -> Bend:
    def bend(table: pa.Table) -> pa.Table:
        place = table.schema.get_field_index(name)
        field = pa.field(name, kind, metadata=table.schema.field(name).metadata)
        return table.set_column(place, field, pa.array([value] * len(table), kind))

    return bend


def with_shared(change: Callable[[dict[str, Any]], Any]) -> Bend:
    def bend(table: pa.Table) -> pa.Table:
        meta = dict(table.schema.metadata)
        text = change(json.loads(meta[SHARED]))
        meta[SHARED] = text if isinstance(text, bytes) else json.dumps(text).encode()
        return table.replace_schema_metadata(meta)

    return bend


def add_column(name: str) -> Bend:
    return lambda table: table.append_column(name, table["seed"])


BENDS: dict[str, Bend] = {
    "without labels": lambda table: table.drop_columns(["labels"]),
    "without settings": lambda table: table.drop_columns(["settings"]),
    "without a metric": lambda table: table.drop_columns(["penetration_max"]),
    "seed twice": add_column("seed"),
    "a metric twice": add_column("penetration_max"),
    "nothing shared": lambda table: table.replace_schema_metadata({}),
    "shared is a list": with_shared(lambda _: []),
    "shared is deep": with_shared(lambda _: b"[" * 100_000),
    "shared is text": with_shared(lambda _: b'"x"'),
    "shared is cut": with_shared(lambda _: b"{"),
    "units are numbers": with_shared(lambda shared: {**shared, "units": {"penetration_max": 1}}),
    "versions are text": with_shared(lambda shared: {**shared, "metric_versions": {"x": "1"}}),
    "many labels": with_shared(lambda shared: {**shared, "severity": ["x"] * 200_000}),
    "severity is a number": with_shared(lambda shared: {**shared, "severity": 3}),
    "a metric is text": replaced("penetration_max", pa.string(), "deep"),
    "a metric is a list": replaced("penetration_max", pa.list_(pa.float64()), [1.0]),
    "a metric is decimal": replaced("penetration_max", pa.decimal128(9, 3), 1),
    "a label is a number": replaced("label", pa.int64(), 3),
    "labels are a map": replaced("labels", pa.map_(pa.string(), pa.string()), [("a", "b")]),
    "settings are a map": replaced("settings", pa.map_(pa.string(), pa.float64()), [("x", 1.0)]),
    "steps are real": replaced("steps", pa.float64(), 1.5),
    "index is text": replaced("index", pa.string(), "first"),
    "without rows": lambda table: table.slice(0, 0),
}


@pytest.mark.parametrize("name", BENDS)
def test_a_table_of_another_layout_is_damage(
    contactlab: Callable[..., Any], store: Path, tmp_path: Path, name: str
) -> None:
    folder = tmp_path / store
    table = pq.read_table(folder / "runs.parquet")
    try:
        rewrite(folder, BENDS[name](table))
    except (pa.ArrowException, ValueError, LookupError, RecursionError, TypeError, AttributeError):
        # Its digests cannot be computed; its hash is enough for most readers.
        pq.write_table(BENDS[name](table), folder / "runs.parquet")
        manifest = json.loads((folder / "manifest.json").read_text())
        from contactlab.store.atomic_files import sha256_of  # noqa: PLC0415

        manifest["files"]["runs.parquet"] = sha256_of(folder / "runs.parquet")
        (folder / "manifest.json").write_text(json.dumps(manifest))
    for words in (("show",), ("verify",), ("report", "-o", "page.html")):
        code, _, err = contactlab(words[0], str(store), *words[1:])
        assert (code, "Traceback" in err, "fault" in err) == (3, False, False), (words, err)


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-1", '"x"', "[]"])
def test_a_manifest_with_another_duration_is_damage(
    contactlab: Callable[..., Any], store: Path, tmp_path: Path, value: str
) -> None:
    path = tmp_path / store / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["sweep"]["resolved"]["duration"] = "there"
    path.write_text(json.dumps(manifest).replace('"there"', value))
    for words in (("show",), ("verify",), ("report", "-o", "page.html")):
        code, _, err = contactlab(words[0], str(store), *words[1:])
        assert "Traceback" not in err
        assert code in {0, 3}, (words, err)
    assert code == 3
