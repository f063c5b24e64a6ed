"""Printed names of unnamed geoms on pages and in `show`: the name of their body."""

from collections.abc import Mapping
from contextlib import suppress

from contactlab.errors import ContactlabError
from contactlab.printable import Replacer
from contactlab.run.planned_runs import open_store_scene
from contactlab.run.stored_runs import resolve_record
from contactlab.scene.model_names import geom_name_replacer
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store


def geom_replacers(store: Store, records: Mapping[int, EvidenceRecord]) -> dict[int, Replacer]:
    """Return the function that replaces geom addresses in texts about each run.

    Addresses stay if the scene cannot be compiled, and nothing is replaced without any.
    """
    replacements: dict[int, Replacer] = dict.fromkeys(records, str)
    unnamed = [
        place for place, record in records.items() if any("geom[" in name for name in record.pairs)
    ]
    if unnamed:
        with suppress(ContactlabError):
            scene = open_store_scene(store)
            for place in unnamed:
                model = scene.base_of(resolve_record(scene, records[place])).model
                replacements[place] = geom_name_replacer(model)
    return replacements
