"""Configurations of one scene: each run from the same seeds, in the same scenarios."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from contactlab.studies.effects.effects_request import SweepSetup
from contactlab.tasks.session import Session, Values

Row = Mapping[str, Any]


class ConfigurationRows(NamedTuple):
    """The rows of one configuration, by scenario and by seed."""

    scenarios: Sequence[Values]
    rows: Sequence[Sequence[Row]]


def build_sweep(
    setup: SweepSetup, configurations: Sequence[Values], more_keys: Mapping[str, object]
) -> dict[str, object]:
    """Return a sweep of configurations, as a sweep file has it."""
    rows = [
        {**setup.base, **scenario, **own} for own in configurations for scenario in setup.scenarios
    ]
    sweep = {
        "version": 1,
        "scene": setup.reference,
        "duration": setup.duration,
        "seeds": list(setup.seeds),
        "include": rows,
        "effects": "all",
        "thresholds": dict(setup.thresholds),
        "checks": "none",
        "must": list(setup.must) or None,
        **more_keys,
    }
    return {key: value for key, value in sweep.items() if value is not None}


def run_configurations(
    session: Session,
    setup: SweepSetup,
    name: str,
    configurations: Sequence[Values],
    more_keys: Mapping[str, object],
) -> list[ConfigurationRows]:
    """Run configurations into a store of this name, or resume it, and return the rows of each.

    Each gives values over those of the base and of a scenario. `more_keys` are keys of the sweep.
    """
    values = [
        [{**setup.base, **scenario, **own} for scenario in setup.scenarios]
        for own in configurations
    ]
    sweep = build_sweep(setup, configurations, more_keys)
    store, scene = session.run_derived(name, sweep, setup.scenes, resume=True), setup.scene
    stored = {row["run_id"]: row for row in store.table.to_pylist()}

    def list_rows(of_each: Values) -> Iterator[Row]:
        for run in (scene.resolve(of_each, seed, setup.duration) for seed in setup.seeds):
            yield stored[scene.run_id(run)]

    return [
        ConfigurationRows(setup.scenarios, [list(list_rows(columns)) for columns in of_each])
        for of_each in values
    ]
