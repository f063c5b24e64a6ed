"""The names that a sweep file may use, and the forms of an axis's values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, cast

from pydantic import AfterValidator, Discriminator, Field, Tag, WithJsonSchema
from pydantic_core import PydanticCustomError

from contactlab.errors import SceneError
from contactlab.schema.drive import Drive
from contactlab.schema.strict_model import MEASURED, Model, Number, Positive, Value, Whole, about

Role = Literal["knob", "scenario"]
TraceFormat = Literal["messages", "compact"]
RECORDED_RUN = "recorded_run"
"""The axis of recorded runs; each is a scenario."""
VARIANT = "variant"
"""The axis that names the variant of an episode."""
DROP_HEIGHT = "drop_height"
"""The axis that raises the free bodies of a model at the start; a scene may define its own."""
MOST_VALUES = 1_000_000
Count = Annotated[Whole, Field(ge=2, le=MOST_VALUES)]
# Numbers, or texts with a unit, which are written out before.
_Amount = Annotated[Number, WithJsonSchema(MEASURED)]
_Above = Annotated[Positive, WithJsonSchema({**MEASURED, "exclusiveMinimum": 0})]


@dataclass(frozen=True)
class AxisSpec:
    """An axis that a sweep can vary."""

    name: str
    unit: str  # its unit, `1` for a ratio, empty for a word
    description: str  # its meaning in one line
    parse: Callable[[object], object]
    """Turns a value of the sweep file into its canonical form: a number, a word, a boolean, or a
    tuple of numbers; raises ValueError saying what to write instead."""
    choices: tuple[str, ...] = ()  # the words it accepts, if it is one of few
    conflicts: tuple[str, ...] = ()
    """Names of axes that set the same thing and so cannot be swept with it."""
    parts: tuple[str, ...] = ()
    """Names of the numbers that a value consists of, for expressions: `solref.timeconst`."""
    split: Callable[[object], Mapping[str, float]] | None = None
    """Gives the parts that a value has, by name; in direct form a solref has no timeconst."""
    accepted_values: tuple[float, ...] = ()  # the numbers that it accepts, if they are few

    def accepts_value(self, value: object) -> bool:
        """Return whether the axis takes a value."""
        try:
            self.parse(value)
        except ValueError:
            return False
        return True


@dataclass(frozen=True)
class Vocabulary:
    """Every name that a sweep of one scene may use."""

    axes: Sequence[str]  # those to list and to suggest
    find: Callable[[str], AxisSpec | None]
    """Returns the axis of a name, if there is one; model fields are found, but not listed."""
    metrics: Sequence[str]
    labels: Sequence[str]
    thresholds: Sequence[str] = ()
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    """Units of metrics and thresholds, by name."""
    lacking: Mapping[str, str] = field(default_factory=dict[str, str])
    """Metrics that no run of the scene has, and why."""
    describe: Callable[[str], str] = str
    """Returns the description of a metric or an axis; by default, its name."""
    coordinates: Sequence[str] = ()
    """Axes that set a coordinate or velocity of the start; suggested, but not listed."""
    asks: bool = False
    """Whether the scene itself has requirements."""
    mistake_in_requirement: Callable[[str, float | None], str | None] | None = None
    """Fault of a requirement in runs of that duration; None if there is none."""
    mistake_in_drive: Callable[[Drive], SceneError | None] | None = None
    """Fault of the drive of a sweep file, such as a missing file; None if it can be used."""


def _check_reach(values: tuple[float, float, float]) -> tuple[float, float, float]:
    first, last, step = values
    if step == 0 or (last - first) / step < 0:
        raise PydanticCustomError(
            "range_step", "needs a step that leads from the first value to the last"
        )
    if (last - first) / step >= MOST_VALUES:
        raise PydanticCustomError("range_step", "has more than 1,000,000 values")
    return values


def _check_order(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] >= bounds[1]:
        raise PydanticCustomError("span_order", "needs two bounds, the lower one first")
    return bounds


_Steps = Annotated[tuple[_Amount, _Amount, _Amount], AfterValidator(_check_reach)]
_Span = AfterValidator(_check_order)


class Ranged(Model):
    """Fields that every form of an axis has besides its values."""

    role: Role = about(
        "knob: a setting that you may choose; scenario: an external condition", default="knob"
    )

    @classmethod
    def form_key(cls) -> str:
        """Return the key that tells the form from others: its first field of its own."""
        return next(name for name in cls.model_fields if name != "role")


class Values(Ranged):
    """Values as listed, with a role."""

    values: tuple[Value, ...] = about("the values, in order", min_length=1)


class Linspace(Ranged):
    """Evenly spaced values."""

    linspace: tuple[_Amount, _Amount, Count] = about(
        "[first, last, count]: evenly spaced, both ends included"
    )


class Logspace(Ranged):
    """Geometrically spaced values."""

    logspace: tuple[_Above, _Above, Count] = about(
        "[first, last, count]: values, not exponents; both ends included"
    )


class Range(Ranged):
    """Values at a fixed step."""

    range: _Steps = about("[first, last, step]: the last is included where the steps reach it")


class Uniform(Ranged):
    """Values sampled uniformly."""

    uniform: Annotated[tuple[Number, Number], _Span] = about("[low, high]: sampled; needs `sample`")


class Loguniform(Ranged):
    """Values sampled log-uniformly."""

    loguniform: Annotated[tuple[Positive, Positive], _Span] = about(
        "[low, high], both positive: sampled by logarithm; needs `sample`"
    )


class Drawn(Ranged):
    """Some of the values that an axis takes, drawn without replacement."""

    sample: Annotated[Whole, Field(ge=1)] = about("how many of the axis' own values are drawn")
    seed: Annotated[Whole, Field(ge=0)] = about("the same seed draws the same values", default=0)


FORMS: Mapping[str, type[Ranged]] = {
    form.form_key(): form
    for form in (Values, Linspace, Logspace, Range, Uniform, Loguniform, Drawn)
}


def _axis_form(data: object) -> str | None:
    if isinstance(data, list | tuple) or data == "all":
        return "@all" if data == "all" else "@list"
    if isinstance(data, Mapping):
        keys = cast("Mapping[str, object]", data)
        return next((f"@{name}" for name in FORMS if name in keys), None)
    return f"@{data.form_key()}" if isinstance(data, Ranged) else None


# Tags start with @ so that an error's path never mistakes one for a key of the file.
Axis = Annotated[
    Annotated[tuple[Value, ...], Field(min_length=1), Tag("@list")]
    | Annotated[
        Literal["all"], WithJsonSchema({"type": "string", "pattern": r"^all$|\.\."}), Tag("@all")
    ]
    | Annotated[Values, Tag("@values")]
    | Annotated[Linspace, Tag("@linspace")]
    | Annotated[Logspace, Tag("@logspace")]
    | Annotated[Range, Tag("@range")]
    | Annotated[Uniform, Tag("@uniform")]
    | Annotated[Loguniform, Tag("@loguniform")]
    | Annotated[Drawn, Tag("@sample")],
    Discriminator(
        _axis_form,
        custom_error_type="axis_form",
        custom_error_message="an axis is a list of values or one of: " + ", ".join(FORMS),
    ),
]

Sampled = Uniform | Loguniform
"""Axes with sampled values, not listed ones."""
