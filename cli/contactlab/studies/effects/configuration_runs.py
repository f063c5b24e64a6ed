"""Configurations of one scene: each run from the same seeds, in the same scenarios."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco

from contactlab.store.finished_store import Store
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.tasks.session import Session, Values

Row = Mapping[str, Any]
Measure = Callable[[Store, str, mujoco.MjModel], Row]
"""Returns what a study measures of a stored run, by its id and its model as written."""


class ConfigurationRows(NamedTuple):
    """The rows of one configuration, by scenario and by seed."""

    scenarios: Sequence[Values]
    rows: Sequence[Sequence[Row]]

    @property
    def flat(self) -> list[Row]:
        """All rows."""
        return [row for rows in self.rows for row in rows]


def sweep_of(
    setup: AblationSetup, configurations: Sequence[Values], asked: Mapping[str, object]
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
        **asked,
    }
    return {key: value for key, value in sweep.items() if value is not None}


def run_configurations(
    session: Session,
    setup: AblationSetup,
    name: str,
    configurations: Sequence[Values],
    asked: Mapping[str, object],
    measure: Measure = lambda _store, _run, _model: {},
) -> list[ConfigurationRows]:
    """Run configurations into a store of this name, or resume it, and return the rows of each.

    Each gives values over those of the setup's base and of a scenario. `asked` is what else the
    sweep says, but for keys of no value.
    """
    values = [
        [{**setup.base, **scenario, **own} for scenario in setup.scenarios]
        for own in configurations
    ]
    sweep = sweep_of(setup, configurations, asked)
    store, scene = session.run_derived(name, sweep, setup.scenes, resume=True), setup.scene
    stored = {row["run_id"]: row for row in store.table.to_pylist()}

    def rows(of_each: Values) -> Iterator[Row]:
        for run in (scene.resolve(of_each, seed, setup.duration) for seed in setup.seeds):
            run_id, model = scene.run_id(run), scene.base(run.structure).model
            yield {**stored[run_id], **measure(store, run_id, model)}

    return [
        ConfigurationRows(setup.scenarios, [list(rows(columns)) for columns in of_each])
        for of_each in values
    ]
