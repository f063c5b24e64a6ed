"""Which verdicts of an atlas are others than those of an earlier one."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from bench.atlas.entry import Entry

_NONE = "no record"


class Difference(NamedTuple):
    """A verdict that changed, of a file that may have changed too."""

    name: str
    before: str
    after: str
    why: str  # what else changed: the file, MuJoCo, the judge

    def __str__(self) -> str:
        """Return it in one line."""
        return f"{self.name}: {self.before} -> {self.after} ({self.why})"


def differences(before: Mapping[str, Entry], after: Mapping[str, Entry]) -> Iterator[Difference]:
    """Yield what changed between records by their places, those that went last.

    What had no record before, or has none now and had no verdict, is no change.
    """
    for place, old in before.items():
        entry = after.get(place)
        if entry is None and old.examination:
            yield Difference(old.name, old.word, _NONE, "the record is gone")
        elif entry is not None and entry.word != old.word:
            yield Difference(entry.name, old.word, entry.word, _why(old, entry))


def _why(old: Entry, new: Entry) -> str:
    wheels = f"{old.wheel} {old.version} -> {new.version}"
    causes = {
        wheels: old.version != new.version,
        "the file": old.version == new.version and old.digest != new.digest,
        f"MuJoCo {old.mujoco} -> {new.mujoco}": old.mujoco != new.mujoco,
        "the judge's code": old.judge != new.judge,
        f"{old.max_cpu} -> {new.max_cpu} s of CPU": old.max_cpu != new.max_cpu,
    }
    return ", ".join(cause for cause, holds in causes.items() if holds) or "nothing that is known"
