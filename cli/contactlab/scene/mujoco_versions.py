"""Features that the installed version of MuJoCo lacks, and the versions that introduced them.

Tried on every release from 3.3.0 to 4.0.0: each has what its enums name.
"""

import ctypes
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from contactlab.schema.vocabulary import AxisSpec

VERSION: str = mujoco.__version__
_BATCH = "3.17.0"


@dataclass(frozen=True)
class NewFeature:
    """A value of an axis, or a state of a flag, that MuJoCo has since a version."""

    axis: str
    value: str | bool
    version: str


NEW_FEATURES = (
    NewFeature("spring", False, "3.3.6"),
    NewFeature("damper", False, "3.3.6"),
    NewFeature("sleep", True, "3.4.0"),
    NewFeature("diagexact", True, "3.9.0"),
    NewFeature("integrator", "discrete", "3.13.0"),
    NewFeature("speculative", True, "4.0.0"),
)


# As a switch takes them.
_STATES: dict[str | bool, tuple[str, ...]] = {True: ("true", "on"), False: ("false", "off")}


def enum_members(enum: Any, prefix: str) -> dict[str, int]:  # noqa: ANN401 - a pybind11 enum
    """Return the members of one of MuJoCo's enums without their prefix, in its order."""
    return {
        name.removeprefix(prefix): int(value)
        for name, value in enum.__members__.items()
        if name.startswith(prefix)
    }


def has_batch() -> bool:
    """Return whether MuJoCo steps many simulations natively.

    Its contact sensors measure all that a contact slot records since the version before.
    """
    return _reaches(_BATCH)


def library_file() -> Path:
    """Return MuJoCo's shared library.

    That of another release may lie beside it: 4.0.0 is two packages, of which installing an older
    release replaces one.
    """
    (library,) = Path(mujoco.__file__).parent.glob(f"libmujoco*.so*{mujoco.__version__}")
    return library


def missing_flags() -> frozenset[str]:
    """Return the flags that this version lacks; it behaves as with their defaults."""
    return frozenset(feature.axis for feature in _unsupported() if isinstance(feature.value, bool))


def incomplete_axes() -> frozenset[str]:
    """Return the axes of which this version lacks a value."""
    return frozenset(feature.axis for feature in _unsupported())


def why_unsupported(axis: str, value: object) -> str | None:
    """Return why this version lacks a value of an axis; None if it is not known to."""
    lacking = _lacking(axis, value)
    if lacking is None:
        return None
    what = f"{axis} '{lacking.value}'" if isinstance(lacking.value, str) else f"flag '{axis}'"
    return (
        f"MuJoCo {VERSION} has no {what}, which came with {lacking.version}; "
        f"leave it out, or run with --mujoco {lacking.version}"
    )


def in_this_version(axis: AxisSpec, *, lenient: bool) -> AxisSpec:
    """Return an axis that refuses what this version lacks, naming the version that has it.

    A lenient one accepts it, for plans that then drop it.
    """

    def parse(value: object) -> object:
        lacking = _lacking(axis.name, value)
        if lacking and not lenient:
            raise ValueError(why_unsupported(axis.name, value))
        return lacking.value if lacking else axis.parse(value)

    return replace(axis, parse=parse) if axis.name in incomplete_axes() else axis


def _lacking(axis: str, value: object) -> NewFeature | None:
    known = (feature for feature in _unsupported() if feature.axis == axis)
    word = str(value).lower()
    return next(
        (feature for feature in known if word in _STATES.get(feature.value, (feature.value,))), None
    )


def _unsupported() -> list[NewFeature]:
    return [feature for feature in NEW_FEATURES if not _reaches(feature.version)]


def _reaches(version: str) -> bool:
    return _parts(VERSION) >= _parts(version)


@cache
def _parts(version: str) -> tuple[int, ...]:
    """Return the first three numbers of a version such as 4.0.1.dev2."""
    return tuple(int(part) for part in version.split(".")[:3] if part.isdigit())


def silence_mujoco() -> None:
    """Keep MuJoCo from writing MUJOCO_LOG.TXT and messages; runs count its warnings anyway."""
    if hasattr(mujoco, "MjLogConfig"):
        config = mujoco.MjLogConfig.get()
        config.logto_file = config.logto_console = False
        config.set()
    else:
        _install_warning_handler()


@cache
def _install_warning_handler() -> object:
    """Install a warning handler, for versions before 3.10, whose log cannot be configured.

    The cache keeps the function alive that MuJoCo calls.
    """
    ignore = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda _: None)
    handler = ctypes.c_void_p.in_dll(ctypes.CDLL(str(library_file())), "mju_user_warning")
    handler.value = ctypes.cast(ignore, ctypes.c_void_p).value
    return ignore
