"""The names that a sweep file may use: axes of its scene, metrics and labels."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from contactlab.schema.pair_expectation import PairExpectation


@dataclass(frozen=True)
class AxisSpec:
    """An axis that a sweep can vary.

    Attributes:
        unit: its unit, `1` for a ratio, empty for a word.
        description: one line on what it sets.
        parse: turns a value of the sweep file into its canonical form: a number, a word, a
            boolean, or a tuple of numbers; raises ValueError saying what to write instead.
        choices: the words it accepts, if it is one of few.
        conflicts: names of axes that set the same thing and so cannot be swept beside it.
        parts: names of the numbers that a value consists of, for expressions: `solref.timeconst`.
        split: gives the parts that a value has, by name; in direct form a solref has no timeconst.
    """

    name: str
    unit: str
    description: str
    parse: Callable[[object], object]
    choices: tuple[str, ...] = ()
    conflicts: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    split: Callable[[object], Mapping[str, float]] | None = None

    def accepts(self, value: object) -> bool:
        """Return whether the axis takes a value."""
        try:
            self.parse(value)
        except ValueError:
            return False
        return True


class Catalogue(Protocol):
    """The axes that one scene offers; engine fields by name make the list open-ended."""

    @property
    def names(self) -> Sequence[str]:
        """Names to list and to suggest."""
        ...

    def find(self, name: str) -> AxisSpec | None:
        """Return the axis of this name, or None."""
        ...


@dataclass(frozen=True)
class Vocabulary:
    """Every name that a sweep of one scene may use."""

    axes: Catalogue
    metrics: Sequence[str]
    labels: Sequence[str]
    thresholds: Sequence[str] = ()
    mistake_in: Callable[[PairExpectation, float | None], tuple[str, str] | None] | None = None
    """The key that is wrong in what is expected of pairs in runs of that duration, and why."""
