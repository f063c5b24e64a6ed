"""The forms in which a sweep file gives the values of an axis."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self, TypeGuard, cast

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from contactlab.schema.strict_model import Model, Number, Positive, Value, Whole

Role = Literal["knob", "scenario"]
MOST_VALUES = 1_000_000

Count = Annotated[Whole, Field(ge=2, le=MOST_VALUES)]
Span = tuple[Number, Number]


class Ranged(Model):
    """Fields that every form of an axis has besides its values."""

    role: Role = Field(
        default="knob",
        description="knob: a setting that you may choose; scenario: an external condition",
    )


class Values(Ranged):
    """Values as listed, with a role."""

    values: tuple[Value, ...] = Field(min_length=1, description="the values, in order")


class Linspace(Ranged):
    """Evenly spaced values."""

    linspace: tuple[Number, Number, Count] = Field(
        description="[first, last, count]: evenly spaced, both ends included"
    )


class Logspace(Ranged):
    """Geometrically spaced values."""

    logspace: tuple[Positive, Positive, Count] = Field(
        description="[first, last, count]: values, not exponents; both ends included"
    )


class Range(Ranged):
    """Values at a fixed step."""

    range: tuple[Number, Number, Number] = Field(
        description="[first, last, step]: the last is included where the steps reach it"
    )

    @model_validator(mode="after")
    def _reaches(self) -> Self:
        first, last, step = self.range
        if step == 0 or (last - first) / step < 0:
            raise PydanticCustomError(
                "range_step", "needs a step that leads from the first value to the last"
            )
        if (last - first) / step >= MOST_VALUES:
            raise PydanticCustomError("range_step", "has more than 1,000,000 values")
        return self


def _ordered(low: float, high: float) -> None:
    if low >= high:
        raise PydanticCustomError("span_order", "needs two bounds, the lower one first")


class Uniform(Ranged):
    """Values sampled uniformly."""

    uniform: Span = Field(description="[low, high]: sampled; needs `sample`")

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        _ordered(*self.uniform)
        return self


class Loguniform(Ranged):
    """Values sampled log-uniformly."""

    loguniform: tuple[Positive, Positive] = Field(
        description="[low, high], both positive: sampled by logarithm; needs `sample`"
    )

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        _ordered(*self.loguniform)
        return self


FORMS: Mapping[str, type[Ranged]] = {
    "values": Values,
    "linspace": Linspace,
    "logspace": Logspace,
    "range": Range,
    "uniform": Uniform,
    "loguniform": Loguniform,
}

Listed = Annotated[tuple[Value, ...], Field(min_length=1)]


def _form(data: object) -> str | None:
    if isinstance(data, list | tuple):
        return "@list"
    if isinstance(data, Mapping):
        keys = cast("Mapping[str, object]", data)
        return next((f"@{name}" for name in FORMS if name in keys), None)
    return f"@{name}" if (name := type(data).__name__.lower()) in FORMS else None


# Tags start with @ so that an error's path never mistakes one for a key of the file.
Axis = Annotated[
    Annotated[Listed, Tag("@list")]
    | Annotated[Values, Tag("@values")]
    | Annotated[Linspace, Tag("@linspace")]
    | Annotated[Logspace, Tag("@logspace")]
    | Annotated[Range, Tag("@range")]
    | Annotated[Uniform, Tag("@uniform")]
    | Annotated[Loguniform, Tag("@loguniform")],
    Discriminator(
        _form,
        custom_error_type="axis_form",
        custom_error_message="an axis is a list of values or one of: " + ", ".join(FORMS),
    ),
]


def axis_role(axis: Axis) -> Role:
    """Return the role of an axis: a knob unless it says otherwise."""
    return axis.role if isinstance(axis, Ranged) else "knob"


def is_sampled(axis: Axis) -> TypeGuard[Uniform | Loguniform]:
    """Return whether the values of an axis are sampled, not listed."""
    return isinstance(axis, Uniform | Loguniform)
