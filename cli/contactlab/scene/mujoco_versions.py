"""Features that the installed version of MuJoCo lacks, and the versions that introduced them.

Checked on every release from 3.3.0 to 4.0.0: each release has the features that its enums name.
"""

import ctypes
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from contactlab.schema.advisory import numbers_of
from contactlab.schema.vocabulary import AxisSpec

VERSION: str = mujoco.__version__
_BATCH_VERSION = "3.17.0"


@dataclass(frozen=True)
class NewFeature:
    """A value of an axis, or a state of a flag, that MuJoCo has had since a version."""

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


# Words that a switch accepts.
_SWITCH_WORDS: dict[str | bool, tuple[str, ...]] = {True: ("true", "on"), False: ("false", "off")}


def enum_members(enum: Any, prefix: str) -> dict[str, int]:  # noqa: ANN401 - a pybind11 enum
    """Return the members of a MuJoCo enum without their prefix, in its order."""
    return {
        name.removeprefix(prefix): int(value)
        for name, value in enum.__members__.items()
        if name.startswith(prefix)
    }


def has_batch() -> bool:
    """Return whether MuJoCo steps many simulations natively.

    The version before it introduced contact sensors that measure everything in a contact slot.
    """
    return _is_at_least(_BATCH_VERSION)


def library_file() -> Path:
    """Return MuJoCo's shared library.

    The library of another release may lie in the same folder: 4.0.0 consists of two packages, and
    installing an older release replaces only one of them.
    """
    (library,) = Path(mujoco.__file__).parent.glob(f"libmujoco*.so*{mujoco.__version__}")
    return library


def missing_flags() -> frozenset[str]:
    """Return the flags that this version lacks; it behaves as with their default values."""
    return frozenset(
        feature.axis for feature in _unsupported_features() if isinstance(feature.value, bool)
    )


def incomplete_axes() -> frozenset[str]:
    """Return the axes with a value that this version lacks."""
    return frozenset(feature.axis for feature in _unsupported_features())


def why_unsupported(axis: str, value: object) -> str | None:
    """Return why this version lacks a value of an axis; None if it is not known to lack it."""
    lacking = _missing_feature(axis, value)
    if lacking is None:
        return None
    feature = f"{axis} '{lacking.value}'" if isinstance(lacking.value, str) else f"flag '{axis}'"
    return (
        f"MuJoCo {VERSION} has no {feature}, which came with {lacking.version}; "
        f"remove it, or run with --mujoco {lacking.version}"
    )


def in_this_version(axis: AxisSpec, *, lenient: bool) -> AxisSpec:
    """Return an axis that refuses values missing in this version, naming the version that has them.

    A lenient axis accepts them, for plans that drop them later.
    """

    def parse(value: object) -> object:
        lacking = _missing_feature(axis.name, value)
        if lacking and not lenient:
            raise ValueError(why_unsupported(axis.name, value))
        return lacking.value if lacking else axis.parse(value)

    return replace(axis, parse=parse) if axis.name in incomplete_axes() else axis


def _missing_feature(axis: str, value: object) -> NewFeature | None:
    features_of_axis = (feature for feature in _unsupported_features() if feature.axis == axis)
    word = str(value).lower()
    return next(
        (
            feature
            for feature in features_of_axis
            if word in _SWITCH_WORDS.get(feature.value, (feature.value,))
        ),
        None,
    )


def _unsupported_features() -> list[NewFeature]:
    return [feature for feature in NEW_FEATURES if not _is_at_least(feature.version)]


def _is_at_least(version: str) -> bool:
    return numbers_of(VERSION) >= numbers_of(version)


def silence_mujoco() -> None:
    """Keep MuJoCo from writing MUJOCO_LOG.TXT and messages; runs count its warnings anyway.

    It stops timing its own stages, too, which takes a seventh of the steps of a small model. A
    timer that a program installed stays.
    """
    if mujoco.get_mjcb_time() is None:
        _find_timer().value = None
    if hasattr(mujoco, "MjLogConfig"):
        config = mujoco.MjLogConfig.get()
        config.logto_file = config.logto_console = False
        config.set()
    else:
        _install_warning_handler()


@cache
def _find_timer() -> ctypes.c_void_p:
    # MuJoCo's Python package installs a native timer, and offers no way to remove it.
    return ctypes.c_void_p.in_dll(ctypes.CDLL(str(library_file())), "mjcb_time")


@cache
def _install_warning_handler() -> object:
    """Install a warning handler for versions before 3.10, which have no log configuration.

    The cache keeps a reference to the function that MuJoCo calls.
    """
    ignore = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda _: None)
    handler = ctypes.c_void_p.in_dll(ctypes.CDLL(str(library_file())), "mju_user_warning")
    handler.value = ctypes.cast(ignore, ctypes.c_void_p).value
    return ignore
