"""Models of a lock, the outcomes of each group of runs; its published schema is of these."""

import json
import math
from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from contactlab.schema.evidence import Setting
from contactlab.schema.finding import Count
from contactlab.schema.strict_model import Flag, Model, Number, Whole, Word


class Group(Model):
    """The outcomes of the runs that have the same axis values."""

    at: dict[str, Setting]
    runs: Count
    trajectories: Word
    outcomes: dict[Word, Count]
    metrics: dict[Word, Annotated[tuple[Number, ...], Field(min_length=1, max_length=3)]]

    @property
    def key(self) -> str:
        """Key that identifies it."""
        return key_of(self.at)

    def summarize_metric(self, metric: str) -> tuple[float, float, int]:
        """Return mean, spread and number of the values of a metric; NaN, 0 and 0 without any."""
        mean, *rest = self.metrics.get(metric, (math.nan, 0.0, 0))
        spread, *count = rest or (0.0,)
        return mean, spread, int(count[0]) if count else self.runs


class Lock(Model):
    """Contents of the file; runs of the same starts repeat each other, unless they are chaotic."""

    version: Literal[1] = 1
    sweep: Word
    scene_hash: Word
    engine: Word
    seeds: tuple[Whole, ...]
    starts: Word
    chaotic: Flag = False
    metric_versions: dict[Word, Whole]
    groups: Annotated[tuple[Group, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _names_no_group_twice(self) -> Self:
        if len(self.by_key) < len(self.groups):
            raise PydanticCustomError("group_twice", "has two groups of the same axis values")
        return self

    @property
    def by_key(self) -> dict[str, Group]:
        """The groups by their keys."""
        return {group.key: group for group in self.groups}


def key_of(axes: Mapping[str, object]) -> str:
    """Return the key of the group with these axis values."""
    return json.dumps({name: round_value(value) for name, value in sorted(axes.items())})


def round_value(value: object) -> object:
    """Return a value of an axis to nine digits, since computed ones differ in the last."""
    if isinstance(value, list | tuple):
        return [round_value(item) for item in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(f"{value:.9g}") if is_number else value
