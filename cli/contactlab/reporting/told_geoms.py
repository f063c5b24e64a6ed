"""Geoms of runs that nobody named, as text and pages speak of them."""

from collections.abc import Mapping
from importlib.util import find_spec

from contactlab.plugins import extensions
from contactlab.printable import Told
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store


def told_geoms(store: Store, records: Mapping[int, EvidenceRecord]) -> dict[int, Told]:
    """Return what geoms are called in each run: without a name as their bodies, by the engine."""
    pairs = (name for record in records.values() for name in record.pairs)
    if find_spec("mujoco") is None or not any("geom[" in name for name in pairs):
        return dict.fromkeys(records, str)
    return extensions("wording")["geoms"].load()(store, records)
