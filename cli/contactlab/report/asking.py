"""What a page should hold, and what was written."""

from dataclasses import dataclass

from contactlab.store import Store
from contactlab.tradeoff import Question

DEFAULT_TRACES = 60
MOST_BYTES = 25_000_000
_NOTHING = Question()


@dataclass(frozen=True)
class PageAsk:
    """What a page should hold.

    Attributes:
        question: which error stands for accuracy, and tolerances over those of the sweep.
        traces: of how many runs to give the time series.
        most_bytes: above this size sums over runs stand for runs [B].
        baseline: a store to compare with; None for none.
    """

    question: Question = _NOTHING
    traces: int = DEFAULT_TRACES
    most_bytes: int = MOST_BYTES
    baseline: Store | None = None


@dataclass(frozen=True)
class Written:
    """A page that was written.

    Attributes:
        bytes: its size [B].
        notes: what it leaves out.
    """

    bytes: int
    notes: tuple[str, ...]
