"""The object of a grip, read from an option: `box:30x40x40mm,.1kg`."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from contactlab.errors import SceneError, SweepFileError

_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_MASSES = {"kg": 1.0, "g": 1e-3}
_NUMBER = r"\d*\.?\d+(?:e-?\d+)?"
_SHAPE = re.compile(
    rf"(?P<shape>box|cylinder):(?P<sizes>{_NUMBER}(?:x{_NUMBER})*)(?P<unit>mm|cm|m)"
    rf"(?:,(?P<mass>{_NUMBER})(?P<weight>kg|g))?"
)
_MESH = re.compile(rf"mesh:(?P<file>.+?)(?:,(?P<mass>{_NUMBER})(?P<weight>kg|g))?")
_DEFAULT_MASS = 0.1  # kg


@dataclass(frozen=True)
class GrippedObject:
    """A body that fingers close on.

    Attributes:
        shape: kind of shape; a body of the model keeps everything from its file.
        size: (3,) extents [m], from finger to finger first; zeros if a file defines them.
        mass: [kg]; NaN for a body of the model.
        name: mesh file, or body.
    """

    shape: Literal["box", "cylinder", "mesh", "body"]
    size: tuple[float, float, float]
    mass: float
    name: str = ""

    @property
    def words(self) -> str:
        """The object in words."""
        if self.shape == "body":
            return f"body {self.name}"
        weight = f"{self.mass:.3g} kg"
        if self.shape == "mesh":
            return f"{Path(self.name).name} of {weight}"
        shown_lengths = self.size if self.shape == "box" else self.size[::2]
        sizes = "x".join(f"{1e3 * length:.4g}" for length in shown_lengths)
        return f"a {self.shape} of {sizes} mm and {weight}"

    def scale_extents(self, factor: float) -> "GrippedObject":
        """Return the object with scaled extents; its mass, and a mesh or body, are unchanged."""
        across, second, third = (factor * length for length in self.size)
        return replace(self, size=(across, second, third))


DEFAULT_OBJECT = GrippedObject("box", (0.03, 0.04, 0.04), _DEFAULT_MASS)
"""The object of a gripper by default; smaller if the fingers open less."""


def read_object(text: str | None) -> GrippedObject:
    """Return the object of an option; a SceneError says how to write one."""
    if text is None:
        return DEFAULT_OBJECT
    if match := _SHAPE.fullmatch(text):
        shape = "box" if match["shape"] == "box" else "cylinder"
        lengths = [float(size) * _LENGTHS[match["unit"]] for size in match["sizes"].split("x")]
        mass = float(match["mass"]) * _MASSES[match["weight"]] if match["mass"] else _DEFAULT_MASS
        counts = {"box": 3, "cylinder": 2}
        if len(lengths) == counts[shape] and min(*lengths, mass) > 0:
            # A cylinder has two diameters across; its length is the third extent.
            first, *rest = lengths if shape == "box" else (lengths[0], *lengths)
            return GrippedObject(shape, (first, rest[0], rest[1]), mass)
    elif text.startswith("mesh:") and (match := _MESH.fullmatch(text)):
        mass = float(match["mass"]) * _MASSES[match["weight"]] if match["mass"] else _DEFAULT_MASS
        if not Path(match["file"]).is_file():
            raise SceneError(f"--object {text}: no file {match['file']}")
        return GrippedObject("mesh", (0.0, 0.0, 0.0), mass, str(Path(match["file"]).resolve()))
    elif ":" not in text:
        return GrippedObject("body", (0.0, 0.0, 0.0), np.nan, text)
    raise SceneError(
        f"--object {text}: write box:30x40x40mm,.1kg (from finger to finger first), "
        "cylinder:30x60mm,.1kg (diameter, length), mesh:FILE,.1kg, or a body of the model"
    )


_SPEED = re.compile(rf"(?P<speed>{_NUMBER})(?P<unit>mm|cm|m)/s")


def read_speed(value: float | str) -> float:
    """Return a speed [m/s], as typed or as a number; a SweepFileError says how to write one."""
    if isinstance(value, str):
        match = _SPEED.fullmatch(value)
        if match is None:
            raise SweepFileError(f"--tolerance {value}: write a speed, as in 0.1mm/s")
        value = float(match["speed"]) * _LENGTHS[match["unit"]]
    if not value > 0:
        raise SweepFileError(f"--tolerance {value}: write a speed above 0, as in 0.1mm/s")
    return value
