"""Where configurations are run: generated sweeps, each into a store of its own."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from contactlab.run.asking import ask_for
from contactlab.run.job import Progress
from contactlab.run.stop import Stop
from contactlab.run.sweep import run_sweep
from contactlab.store import Store
from contactlab.studies.effects.question import Question, Values
from contactlab.studies.effects.toggles import Toggle

Row = Mapping[str, Any]
# The effects that are changed from the base configuration, sorted.
Changed = tuple[str, ...]
BASE: Changed = ()


@dataclass(frozen=True)
class Outcome:
    """What came of one configuration: rows of the store, by scenario and by seed."""

    rows: tuple[tuple[Row, ...], ...]

    @property
    def flat(self) -> list[Row]:
        """All rows."""
        return [row for rows in self.rows for row in rows]


@dataclass
class Trials:
    """Runs configurations.

    Attributes:
        question: what is asked.
        toggles: every effect that can be changed, by name.
        folder: where the stores go.
        workers: processes.
        begin: told how many runs a store has, and how many of them are done already.
        progress: told of runs as they finish.
        rounds: how often runs are timed, if they are; None for never.
        stop: set when runs should end soon; None if they never should.
        stores: names of the stores written.
    """

    question: Question
    toggles: Mapping[str, Toggle]
    folder: Path
    workers: int
    begin: Callable[[int, int], None]
    progress: Progress
    rounds: int | None
    stop: Stop | None = None
    stores: list[str] = field(default_factory=list[str])

    def run(
        self,
        name: str,
        description: str,
        configurations: Iterable[Changed],
        *,
        seeds: Sequence[int] | None = None,
        scenarios: Sequence[Values] | None = None,
        timed: bool = False,
    ) -> dict[Changed, Outcome]:
        """Run configurations in all scenarios, each from the same seeds.

        Args:
            name: of the store.
            description: what the runs are for.
            configurations: effects that each changes.
            seeds: the question's if None.
            scenarios: the question's if None.
            timed: whether the runs are timed in turns.
        """
        asked = list(dict.fromkeys(configurations))
        seeds = self.question.seeds if seeds is None else seeds
        scenarios = self.question.scenarios if scenarios is None else scenarios
        rows = [[self.values(each, scenario) for scenario in scenarios] for each in asked]
        rounds = self.rounds if timed else None
        text = self._sweep(description, [each for row in rows for each in row], seeds, rounds)
        self._run(name, text)
        table = Store.open(self.folder / name).table
        found = {row["run_id"]: row for row in table.to_pylist()}
        return {
            each: Outcome(
                tuple(tuple(found[self._id(row, seed)] for seed in seeds) for row in of_each)
            )
            for each, of_each in zip(asked, rows, strict=True)
        }

    def _run(self, name: str, text: str) -> None:
        asked = ask_for(
            text,
            name,
            self.folder / name,
            folder=self.question.scenes.folder or Path(),
            workers=self.workers,
            fresh=True,
        )
        run_sweep(asked, self.begin, self.progress, self.stop)
        self.stores.append(name)

    def values(self, changed: Changed, scenario: Values) -> Values:
        """Return the axis values of a configuration in a scenario."""
        values = {**self.question.base, **scenario}
        for name in changed:
            values |= self.toggles[name].values
        return values

    def _id(self, values: Values, seed: int) -> str:
        scene = self.question.scene
        return scene.run_id(scene.resolve(values, seed, self.question.duration))

    def _sweep(
        self, description: str, rows: Sequence[Values], seeds: Sequence[int], rounds: int | None
    ) -> str:
        """Return a sweep file; JSON is YAML."""
        question = self.question
        content = {
            "version": 1,
            "scene": question.reference,
            "description": description,
            "duration": question.duration,
            "seeds": list(seeds),
            "include": list(rows),
            "effects": "all",
            "tolerances": dict(question.tolerances),
            "thresholds": dict(question.thresholds),
            "timing": rounds and {"rounds": rounds},
            "trace": "none",
            "checks": "none",
        }
        return json.dumps(
            {key: each for key, each in content.items() if each is not None}, indent=1
        )
