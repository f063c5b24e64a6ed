"""Progress of long work: each layer counts its own steps, and one listener shows them together.

for trace in count_steps(traces, "traces", len(traces)):
    ...
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

_Item = TypeVar("_Item")


@dataclass
class StepCount:
    """Steps of some work: their number, the finished ones, and the name of the current one."""

    name: str
    total: float
    finished_steps: float = 0.0
    is_named: bool = False  # whether steps have names; otherwise their count is shown

    @property
    def text(self) -> str:
        """Its state in words."""
        if self.is_named:
            return self.name
        return f"{self.name} {min(self.finished_steps, self.total):,.0f} of {self.total:,.0f}"


Listener = Callable[[Sequence[StepCount]], None]
"""Called with the counts of nested work, the outermost first, after each step."""


class _Counts:
    """Counts of nested work of one listener."""

    def __init__(self, listener: Listener) -> None:
        self.nested = list[StepCount]()
        self.is_interrupted = False
        self._listener = listener

    def call_listener(self) -> None:
        """Call the listener.

        Raises:
            KeyboardInterrupt: an interruption got lost.
        """
        self._listener(self.nested)
        if self.is_interrupted:
            raise KeyboardInterrupt


_current: ContextVar[_Counts | None] = ContextVar("step_counts", default=None)


@contextmanager
def listening_to_steps(listener: Listener) -> Generator[None]:
    """Report all steps of this thread to a listener."""
    token = _current.set(_Counts(listener))
    try:
        yield
    finally:
        _current.reset(token)


@contextmanager
def step_count(name: str, total: float, *, is_named: bool = False) -> Generator[StepCount]:
    """Yield the count of some work within other counted work; `finish_step` counts a step."""
    counts, own = _current.get(), StepCount(name, max(total, 1.0), is_named=is_named)
    if counts is None:
        yield own
        return
    counts.nested.append(own)
    try:
        counts.call_listener()
        yield own
    finally:
        # Generators that are read in turns end in any order, and an outer count ends inner ones.
        own_place = next((place for place, each in enumerate(counts.nested) if each is own), None)
        if own_place is not None:
            del counts.nested[own_place:]


def finish_step(count: StepCount, steps: float = 1.0) -> None:
    """Count finished steps, and report them."""
    count.finished_steps += steps
    if counts := _current.get():
        counts.call_listener()


def interrupt_steps() -> None:
    """Let the next step raise KeyboardInterrupt: libraries may have lost the first one."""
    if counts := _current.get():
        counts.is_interrupted = True


def count_steps(items: Iterable[_Item], name: str, total: float) -> Iterator[_Item]:
    """Yield items, each a step of about equal time."""
    with step_count(name, total) as count:
        for item in items:
            yield item
            finish_step(count)


@contextmanager
def step_names(total: float) -> Generator[Callable[[str], None]]:
    """Yield a function to call with the name of each of at most `total` steps as it begins."""
    with step_count("", total, is_named=True) as count:

        def begin_step(name: str) -> None:
            steps = 1.0 if count.name else 0.0
            count.name = name
            finish_step(count, min(steps, count.total - count.finished_steps))

        yield begin_step


def finished_share(nested: Sequence[StepCount]) -> float:
    """Return the finished share of nested work: each step is a part of its count."""
    share = 0.0
    for count in reversed(nested):
        share = min(1.0, (count.finished_steps + share) / count.total)
    return share
