"""Hold a run's outcome against what its sweep expects and tolerates."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from contactlab.schema import Expectation


@dataclass(frozen=True)
class Verdict:
    """What an outcome amounts to.

    Attributes:
        expected: labels of which one was expected, or None.
        met: whether everything expected came out; None if nothing was expected.
        reason: what was missed, or None.
    """

    expected: tuple[str, ...] | None
    met: bool | None
    reason: str | None


def judge(
    picked: Sequence[Expectation],
    labels: Sequence[str],
    metrics: Mapping[str, float | None],
) -> Verdict:
    """Return whether a run meets every expectation.

    Args:
        picked: the expectations whose condition picks the run.
        labels: the run's labels, worst first; a run without any is stable.
        metrics: the run's metrics.
    """
    missed = [miss for each in picked for miss in _misses(each, labels, metrics)]
    expected = [label for each in picked for label in each.label or ()]
    return Verdict(
        expected=tuple(dict.fromkeys(expected)) or None,
        met=None if not picked else not missed,
        reason="; ".join(missed) or None,
    )


def within(tolerances: Mapping[str, float], metrics: Mapping[str, float | None]) -> bool | None:
    """Return whether every tolerated metric was measured and is small enough; None without any.

    What these metrics do not name, errors against a reference, is measured later or was before.
    """
    measured = {name: metrics[name] for name in tolerances if name in metrics}
    if not measured:
        return None
    return all(
        value is not None and abs(value) <= tolerances[name] for name, value in measured.items()
    )


def _misses(
    expectation: Expectation, labels: Sequence[str], metrics: Mapping[str, float | None]
) -> Iterator[str]:
    allowed = expectation.label
    if allowed is not None and not set(allowed) & set(labels or ["stable"]):
        yield f"expected {' or '.join(allowed)}, found {', '.join(labels) or 'stable'}"
    for name, bounds in expectation.metrics.items():
        value = metrics[name]
        if value is None:
            yield f"expected {name}, which could not be measured"
        elif bounds.min is not None and value < bounds.min:
            yield f"expected {name} of at least {bounds.min:g}, found {value:g}"
        elif bounds.max is not None and value > bounds.max:
            yield f"expected {name} of at most {bounds.max:g}, found {value:g}"
