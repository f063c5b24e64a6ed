"""Ways to turn effects on and off: by a flag, by options, by the dimensions of contacts."""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from contactlab.scene.effects.effect import EffectMjcf, RunState, Switch
from contactlab.scene.effects.proofs import most_condim
from contactlab.scene.model_options import read_flag, read_option, write_flags, write_option
from contactlab.scene.setting_values import Settings

_REMOVE_TENDONS = (
    "in <tendon>, set no stiffness, damping, friction loss, armature or range; "
    "remove what no actuator, equality or sensor refers to"
)


def by_flag(name: str) -> Switch:
    """Return the switch of one of MuJoCo's flags."""
    return Switch(
        is_on=lambda run: read_flag(run.model, name),
        write=lambda model, on: write_flags(model, {name: on}),
        mjcf=lambda on: EffectMjcf(flags={name: on}),
        flag=name,
    )


def by_condim(least: int, most: int) -> Switch:
    """Return the switch of a friction effect, which is on where contacts have enough dimensions.

    Contacts take the larger condim of their two geoms, so that a bound on each geom bounds the
    contact.

    Args:
        least: dimensions that the effect needs.
        most: dimensions that are left without it.
    """

    def write(model: mujoco.MjModel, on: bool) -> None:
        bound, value = (np.maximum, least) if on else (np.minimum, most)
        for name in ("geom_condim", "pair_dim", "flex_condim"):
            array = getattr(model, name)
            array[:] = bound(array, value)

    return Switch(
        is_on=lambda run: most_condim(run.model) >= least,
        write=write,
        mjcf=lambda on: EffectMjcf(condim=least if on else most),
        settings=("condim",),
    )


def by_options(
    has: Callable[[Settings], bool], off: Mapping[str, object], on: Mapping[str, object]
) -> Switch:
    """Return the switch of an effect that is a matter of options.

    Args:
        has: returns whether settings have the effect.
        off: settings that turn it off.
        on: settings that turn it on where it is off; empty if none does by itself.
    """
    values = {True: on, False: off}

    def write(model: mujoco.MjModel, state: bool) -> None:
        for name, value in values[state].items():
            write_option(model, name, value)

    def fold(settings: Settings, state: bool) -> None:
        # Settings in this state already are kept: RK4 is as explicit as Euler.
        if has(settings) != state:
            settings.update(values[state])

    return Switch(
        is_on=lambda run: has(Settings({name: read_option(run.model, name) for name in off})),
        write=write,
        mjcf=lambda state: EffectMjcf({name: _text(each) for name, each in values[state].items()}),
        settings=tuple(off),
        fold=fold,
    )


def by_tendons() -> Switch:
    """Return the switch of tendons: idle ones are not compiled, others lose their coefficients."""

    def write(model: mujoco.MjModel, on: bool) -> None:
        for name in ("stiffness", "damping", "frictionloss", "armature", "limited"):
            if not on and hasattr(model, f"tendon_{name}"):
                getattr(model, f"tendon_{name}")[:] = 0

    return Switch(
        is_on=lambda run: run.facts.tendons > 0,
        write=write,
        mjcf=lambda on: EffectMjcf(comment=None if on else _REMOVE_TENDONS),
    )


def by_compiling(compiled: Callable[[RunState], bool], remove: str | None = None) -> Switch:
    """Return the switch of sensors, which are compiled or not.

    Args:
        compiled: returns whether they were compiled.
        remove: how to remove the model's own by hand.
    """
    return Switch(
        is_on=compiled,
        write=lambda *_: None,
        mjcf=lambda on: EffectMjcf(comment=None if on else remove),
    )


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{part:g}" for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
