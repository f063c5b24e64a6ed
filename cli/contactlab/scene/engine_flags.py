"""Engine switches by name: MuJoCo's disable and enable bits, whichever this version has.

Each is an effect of the same name.
"""

from collections.abc import Mapping
from typing import Any

import mujoco

# These serve the recording itself: sensors carry the evidence, an automatic reset would hide a
# divergence, and the energy flag makes the kinetic energy sensor lag a step.
_FIXED = {"sensor": True, "autoreset": False, "energy": False, "fwdinv": False}
# Override puts the options' contact parameters over those of every geom, and so over a sweep's.
_UNSUPPORTED = {"ipc", "override"}


def _bits(enum: Any, prefix: str) -> dict[str, int]:  # noqa: ANN401 - a pybind11 enum
    return {
        name.removeprefix(prefix).lower(): int(bit)
        for name, bit in enum.__members__.items()
        if name.startswith(prefix)
    }


_DISABLE = _bits(mujoco.mjtDisableBit, "mjDSBL_")
_ENABLE = _bits(mujoco.mjtEnableBit, "mjENBL_")
FLAGS = tuple(sorted((_DISABLE.keys() | _ENABLE.keys()) - _FIXED.keys() - _UNSUPPORTED))


def read_flags(model: mujoco.MjModel) -> dict[str, bool]:
    """Return every switch of a model; True means that the effect is on."""
    return {name: read_flag(model, name) for name in sorted(_DISABLE | _ENABLE)} | _FIXED


def read_flag(model: mujoco.MjModel, name: str) -> bool:
    """Return one switch of a model; True means that the effect is on."""
    if name in _DISABLE:
        return not int(model.opt.disableflags) & _DISABLE[name]
    return bool(int(model.opt.enableflags) & _ENABLE[name])


def non_default(states: Mapping[str, bool]) -> dict[str, bool]:
    """Return the switches that are not as MuJoCo's options default to.

    An engine that does not know a switch yet behaves as with its default, so that what is left
    is the same for every engine version.
    """
    return {name: state for name, state in states.items() if state != (name in _DISABLE)}


def write_flags(model: mujoco.MjModel, states: Mapping[str, bool]) -> None:
    """Set the given switches, and those that recording needs."""
    for name, state in {**states, **_FIXED}.items():
        if name in _DISABLE:
            model.opt.disableflags = _with(int(model.opt.disableflags), _DISABLE[name], not state)
        else:
            model.opt.enableflags = _with(int(model.opt.enableflags), _ENABLE[name], state)


def _with(flags: int, bit: int, state: bool) -> int:
    return flags | bit if state else flags & ~bit
