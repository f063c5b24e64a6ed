"""How entries of the table of effects are made."""

from contactlab.scene.effects import turning
from contactlab.scene.effects.effect import Effect, Kind
from contactlab.scene.effects.unused import Proof


def switch(
    name: str,
    kind: Kind,
    what: str,
    called_by: str,
    unused: Proof,
    *,
    changes: bool = True,
) -> Effect:
    """Return the effect of an engine switch, which has its name."""
    return Effect(
        name=name,
        kind=kind,
        what=what,
        switch=f"flag {name}",
        called_by=called_by,
        changes=changes,
        is_on=turning.flag_is_on(name),
        turn=turning.turn_flag(name),
        unused=unused,
    )


def friction(name: str, what: str, switch: str, called_by: str, unused: Proof) -> Effect:
    """Return a friction effect, which bounds the dimensions of contacts."""
    return Effect(
        name=name,
        kind="physical",
        what=what,
        switch=switch,
        called_by=called_by,
        changes=True,
        is_on=turning.has_dims(name),
        turn=turning.turn_dims(name),
        unused=unused,
        touches=("condim",),
    )
