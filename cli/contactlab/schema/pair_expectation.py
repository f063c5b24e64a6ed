"""Expectations of contact pairs in scenes and sweeps: modes, forces and depths, and when."""

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Discriminator, Tag, model_validator
from pydantic_core import PydanticCustomError

from contactlab.schema.strict_model import Model, Number, Positive, Word, about

# A number, or an expression over the scene's initial values.
Term = Number | Word
PairMode = Literal["stick", "slide", "apart", "rolls"]


class Bounds(Model):
    """The range that a metric must lie in, ends included."""

    min: Number | None = about("smallest accepted value", default=None)
    max: Number | None = about("largest accepted value", default=None)

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.min is None and self.max is None:
            raise PydanticCustomError("bounds_empty", "needs min, max or both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise PydanticCustomError("bounds_order", "has a min above its max")
        return self


class DepthBound(Model):
    """Depth that a pair may have."""

    max: Positive = about("largest accepted penetration [m]")


class ExpectedModes(Model):
    """Sticking or sliding of monitored pairs when first and last in contact."""

    first: Literal["stick", "slide"] | None = about("when first so", default=None)
    last: Literal["stick", "slide"] | None = about("when last so", default=None)


Modes = Annotated[
    Annotated[PairMode, Tag("@word")] | Annotated[ExpectedModes, Tag("@ends")],
    Discriminator(lambda data: "@ends" if isinstance(data, dict | ExpectedModes) else "@word"),
]


class PairExpectation(Model):
    """Expected behaviour of some monitored pairs, and when."""

    model_config = ConfigDict(serialize_by_alias=True)

    pair: Word | None = about(
        "monitored pairs, as GEOM-GEOM or BODY-BODY in either order, or a pattern", default=None
    )
    body: Word | None = about(
        "all monitored pairs of this body, or of those of a pattern", default=None
    )
    mode: Modes | None = about(
        "stick, slide, apart or rolls (without slipping), or {first, last}", default=None
    )
    force: Bounds | None = about(
        "{min, max} of the pairs' normal forces together [N], over 20 ms", default=None
    )
    depth: DepthBound | None = about("{max}: largest penetration [m]", default=None)
    start: Term | None = about("from when [s]; the start if left out", default=None, alias="from")
    stop: Term | None = about("to when [s]; the end if left out", default=None, alias="to")

    @property
    def expects(self) -> bool:
        """True if anything is expected of pairs."""
        return not (self.mode is None and self.force is None and self.depth is None)

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        told = {self.pair, self.body, self.start, self.stop} != {None}
        if not self.expects and (told or type(self) is PairExpectation):
            raise PydanticCustomError("pair_empty", "needs mode, force or depth")
        if self.pair is not None and self.body is not None:
            raise PydanticCustomError("pair_twice", "takes pair or body, not both")
        return self
