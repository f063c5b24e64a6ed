"""The runs that a sweep asks for, streamed in a fixed order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from contactlab.plan.diagnostic import Diagnostic
from contactlab.plan.rows import Grid, Match
from contactlab.schema import Expectation, Role, Sweep

CONFIRM_ABOVE = 100_000
MOST_RUNS = 10_000_000


@dataclass(frozen=True)
class SweptAxis:
    """One axis of a plan.

    Attributes:
        name: as in the sweep file.
        role: knob or scenario.
        values: the canonical values it takes, each once, in order.
    """

    name: str
    role: Role
    values: tuple[object, ...]

    @property
    def count(self) -> int:
        """Number of different values."""
        return len(self.values)


@dataclass(frozen=True, slots=True)
class Run:
    """One rollout to do.

    Attributes:
        index: its position in the plan, from 0.
        values: canonical settings by axis, the sweep's effects among them; treat as read-only,
            since the seeds of one row share it. What is absent is as the scene has it.
        seed: what the scene's perturbation is drawn from.
    """

    index: int
    values: Mapping[str, object]
    seed: int


@dataclass(frozen=True, slots=True)
class Row:
    """The runs of one row of settings.

    Attributes:
        first: the first run's position in the plan, from 0.
        values: canonical settings by axis; see `Run`.
        seeds: one for each run.
    """

    first: int
    values: Mapping[str, object]
    seeds: Sequence[int]


@dataclass(frozen=True)
class Plan:
    """What a sweep file, with the options of the command line, asks for.

    Attributes:
        sweep: the file as read.
        axes: the axes, in the order in which they advance, the slowest first.
        count: number of runs.
        warnings: what looks wrong but stops nothing.
        grid: the rows of settings.
        expected: conditions of `expect` with what they ask for.
    """

    sweep: Sweep
    axes: tuple[SweptAxis, ...]
    count: int
    warnings: tuple[Diagnostic, ...]
    grid: Grid
    expected: tuple[tuple[Match, Expectation], ...]

    def rows(self) -> Iterator[Row]:
        """Yield the rows: the product in the order written, then included rows."""
        seeds = self.sweep.seed_values
        starts = range(0, self.count, len(seeds))
        # Positions first: the rows beyond the last of them are not even made.
        for first, values in zip(starts, self.grid.rows(), strict=False):
            yield Row(first, values, seeds[: self.count - first])

    def runs(self) -> Iterator[Run]:
        """Yield the runs, row by row, seeds innermost."""
        for row in self.rows():
            for index, seed in enumerate(row.seeds, row.first):
                yield Run(index, row.values, seed)

    def expectations(self, run: Run) -> tuple[Expectation, ...]:
        """Return what must come out of a run."""
        return tuple(each for match, each in self.expected if match.holds(run.values))
