"""`trace` of a sweep file: the runs whose traces are kept."""

from dataclasses import dataclass

from contactlab.schema.sweep_schema import Sweep

MANY_RUNS, OF_MANY = 100_000, "flagged+sample:1000"
"""A sweep of more runs keeps these traces unless it says otherwise; a smaller one keeps all."""
_SAMPLE = "sample:"


@dataclass(frozen=True)
class KeptTraces:
    """The runs whose traces are kept: all, those that are not stable, so many spread evenly."""

    every: bool = False
    flagged: bool = False
    sample: int = 0

    @classmethod
    def of(cls, rule: str) -> "KeptTraces":
        """Return what a rule keeps, such as `flagged+sample:1000`."""
        parts = rule.split("+")
        numbers = [int(part.removeprefix(_SAMPLE)) for part in parts if part.startswith(_SAMPLE)]
        return cls("all" in parts, "flagged" in parts, *numbers)

    def keeps(self, index: int, label: str, runs: int) -> bool:
        """Return whether the trace of a run is kept, by its place among so many runs."""
        if self.every or (self.flagged and label != "stable"):
            return True
        return index * self.sample % runs < self.sample

    def shares(self, runs: int) -> tuple[float, float]:
        """Return of which share of so many runs traces are kept, at least and at most."""
        least = 1.0 if self.every else min(1.0, self.sample / runs)
        return least, 1.0 if self.flagged else least


def with_default_traces(sweep: Sweep, runs: int) -> Sweep:
    """Return a sweep with the traces that it keeps where it says nothing of them."""
    if "trace" in sweep.model_fields_set or runs <= MANY_RUNS:
        return sweep
    return sweep.model_copy(update={"trace": OF_MANY})
