"""`trace` of a sweep file: the choice of runs that keep their traces."""

from dataclasses import dataclass

from contactlab.schema.sweep_schema import Sweep

MANY_RUNS, OF_MANY = 100_000, "flagged+sample:1000"
"""The default traces of a sweep with more runs; a smaller sweep keeps all traces."""
_SAMPLE_PREFIX = "sample:"


@dataclass(frozen=True)
class KeptTraces:
    """The choice of runs with traces: all, those that are not stable, or an even sample."""

    every: bool = False
    flagged: bool = False
    sample: int = 0

    @classmethod
    def read_rule(cls, rule: str) -> "KeptTraces":
        """Return the choice for a rule such as `flagged+sample:1000`."""
        parts = rule.split("+")
        numbers = [
            int(part.removeprefix(_SAMPLE_PREFIX))
            for part in parts
            if part.startswith(_SAMPLE_PREFIX)
        ]
        return cls("all" in parts, "flagged" in parts, *numbers)

    def keeps_trace(self, index: int, label: str, runs: int) -> bool:
        """Return whether the trace of a run is kept, by its index among a number of runs."""
        if self.every or (self.flagged and label != "stable"):
            return True
        return index * self.sample % runs < self.sample

    def share_bounds(self, runs: int) -> tuple[float, float]:
        """Return the smallest and the largest possible share of runs with kept traces."""
        least = 1.0 if self.every else min(1.0, self.sample / runs)
        return least, 1.0 if self.flagged else least


def with_default_traces(sweep: Sweep, runs: int) -> Sweep:
    """Return a sweep with the default choice of traces, unless it makes a choice."""
    if "trace" in sweep.model_fields_set or runs <= MANY_RUNS:
        return sweep
    return sweep.model_copy(update={"trace": OF_MANY})
