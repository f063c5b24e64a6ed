"""The sweep file: the runs to make, and their expected outcomes."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self, cast

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from contactlab.schema.drive import Drive
from contactlab.schema.requirement import Requirements
from contactlab.schema.strict_model import (
    MEASURED,
    Flag,
    Model,
    Number,
    Seconds,
    Tolerance,
    Value,
    Whole,
    Word,
    Words,
    about,
)
from contactlab.schema.vocabulary import (
    RECORDED_RUN,
    Axis,
    Loguniform,
    Ranged,
    Role,
    TraceFormat,
    Uniform,
)

EffectsBase = Literal["auto", "all"]
_BASE = "base"


def _check_effects(value: dict[str, bool | EffectsBase]) -> dict[str, bool | EffectsBase]:
    for name, item in value.items():
        if (name == _BASE) == isinstance(item, bool):
            allowed_text = "auto or all" if name == _BASE else "true or false"
            raise PydanticCustomError(
                "effects", "'{name}' takes {wanted}", {"name": name, "wanted": allowed_text}
            )
    return value


_BASE_SCHEMA = {
    "type": "string",
    "enum": ["auto", "all"],
    "description": "auto: leave out parts that provably change nothing; all: leave out nothing",
}
# `auto` and `all` alone are short for {base: auto} and {base: all}.
Effects = Annotated[
    dict[str, Flag | EffectsBase],
    BeforeValidator(lambda value: {_BASE: value} if isinstance(value, str) else value),
    AfterValidator(_check_effects),
    WithJsonSchema(
        {
            "anyOf": [
                _BASE_SCHEMA,
                {
                    "type": "object",
                    "properties": {_BASE: _BASE_SCHEMA},
                    "additionalProperties": {
                        "type": "boolean",
                        "description": "whether an effect is on",
                    },
                },
            ]
        }
    ),
]


def effect_switches(effects: Mapping[str, bool | EffectsBase]) -> dict[str, bool]:
    """Return the effects that are switched by name."""
    return {name: bool(value) for name, value in effects.items() if name != _BASE}


def effects_base(effects: Mapping[str, bool | EffectsBase]) -> EffectsBase | None:
    """Return the base for all effects without an entry; None if it is not set."""
    return cast("EffectsBase | None", effects.get(_BASE))


Seed = Annotated[Whole, Field(ge=0, lt=2**63)]


class Condition(Model):
    """Some of a run's settings: all of them must hold.

    Keys other than `where` are axes; they are kept in `settings`.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Value] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    where: Word | None = about(
        'an expression over axes, such as "timestep * 2 > 1e-3"', default=None
    )

    @property
    def settings(self) -> dict[str, object]:
        """Axis values that must be equal."""
        return self.__pydantic_extra__


def _share_schema(**bounds: float) -> WithJsonSchema:
    return WithJsonSchema({**MEASURED, **bounds})


_Largest = Annotated[Tolerance, WithJsonSchema({**MEASURED, "minimum": 0})]
_Amount = Annotated[Number, WithJsonSchema(MEASURED)]
_Limit = Annotated[Number, Field(ge=0), WithJsonSchema({**MEASURED, "minimum": 0})]
_Traces = Annotated[str, Field(pattern=r"^(all|none|flagged|(flagged\+)?sample:[1-9][0-9]*)$")]


class Bounds(Model):
    """The range that a metric must lie in, ends included."""

    min: _Amount | None = about("smallest accepted value, or 1mm", default=None)
    max: _Amount | None = about("largest accepted value, or 1mm", default=None)

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.min is None and self.max is None:
            raise PydanticCustomError("bounds_empty", "needs min, max or both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise PydanticCustomError("bounds_order", "has a min above its max")
        return self


class Expectation(Model):
    """The expected outcome of the runs that a condition selects; makes a sweep a test."""

    where: Condition = about(
        "axis values that select the runs; all runs if left out", default_factory=Condition
    )
    label: Words | None = about(
        "the label that such a run must get, or a list of allowed ones", default=None
    )
    metrics: dict[str, Bounds] = about(
        "metric name to {min, max}, both in the metric's own unit", default={}
    )
    mean: dict[str, Bounds] = about(
        "metric name to {min, max} of its mean over all of these runs",
        default={},
        exclude_if=lambda mean: not mean,
    )
    must: Requirements = about(
        "requirements of each of these runs, in words",
        default=(),
        exclude_if=lambda must: not must,
    )
    reason: Word | None = about("why it is expected, for the report", default=None)

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.label is None and not (self.metrics or self.mean or self.must):
            raise PydanticCustomError("expect_empty", "needs label, metrics, mean or must")
        return self


MOST_SENSITIVITIES = 3
"""The number of configurations and seeds of a sampled sweep with reported sensitivities."""


class Sample(Model):
    """Draw of the values of `uniform` and `loguniform` axes."""

    method: Literal["sobol", "lhs", "random", "saltelli"] = about(
        "sobol: low discrepancy; lhs: Latin hypercube; random; saltelli: n (d + 2) points over d "
        "axes, for shares of variance",
        default="sobol",
    )
    n: Annotated[Whole, Field(ge=1, le=1_000_000)] = about(
        "number of points; of saltelli a power of two, which each axis takes twice"
    )
    seed: Seed = about("the same seed draws the same points", default=0)


class IncludeFile(Model):
    """Further rows, from a table."""

    file: Word = about("CSV file next to the sweep file; its first line names the axes")


IncludedRow = dict[str, Value]


Include = Annotated[
    Annotated[tuple[IncludedRow, ...], Tag("@rows")] | Annotated[IncludeFile, Tag("@file")],
    Discriminator(lambda data: "@file" if isinstance(data, dict | IncludeFile) else "@rows"),
]
Seeds = Annotated[
    Annotated[Whole, Field(ge=1, le=1_000_000), Tag("@count")]
    | Annotated[tuple[Seed, ...], Field(min_length=1), Tag("@list")],
    Discriminator(lambda data: "@list" if isinstance(data, list | tuple) else "@count"),
]


OUTCOMES = ("label", "outcome", "must")
"""Boundaries with a name; others are limits of metrics."""
COARSE = 5
"""Values of each axis that refining begins with, where its axes are written out in full."""


class Refine(Model):
    """Search of boundaries: cells of the grid with unequal corners are halved, others inferred."""

    axes: Annotated[tuple[Word, ...], Field(min_length=1, max_length=3)] = about(
        "one to three axes, each a linspace, a logspace or as many values as `to`"
    )
    to: Annotated[Whole, Field(ge=3, le=4097)] = about(
        "values of each of these axes in the full grid; only its runs are made"
    )
    where: Word = about(
        "the difference: label, outcome (stable or not), must, or a limit of a metric, such as "
        '"slip_distance > 1mm"',
        default="label",
    )
    probe: Annotated[Tolerance, Field(le=1), _share_schema(minimum=0, maximum=1)] = about(
        "runs within uniform cells, as a share of the others: a number, or 5%", default=0.05
    )
    start: Annotated[Whole, Field(ge=2)] | None = about(
        "values of each of these axes to begin with; left out: as many as are written, or 5",
        default=None,
    )


class Limit(Model):
    """Search of the last value of an axis before runs become unsound, in each scenario."""

    largest: Word | None = about("the axis of a search for its largest sound value", default=None)
    smallest: Word | None = about("the axis of a search for its smallest sound value", default=None)
    to: Annotated[Whole, Field(ge=3, le=4097)] = about("values of the axis in the full grid")
    where: Word = about(
        "when a run is sound: outcome (stable), must (of the sweep), or not beyond the limit "
        'of a metric, such as "slip_distance > 1mm"',
        default="outcome",
    )

    @model_validator(mode="after")
    def _seeks_one(self) -> Self:
        if (self.largest is None) == (self.smallest is None):
            raise PydanticCustomError("limit_one", "needs either largest or smallest")
        return self

    @property
    def axis(self) -> str:
        """The axis of the search."""
        return str(self.largest or self.smallest)


class Until(Model):
    """When to stop: once a share of the draws of each configuration is known well enough."""

    share: Word = about(
        "the counted runs: failed, must (runs that break a requirement), a label, or a limit "
        'of a metric, such as "slip_distance > 1mm"'
    )
    half_width: Annotated[
        Tolerance, Field(gt=0, lt=0.5), _share_schema(exclusiveMinimum=0, exclusiveMaximum=0.5)
    ] = about("half of the width of the share's interval: a number, or 2%")
    sure: Annotated[
        Tolerance, Field(ge=0.5, lt=1), _share_schema(minimum=0.5, exclusiveMaximum=1)
    ] = about("probability of that interval, however often one looks", default=0.95)


MARGIN_OF_MUST = "margin of must"
"""The metric of the margin to `must`, as a search names it."""
_MARGIN = "requirement_margin"


class Search(Model):
    """Search of the run with the worst value of a metric, among those of the sweep."""

    maximise: Word | None = about("the metric of a search for its largest value", default=None)
    minimise: Word | None = about(
        "the metric of a search for its least value, or `margin of must`: the distance from "
        "breaking a requirement, as a share of its limit",
        default=None,
    )
    axes: tuple[Word, ...] = about(
        "axes to search; left out: all drawn ones; without any, linspaces, logspaces and ranges",
        default=(),
    )
    runs: Annotated[Whole, Field(ge=1, le=100_000)] = about(
        "most trials, of each seed and each value of the other axes", default=100
    )

    @model_validator(mode="after")
    def _seeks_one(self) -> Self:
        if (self.maximise is None) == (self.minimise is None):
            raise PydanticCustomError("search_one", "needs either maximise or minimise")
        return self

    @property
    def metric(self) -> str:
        """The name of the metric of the search."""
        metric_name = str(self.maximise or self.minimise)
        return _MARGIN if metric_name == MARGIN_OF_MUST else metric_name


class AccuracyRequest(Model):
    """Errors: each run against a model at a much finer timestep."""

    against: Literal["own", "written"] = about(
        "own: each run's own model; written: the scene as written, in the run's scenario and from "
        "its start, so that the effect of a setting counts too",
        default="own",
        exclude_if=lambda against: against == "own",
    )
    error: Literal["auto", "trajectory", "local", "invariants"] = about(
        "trajectory: distance at common times; local: the same, restarted from the "
        "reference's states; invariants: energy and momenta, for chaotic scenes; auto: trajectory "
        "unless a perturbed copy shows chaos",
        default="auto",
    )
    refine: Annotated[Whole, Field(ge=2, le=1024)] = about(
        "smallest timestep of a run over that of the coarser reference; the finer "
        "one takes half of that",
        default=16,
    )
    scenario: tuple[Word, ...] = about(
        "axes that the scene as written has too, besides those of role scenario",
        default=(),
        exclude_if=lambda names: not names,
    )


class TimingRequest(Model):
    """Times: every run once more, in isolation, interleaved with the others, not recorded."""

    rounds: Annotated[Whole, Field(ge=3, le=1000)] = about("how often each run is timed", default=3)
    contenders: Flag = about(
        "whether configurations are timed, not runs: one seed of each scenario, which share the "
        "time of a run; and those that cannot be recommended in the first round only",
        default=False,
    )


def scene_reference(scene: object) -> object:
    """Return the name of a scene as one word: `environment:NAME` for {environment: NAME}."""
    match scene:
        case {"environment": str(named), **others} if named and not others:
            return f"environment:{named}"
        case _:
            return scene


def _check_scene(scene: object) -> object:
    reference = scene_reference(scene)
    if isinstance(reference, dict | list) or str(reference).endswith((".py", ".py:")):
        raise PydanticCustomError(
            "scene_form",
            "takes a name, a path, or {environment: NAME}, where NAME is FILE.py:FACTORY or an id "
            "of Gymnasium",
        )
    return reference


_Named = BeforeValidator(
    _check_scene, json_schema_input_type=Word | dict[Literal["environment"], Word]
)


class Sweep(Model):
    """A declared grid of runs of one scene."""

    version: Literal[1] = about("version of this file format: 1")
    scene: Annotated[Word, _Named] = about(
        "shipped scene, folder, .xml, .urdf, menagerie:ROBOT[/ENTRY], or {environment: ...}"
    )
    description: str | None = about("the purpose of the sweep", default=None)
    duration: Seconds | None = about(
        "simulated time of a run [s], or 2s; the scene's own if left out", default=None
    )
    drive: Drive | None = about(
        "none, hold, exercise, {noise: SHARE, rate: HZ}, {file: FILE} or "
        "{policy: FILE.py:CLASS}; left out: the scene's own",
        default=None,
    )
    seeds: Seeds = about("number of seeds (0, 1, ...) or a list of them; innermost", default=1)
    axes: dict[str, Axis] = about("axis name to its values; the sweep is their product", default={})
    zip: tuple[Annotated[dict[str, Axis], Field(min_length=1)], ...] = about(
        "blocks of equally long axes that advance together; each block is one axis", default=()
    )
    sample: Sample | None = about("how `uniform` and `loguniform` axes are drawn", default=None)
    refine: Refine | None = about(
        "where to look closer; left out: the whole grid runs",
        default=None,
        exclude_if=lambda asked: asked is None,
    )
    limit: Limit | None = about(
        "which largest or smallest value to find; left out: the whole grid runs",
        default=None,
        exclude_if=lambda asked: asked is None,
    )
    until: Until | None = about(
        "which share to know well enough; left out: all draws run",
        default=None,
        exclude_if=lambda asked: asked is None,
    )
    search: Search | None = about(
        "which run to find; left out: all run",
        default=None,
        exclude_if=lambda asked: asked is None,
    )
    exclude: tuple[Condition, ...] = about(
        "runs to leave out: partial matches, {where: expression} or both", default=()
    )
    include: Include = about("rows to add after `exclude`, or {file: runs.csv}", default=())
    baseline: Flag = about(
        "whether to run the scene as written too, in every scenario; after all others",
        default=False,
        exclude_if=lambda asked: not asked,
    )
    effects: Effects = about(
        "auto: leave out parts that provably change nothing; all: leave out nothing; or "
        "effect name to true or false, with `base: auto` or `base: all` for the others",
        default={},
    )
    must: Requirements = about(
        "requirements of every run, in words: held(mug, by: hand), still(box, 1 mm), "
        "upright(torso), passes(peg, hole), stays(box, 10 mm); of contact, sticks(box), "
        "slides(floor-box, first), rolls(ball), apart(finger-palm), presses(pad-box, 1..5 N), "
        "shallow(floor-*, 1 mm)",
        default=(),
        exclude_if=lambda must: not must,
    )
    tolerances: dict[str, _Largest] = about(
        "metric name to the largest acceptable value: a number, 1% or 1mm", default={}
    )
    thresholds: dict[str, _Limit] = about(
        "label threshold name to a value other than the scene's", default={}
    )
    expect: tuple[Expectation, ...] = about("expected outcomes; makes the sweep a test", default=())
    trace: _Traces = about(
        "runs that keep their trace: all, flagged, none, sample:N or flagged+sample:N; left out, "
        "those of more than 100,000 runs by flagged+sample:1000",
        default="all",
    )
    trace_format: TraceFormat = about(
        "messages: files that viewers open directly; compact: 1.5 to 8 times smaller, read by "
        "every command; `contactlab render STORE -o FOLDER` writes them as messages",
        default="messages",
        exclude_if=lambda form: form == "messages",
    )
    checks: Literal["verdict", "all", "flagged", "none"] = about(
        "runs that a second pass checks: all, those not stable, or none; verdict: all, with the "
        "effects of modeling choices",
        default="flagged",
    )
    knife_edge: Flag = about(
        "whether to repeat each run from a start 1e-6 away, to see whether its label stays",
        default=False,
    )
    accuracy: AccuracyRequest | None = about(
        "errors of each run against a reference; left out: not computed", default=None
    )
    timing: TimingRequest | None = about(
        "time of each run in isolation; left out: not measured", default=None
    )
    latency_budget: Seconds | None = about("wall time a step may take [s]", default=None)
    timeout: Seconds = about("wall time a run may take [s]", default=60.0)

    @property
    def refining(self) -> Refine | None:
        """How the grid is refined: by `refine`, or along the axis of `limit`."""
        if self.limit is None:
            return self.refine
        return Refine(axes=(self.limit.axis,), to=self.limit.to, where=self.limit.where)

    @property
    def roles(self) -> dict[str, Role]:
        """The role of each axis: a knob unless it says otherwise; recorded runs are scenarios."""
        roles = dict[str, Role]()
        for block in (self.axes, *self.zip):
            for name, axis in block.items():
                roles[name] = axis.role if isinstance(axis, Ranged) else "knob"
        if RECORDED_RUN in roles:
            roles[RECORDED_RUN] = "scenario"
        return roles

    @property
    def scenario(self) -> list[str]:
        """The axes of role scenario."""
        return [name for name, role in self.roles.items() if role == "scenario"]

    @property
    def drawn_axes(self) -> frozenset[str]:
        """The axes with random values."""
        sampled = (
            name for name, axis in self.axes.items() if isinstance(axis, Uniform | Loguniform)
        )
        return frozenset(sampled)

    @property
    def is_drawn(self) -> bool:
        """Whether runs are draws of axes, or of seeds alone; of a grid, shares are exact."""
        return bool(self.drawn_axes) or (len(self.seed_values) > 1 and not self.roles)

    @property
    def seed_values(self) -> tuple[int, ...]:
        """The seeds, in order."""
        return self.seeds if isinstance(self.seeds, tuple) else tuple(range(self.seeds))
