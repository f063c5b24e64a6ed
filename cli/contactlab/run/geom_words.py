"""Geoms without a name as a page speaks of them: by the body that they belong to."""

import re
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress

import mujoco

from contactlab.errors import ContactlabError
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.run.stored_runs import resolve_record
from contactlab.scene.model_names import is_address, name_of
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store

Told = Callable[[str], str]
_ADDRESS = re.compile(r"geom\[\d+\]_*")


def told_of_runs(store: Store, records: Mapping[int, EvidenceRecord]) -> dict[int, Told]:
    """Return what replaces addresses in texts about each run, in its pairs and in reasons.

    Addresses stay where the scene cannot be compiled; without any, nothing is.
    """
    told: dict[int, Told] = dict.fromkeys(records, str)
    unnamed = [
        place for place, record in records.items() if any(map(_ADDRESS.search, record.pairs))
    ]
    if unnamed:
        with suppress(ContactlabError):
            scene = stored_sweep_scene(store.manifest.sweep, store.scene_folder)
            for place in unnamed:
                model = scene.base_of(resolve_record(scene, records[place])).model
                told[place] = _replacing(words_for_geoms(model))
    return told


def _replacing(words: Mapping[str, str]) -> Told:
    return lambda text: _ADDRESS.sub(lambda found: words.get(found[0], found[0]), text)


def words_for_geoms(model: mujoco.MjModel) -> dict[str, str]:
    """Return what geoms without a name are called, by address: their body.

    Where that has several geoms the address is told too.
    """
    bodies: list[int] = model.geom_bodyid.tolist()
    count = Counter(bodies)
    names = ((name_of(model, "geom", geom), body) for geom, body in enumerate(bodies))
    return {
        name: name_of(model, "body", body) + (f" {name}" if count[body] > 1 else "")
        for name, body in names
        if is_address(name)
    }
