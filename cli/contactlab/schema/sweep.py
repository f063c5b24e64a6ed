"""The sweep file: what to run, and what must come out."""

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from contactlab.schema.accuracy import AccuracyAsk, TimingAsk
from contactlab.schema.axes import Axis
from contactlab.schema.effects import Effects
from contactlab.schema.model import (
    Model,
    Number,
    Positive,
    Tolerance,
    Value,
    Whole,
    Word,
    Words,
)

Seed = Annotated[Whole, Field(ge=0, lt=2**63)]


class Condition(Model):
    """Some of a run's settings: all of them must hold.

    Keys other than `where` are axes; they are kept in `settings`.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Value] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    where: Word | None = Field(
        default=None, description='an expression over axes, such as "timestep * 2 > 1e-3"'
    )

    @property
    def settings(self) -> dict[str, object]:
        """Axis values that must be equal."""
        return self.__pydantic_extra__


class Bounds(Model):
    """Between what a metric must lie; ends belong to it."""

    min: Number | None = Field(default=None, description="smallest value that is fine")
    max: Number | None = Field(default=None, description="largest value that is fine")

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.min is None and self.max is None:
            raise PydanticCustomError("bounds_empty", "needs min, max or both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise PydanticCustomError("bounds_order", "has a min above its max")
        return self


class Expectation(Model):
    """What must come out of the runs that a condition picks; makes a sweep a test."""

    where: Condition = Field(
        default_factory=Condition,
        description="axis values that pick the runs; all if left out",
    )
    label: Words | None = Field(
        default=None, description="the label that such a run must get, or a list of allowed ones"
    )
    metrics: dict[str, Bounds] = Field(
        default={}, description="metric name to {min, max}, both in the metric's own unit"
    )
    reason: Word | None = Field(default=None, description="why this is expected, for the report")

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.label is None and not self.metrics:
            raise PydanticCustomError("expect_empty", "needs a label, metrics or both")
        return self


class Sample(Model):
    """How the values of `uniform` and `loguniform` axes are drawn."""

    method: Literal["sobol", "lhs", "random"] = Field(
        default="sobol", description="sobol: low discrepancy; lhs: Latin hypercube; random"
    )
    n: Annotated[Whole, Field(ge=1, le=1_000_000)] = Field(description="number of points")
    seed: Seed = Field(default=0, description="the same seed draws the same points")


class IncludeFile(Model):
    """Added rows from a table."""

    file: Word = Field(description="CSV file beside the sweep file; its first line names the axes")


Row = dict[str, Value]


def _include_form(data: object) -> str:
    return "@file" if isinstance(data, dict | IncludeFile) else "@rows"


def _seeds_form(data: object) -> str:
    return "@list" if isinstance(data, list | tuple) else "@count"


Include = Annotated[
    Annotated[tuple[Row, ...], Tag("@rows")] | Annotated[IncludeFile, Tag("@file")],
    Discriminator(_include_form),
]
Seeds = Annotated[
    Annotated[Whole, Field(ge=1, le=1_000_000), Tag("@count")]
    | Annotated[tuple[Seed, ...], Field(min_length=1), Tag("@list")],
    Discriminator(_seeds_form),
]


class Sweep(Model):
    """A declared grid of runs of one scene."""

    version: Literal[1] = Field(description="version of this file format: 1")
    scene: Word = Field(
        description="shipped scene, folder, .xml, .urdf, or menagerie:ROBOT[/ENTRY]"
    )
    description: str | None = Field(default=None, description="what the sweep is for")
    duration: Positive | None = Field(
        default=None, description="simulated time of a run [s]; the scene's own if left out"
    )
    seeds: Seeds = Field(
        default=1, description="number of seeds (0, 1, ...) or a list of them; innermost"
    )
    axes: dict[str, Axis] = Field(
        default={}, description="axis name to its values; the sweep is their product"
    )
    zip: tuple[Annotated[dict[str, Axis], Field(min_length=1)], ...] = Field(
        default=(),
        description="blocks of equally long axes that advance together; each block is one axis",
    )
    sample: Sample | None = Field(
        default=None, description="how `uniform` and `loguniform` axes are drawn"
    )
    exclude: tuple[Condition, ...] = Field(
        default=(), description="runs to leave out: partial matches, {where: expression} or both"
    )
    include: Include = Field(
        default=(), description="rows to add after `exclude`, or {file: runs.csv}"
    )
    effects: Effects = Field(
        default={},
        description="auto: leave out what provably changes nothing; all: leave out nothing; or "
        "effect name to true or false, with `base: auto` or `base: all` for the others",
    )
    tolerances: dict[str, Tolerance] = Field(
        default={}, description="metric name to what is accurate enough: a number, or 1%"
    )
    thresholds: dict[str, Number] = Field(
        default={}, description="label threshold name to a value other than the scene's"
    )
    expect: tuple[Expectation, ...] = Field(
        default=(), description="what must come out; makes the sweep a test"
    )
    trace: Annotated[str, Field(pattern=r"^(all|flagged|none|sample:[1-9][0-9]*)$")] = Field(
        default="all",
        description="runs whose trace is kept: all, flagged, none or sample:N",
    )
    checks: Literal["all", "flagged", "none"] = Field(
        default="flagged",
        description="runs that are checked in a second pass: all, those not stable, or none",
    )
    knife_edge: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="whether to run each run once more from a start 1e-6 away, to see whether "
        "its label survives",
    )
    accuracy: AccuracyAsk | None = Field(
        default=None, description="how far each run is from a reference; not asked if left out"
    )
    timing: TimingAsk | None = Field(
        default=None, description="what each run takes by itself; not asked if left out"
    )
    latency_budget: Positive | None = Field(
        default=None, description="wall time a step may take [s]"
    )
    timeout: Positive = Field(default=60.0, description="wall time a run may take [s]")

    @property
    def seed_values(self) -> tuple[int, ...]:
        """The seeds, in order."""
        return self.seeds if isinstance(self.seeds, tuple) else tuple(range(self.seeds))
