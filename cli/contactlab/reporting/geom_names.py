"""Names of geoms in text and pages, for those without a name in their model."""

from collections.abc import Mapping
from importlib.util import find_spec

from contactlab.plugins import find_extensions
from contactlab.printable import Replacer
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store


def load_geom_replacers(store: Store, records: Mapping[int, EvidenceRecord]) -> dict[int, Replacer]:
    """Return the names of geoms in each run: geoms without one are called by their bodies."""
    pairs = (name for record in records.values() for name in record.pairs)
    if find_spec("mujoco") is None or not any("geom[" in name for name in pairs):
        return dict.fromkeys(records, str)
    return find_extensions("wording")["geoms"].load()(store, records)
