"""Advisories that the models of a sweep meet under their engines."""

from collections import Counter

from contactlab.advisories.met_advisories import (
    InstalledEngine,
    find_met_advisories,
)
from contactlab.engines import engine_of
from contactlab.run.planned_runs import RunIndex
from contactlab.scene.scene import Scene
from contactlab.schema.advisory import Advisory


def find_sweep_advisories(index: RunIndex, scene: Scene) -> tuple[tuple[Advisory, str], ...]:
    """Return the advisories that models of a sweep meet, each with how many of them do, in words.

    If a sweep has many models, some are examined, evenly spread over it.
    """
    counts, advisories, models = Counter[str](), dict[str, Advisory](), 0
    most_models = 64  # each takes about a millisecond
    last = None
    for run in index.select_shard(1, -(-len(index) // most_models)).iterate_runs():
        # Runs of one model meet the same advisories, so one of them is enough.
        if run.is_sibling(last):
            continue
        last = run
        engine = engine_of(run)
        model = scene.base_of(run).prepare(run.list_edits()).model
        installed = InstalledEngine(engine.name, engine.version)
        met_advisories = find_met_advisories(model, installed, lambda: scene.source.elements)
        advisories |= {each.id: each for each in met_advisories}
        counts.update(each.id for each in met_advisories)
        models += 1
    return tuple(
        (advisories[name], f"{counts[name]} of {models} models") for name in sorted(advisories)
    )
