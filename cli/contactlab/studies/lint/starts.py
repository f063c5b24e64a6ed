"""Start rules: poses and controls outside of ranges, and angles in the wrong unit."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.angle_units import MIN_LIMITED_HINGES, find_radian_angles, limited_hinges
from contactlab.scene.keyframes import start_data
from contactlab.scene.model_text import mjcf_text
from contactlab.scene.task import keyframe_names
from contactlab.schema.task import QPOS0
from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule
from contactlab.studies.lint.static_equilibrium import is_in_equilibrium, limit_rows

_JOINT = mujoco.mjtJoint


class _Beyond(NamedTuple):
    """A number outside of its range, and its index among those of its kind."""

    name: str
    value: float
    low: float
    high: float
    place: int
    is_held: bool = False  # held there by loads

    @property
    def nearest(self) -> float:
        """The end of the range that it passed."""
        return self.low if self.value < self.low else self.high

    def __str__(self) -> str:
        return f"{self.name} at {self.value:.4g}, outside of {self.low:.4g} to {self.high:.4g}"


def _joints_out_of_range(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[_Beyond]:
    """Yield the slides and hinges beyond their ranges at a start, if their limits act."""
    scalar = np.isin(model.jnt_type, (int(_JOINT.mjJNT_SLIDE), int(_JOINT.mjJNT_HINGE)))
    # Limits are soft, so a joint at rest against one lies slightly beyond it.
    soft_share = 0.01  # of the range
    for joint in np.flatnonzero(scalar & (model.jnt_limited != 0)).tolist():
        low, high = model.jnt_range[joint].tolist()
        place = int(model.jnt_qposadr[joint])
        value, slack = float(data.qpos[place]), soft_share * (high - low)
        rows = limit_rows(data, joint)
        if rows is not None and not low - slack <= value <= high + slack:
            name, is_held = (
                f"joint '{model.joint(joint).name}'",
                is_in_equilibrium(model, data, rows),
            )
            yield _Beyond(name, value, low, high, place, is_held=is_held)


def _pushed_back(model: mujoco.MjModel, data: mujoco.MjData) -> list[_Beyond]:
    """Return the joints that their limits push back, without a load that holds them."""
    return [one for one in _joints_out_of_range(model, data) if not one.is_held]


def largest_excess(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return how far a start pushes a joint beyond its range, as a share of the range."""
    excesses = _pushed_back(model, data)
    return max(
        (abs(one.value - one.nearest) / (one.high - one.low) for one in excesses), default=0.0
    )


def _list_text(excesses: list[_Beyond]) -> str:
    more = f"; and {len(excesses) - 1} more" if len(excesses) > 1 else ""
    return f"{excesses[0]}{more}"


def _clip_text(values: Floats, excesses: list[_Beyond]) -> str:
    """Return values with the given ones moved to the ends of their ranges, as MJCF text."""
    inside = np.array(values)
    for one in excesses:
        inside[one.place] = one.nearest
    return mjcf_text(inside.tolist())


@rule("keyframe-length", "gate")
def find_keyframes_of_wrong_length(linted: LintedModel) -> Iterator[Fault]:
    """A keyframe has another count of numbers than the model.

    MuJoCo appends reference values, or zeros, so the values after an inserted joint act on other
    joints. Other rules do not judge such a keyframe, and an examination that starts from it offers
    no other fix. Fix: the missing numbers, at their places.
    """
    for name, short in linted.short_keyframes.items():
        rest = f"those of {QPOS0}" if short.attribute == "qpos" else "zeros"
        yield Fault(
            f"keyframe '{name}' has {short.length} numbers in {short.attribute}, and the model "
            f"{short.needed}: MuJoCo appends {rest}, so values may act on other joints than meant; "
            f"write {short.needed}",
            short.place,
        )


KEYFRAME_RANGE = "keyframe-range"


@rule(KEYFRAME_RANGE, "gate")
def find_keyframes_out_of_range(linted: LintedModel) -> Iterator[Fault]:
    """A keyframe puts joints outside of their ranges.

    A slide or hinge is beyond its range by more than a hundredth of it, and the joint has at least
    half of the acceleration that the limit asks for. A joint that rests on its soft limit passes.
    Keyframes that `<size nkey>` only reserves are the reference pose. Fix: a pose within the
    ranges; no `nkey`.
    """
    model = linted.model
    for name, data in linted.starts.items():
        if name == QPOS0:
            continue
        if excesses := _pushed_back(model, data):
            edits = linted.set("key", name, qpos=_clip_text(data.qpos, excesses))
            message = (
                f"keyframe '{name}' has {_list_text(excesses)}; the limits push it back at once"
            )
            yield Fault(message, linted.place("key", name), edits)
    reserved = model.nkey - len(keyframe_names(model))
    if reserved and (excesses := _pushed_back(model, linted.reference)):
        count = f"{reserved} keyframes are" if reserved > 1 else "a keyframe is"
        message = f"{count} reserved by nkey, at {QPOS0}, which has {_list_text(excesses)}"
        yield Fault(message, linted.place_of("size"), linted.set_in("size", nkey="0"))


@rule("keyframe-control", "warn")
def find_controls_out_of_range(linted: LintedModel) -> Iterator[Fault]:
    """A keyframe has controls outside of their ranges, which are clamped.

    Fix: the control that acts.
    """
    model = linted.model
    is_unclamped = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    if is_unclamped or model.nu != len(model.actuator_ctrllimited):
        return
    for name in keyframe_names(model):
        if name in linted.short_keyframes or not len(linted.spec.key(name).ctrl):
            continue  # not written in the file
        controls, excesses = start_data(model, name).ctrl, list[_Beyond]()
        for place in np.flatnonzero(model.actuator_ctrllimited).tolist():
            low, high = model.actuator_ctrlrange[place].tolist()
            value, slack = float(controls[place]), COARSE_ROUNDING * (high - low)
            if not low - slack <= value <= high + slack:
                actuator = f"actuator '{model.actuator(place).name}'"
                excesses.append(_Beyond(actuator, value, low, high, place))
        if excesses:
            edits = linted.set("key", name, ctrl=_clip_text(controls, excesses))
            message = f"keyframe '{name}' has {_list_text(excesses)}; what acts is clamped"
            yield Fault(message, linted.place("key", name), edits)


@rule("qpos0-range", "note")
def find_qpos0_out_of_range(linted: LintedModel) -> Iterator[Fault]:
    """The reference pose is outside of joints' ranges, and no keyframe gives another start.

    Many robots are drawn so. Fix: a keyframe within the ranges.
    """
    model = linted.model
    excesses = [] if keyframe_names(model) else list(_joints_out_of_range(model, linted.reference))
    if excesses:
        joint = int(np.searchsorted(model.jnt_qposadr, excesses[0].place, "right")) - 1
        frames = ET.Element("keyframe")
        ET.SubElement(frames, "key", name="start", qpos=_clip_text(model.qpos0, excesses))
        message = f"{QPOS0} has {_list_text(excesses)}; start from a keyframe, or set `ref`"
        yield Fault(message, linted.place("joint", joint), linted.add(frames))


@rule("radians-as-degrees", "warn", voids_runs=True)
def find_radians_as_degrees(linted: LintedModel) -> Iterator[Fault]:
    """Ranges of joints are in radians, where the compiler reads degrees.

    More than half of the limited hinges, two at least, turn by less than 15 degrees, by numbers
    below 2 pi. Fix: `<compiler angle="radian"/>`.
    """
    if linted.is_urdf or not linted.spec.compiler.degree:
        return
    for joint, message in find_radian_angles(linted.model):
        edits = linted.set_in("compiler", angle="radian")
        yield Fault(message, linted.place("joint", joint), edits)


@rule("degrees-as-radians", "warn", voids_runs=True)
def find_degrees_as_radians(linted: LintedModel) -> Iterator[Fault]:
    """Ranges of joints are in degrees, where the compiler reads radians.

    More than half of the limited hinges turn by more than four turns, by numbers up to 360; a
    single one by multiples of 5, as people write degrees. A URDF always has radians. Fix:
    `<compiler angle="degree"/>`.
    """
    hinges, model = limited_hinges(linted.model), linted.model
    if linted.spec.compiler.degree and not linted.is_urdf:
        return
    is_round = not (model.jnt_range[hinges] % 5).any()
    if len(hinges) < MIN_LIMITED_HINGES and not is_round:
        return
    wide_turn = 8 * math.pi  # four turns
    wide = [joint for joint in hinges if np.ptp(model.jnt_range[joint]) > wide_turn]
    if 2 * len(wide) > len(hinges) and np.abs(model.jnt_range[wide]).max() <= 360:
        first = linted.name("joint", wide[0])
        low, high = model.jnt_range[wide[0]].tolist()
        unit = "URDF has radians" if linted.is_urdf else "the compiler reads radians"
        yield Fault(
            f"{len(wide)} of {len(hinges)} hinges turn by more than four turns, as joint '{first}' "
            f"from {low:.4g} to {high:.4g} rad: these numbers are degrees, and {unit}",
            linted.place("joint", wide[0]),
            linted.set_in("compiler", angle="degree"),
        )
