"""Which verdicts of an atlas are others than those of an earlier one."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from atlas.entry import Entry


class Difference(NamedTuple):
    """A verdict that changed of a file that did not."""

    name: str
    before: str
    after: str
    why: str  # what else changed: MuJoCo, the judge

    def __str__(self) -> str:
        """Return it in one line."""
        return f"{self.name}: {self.before} -> {self.after} ({self.why})"


def differences(before: Iterable[Entry], after: Iterable[Entry]) -> Iterator[Difference]:
    """Yield what changed of models that are the same file in both."""
    known = {entry.family[0]: entry for entry in before}
    for entry in after:
        old = known.get(entry.family[0])
        if old is None or old.digest != entry.digest or old.word == entry.word:
            continue
        causes = [
            f"MuJoCo {old.mujoco} -> {entry.mujoco}" if old.mujoco != entry.mujoco else "",
            "the judge's code" if old.judge != entry.judge else "",
        ]
        why = ", ".join(filter(None, causes)) or "nothing that is known"
        yield Difference(entry.name, old.word, entry.word, why)
