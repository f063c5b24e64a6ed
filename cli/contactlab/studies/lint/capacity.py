"""Memory rule: whether the contacts of a start fit into the reserved memory."""

from collections.abc import Iterator

import mujoco

from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule

_FULL = tuple(
    int(getattr(mujoco.mjtWarning, f"mjWARN_{name}")) for name in ("CONTACTFULL", "CNSTRFULL")
)


@rule("memory", "gate")
def find_full_memory(linted: LintedModel) -> Iterator[Fault]:
    """The model reserves too little memory for the contacts of its own start.

    Dropped contacts, or more than half of its own setting used at the start. Fix: `<size
    memory="-1"/>`.
    """
    model = linted.model
    most_share = 0.5  # a motion that uses a larger share of the memory soon needs more
    for start, data in linted.starts.items():
        lost = any(data.warning[kind].number for kind in _FULL)
        if lost or (linted.spec.memory > 0 and data.maxuse_arena > most_share * model.narena):
            usage_text = "contacts are dropped" if lost else f"{data.maxuse_arena:,} bytes are used"
            yield Fault(
                f"memory is {model.narena:,} bytes, and at {start} {usage_text}: more contacts are "
                "lost",
                linted.place_of("size"),
                linted.set_in("size", memory="-1"),
            )
            return
