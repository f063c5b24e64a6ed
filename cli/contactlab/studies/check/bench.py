"""Where a model is run for its checks: generated sweeps, each into a store of its own."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from contactlab.plan import read_sweep
from contactlab.run.job import Begin, Progress
from contactlab.run.stop import Stop
from contactlab.run.sweep import Ask, run_sweep
from contactlab.schema import EvidenceRecord
from contactlab.store import Store
from contactlab.store.mcap import StoredTrace
from contactlab.studies.check.target import Target

Values = Mapping[str, object]
OWN = "run"
"""The store of the model's own run."""


@dataclass(frozen=True)
class Tried:
    """A run of the model and its evidence.

    Attributes:
        row: what it was run with, over what is under check.
        values: everything that it was run with.
        store: where its evidence lies.
        record: its record.
    """

    row: Values
    values: Values
    store: Store
    record: EvidenceRecord

    @cached_property
    def trace(self) -> StoredTrace:
        """Its trace."""
        return self.store.trace(self.record)

    @property
    def kept(self) -> bool:
        """Whether it left a trace, however short."""
        return self.record.trace is not None

    @property
    def whole(self) -> bool:
        """Whether it was simulated to its end, without an engine warning."""
        return self.record.status == "ok" and not self.record.warnings


@dataclass
class Bench:
    """Runs a model, and scenes in its stead, for checks.

    Attributes:
        target: the model.
        folder: where the stores go.
        workers: processes.
        begin: told how many runs a store has, and how many of them are done already.
        progress: told of runs as they finish.
        stop: set when runs should end soon; None if they never should.
    """

    target: Target
    folder: Path
    workers: int
    begin: Begin
    progress: Progress
    stop: Stop | None = None
    _stores: dict[str, None] = field(default_factory=dict[str, None])

    @cached_property
    def own(self) -> Tried:
        """The model's own run, checked twice."""
        return self.run(OWN, "The model as it is", [{}], checks="all")[0]

    @property
    def has_own(self) -> bool:
        """Whether the model's own run was asked for."""
        return OWN in self._stores

    def run(
        self,
        name: str,
        description: str,
        rows: Sequence[Values],
        *,
        duration: float | None = None,
        **keys: Any,  # noqa: ANN401 - keys of a sweep file
    ) -> list[Tried]:
        """Run the model with further settings.

        Args:
            name: of the store.
            description: what the runs are for.
            rows: settings of each run, over those under check.
            duration: simulated time [s]; as under check if None.
            keys: further keys of the sweep file.
        """
        target = self.target
        seconds = target.duration if duration is None else duration
        whole = [{**target.values, **row} for row in rows]
        found = self.run_scene(name, description, target.reference, whole, seconds, **keys)
        return [replace(each, row=row) for row, each in zip(rows, found, strict=True)]

    def run_scene(
        self,
        name: str,
        description: str,
        reference: str,
        rows: Sequence[Values],
        duration: float,
        *,
        workers: int | None = None,
        **keys: Any,  # noqa: ANN401 - keys of a sweep file
    ) -> list[Tried]:
        """Run any scene; see `run`."""
        text = _sweep(reference, description, rows, {"duration": duration, **keys})
        scenes = self.target.scenes
        read = read_sweep(text, scenes.vocabulary)
        scene = scenes.open(reference)
        ask = Ask(
            plan=read.plan,
            scene=scene,
            name=name,
            source=text,
            overrides=(),
            store=self.folder / name,
            workers=self.workers if workers is None else workers,
            fresh=True,
        )
        run_sweep(ask, self.begin, self.progress, self.stop)
        self._stores[name] = None
        store = Store.open(self.folder / name)
        ids = [scene.run_id(scene.resolve(row, 0, duration)) for row in rows]
        return [
            Tried(row, row, store, store.record(run)) for row, run in zip(rows, ids, strict=True)
        ]

    def stores(self, *names: str) -> tuple[str, ...]:
        """Return which of these stores were written."""
        return tuple(name for name in names if name in self._stores)


def _sweep(
    reference: str, description: str, rows: Sequence[Values], keys: Mapping[str, Any]
) -> str:
    """Return a sweep file; JSON is YAML."""
    first, *rest = rows
    sweep = {
        "version": 1,
        "scene": reference,
        "description": description,
        "axes": {name: [value] for name, value in first.items()},
        "include": rest,
        "trace": "all",
        **keys,
    }
    return json.dumps(sweep, indent=1)
