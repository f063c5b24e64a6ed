"""Read, compare and report stored evidence; the engine is not loaded."""

from pathlib import Path
from typing import Literal

from contactlab.comparison.compare_stores import DEFAULT_POLICY
from contactlab.comparison.compare_stores import compare as compare_stores
from contactlab.plan.sweep_file import read_yaml_as
from contactlab.reporting.report import PageRequest, write_page
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.store.finished_store import Store
from contactlab.store.store_files import Address, parse_address


def open(store: str | Address) -> Store:
    """Open a finished store, by its folder or its address: `s3://bucket/prefix`.

    Raises:
        StoreError: there is none, or it is unfinished, damaged or of another version.
    """
    return Store.open(parse_address(store))


def compare(
    baseline: Store | str | Address,
    candidate: Store | str | Address,
    *,
    policy: str | Path | None = None,
    match: Literal["id", "axes"] | None = None,
    thorough: bool = False,
) -> ComparisonReport:
    """Judge a candidate by a baseline; the engine is not loaded.

    The file `policy` says what counts as regressed, what fails, and, unless `match` does, whether
    runs are paired by id or by axis values and seed. A thorough comparison checks every record and
    every trace first.

    Raises:
        StoreError: a store is not sound, or the stores have no run in common.
        PolicyError: the policy asks for what the stores do not have.
    """
    rules = DEFAULT_POLICY if policy is None else read_yaml_as(Path(policy), ComparePolicy)
    if match is not None:
        rules = rules.model_copy(update={"match": match})
    return compare_stores(address_of(baseline), address_of(candidate), rules, thorough=thorough)


def report(
    store: Store | str | Address,
    *,
    output: str | Path | None = None,
    baseline: Store | str | Address | None = None,
) -> Path:
    """Write a store's page, one HTML file that works offline, and return its path.

    Without `output`, it is `report.html` in the store, or in this folder if that is in a bucket.
    The page may compare the store with a baseline.

    Raises:
        OutputError: the extra `figures` is not installed, or the file cannot be written.
        StoreError: a store cannot be read.
    """
    opened = Store.open(address_of(store))
    folder = opened.address if isinstance(opened.address, Path) else Path()
    target = folder / "report.html" if output is None else Path(output)
    before = None if baseline is None else Store.open(address_of(baseline))
    write_page(opened, target, PageRequest(baseline=before))
    return target


def address_of(store: Store | str | Address) -> Address:
    """Return where a store is."""
    return store.address if isinstance(store, Store) else parse_address(store)
