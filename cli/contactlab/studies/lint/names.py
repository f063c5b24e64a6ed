"""Name rules: parts that must be found by a number, since they have no name."""

from collections.abc import Iterator

from contactlab.scene.model_names import is_address
from contactlab.scene.task import keyframe_names
from contactlab.studies.lint.linted_model import Edit, Fault, LintedModel
from contactlab.studies.lint.rules import rule

_REFERRED = {"actuator": "controls", "key": "resets"}


@rule("unnamed", "note")
def find_unnamed_parts(linted: LintedModel) -> Iterator[Fault]:
    """Actuators or keyframes have no name, so that programs refer to them by a number.

    Another actuator moves the number. Fix: a name for each.
    """
    for kind, users in _REFERRED.items():
        if kind == "key":
            names = keyframe_names(linted.model)
        else:
            names = [linted.name(kind, index) for index in range(linted.model.nu)]
        nameless = [name for name in names if is_address(name)]
        if nameless:
            edits = dict[Edit, None]()
            for name in nameless:
                own = name.replace("[", "_").replace("]", "")
                edits |= dict.fromkeys(linted.set(kind, name, name=own))
            number = (
                f"{len(nameless)} of {len(names)} {kind}s have"
                if len(names) > 1
                else f"the {kind} has"
            )
            yield Fault(
                f"{number} no name, so that {users} count on the order of elements",
                linted.place(kind, nameless[0]),
                tuple(edits),
            )
