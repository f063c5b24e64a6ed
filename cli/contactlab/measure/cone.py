"""The friction bound in its own norm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats, PairTrace

Complexes = NDArray[np.complex128]
"""Numbers two by two: components along two tangents, or just neighbours that move as one."""


@dataclass(frozen=True)
class Cone:
    """Friction bound of one pair in one run.

    Attributes:
        friction: coefficient along the first tangent.
        stretch: that coefficient over the one along the second tangent.
        elliptic: whether the bound is on the 2-norm; else on the 1-norm.
    """

    friction: float
    stretch: float
    elliptic: bool

    def norm(self, force: Complexes, astray: Floats | None = None) -> Floats:
        """Return what the bound holds below friction times normal force.

        Args:
            force: tangential forces [N].
            astray: squared force [N^2] across the tangent plane, which only the 2-norm counts.
        """
        across = force.imag if self.stretch == 1 else force.imag * self.stretch
        if not self.elliptic:
            return np.abs(force.real) + np.abs(across)
        square = force.real * force.real + across * across
        return np.sqrt(square if astray is None else square + astray)


def cones(pair: PairTrace, elliptic: NDArray[np.bool_]) -> list[Cone]:
    """Return the friction bound of a pair in every run."""
    first, second = pair.friction[:, 0], pair.friction[:, 1]
    stretch = np.where(first == second, 1, first / second)
    rows = zip(first.tolist(), stretch.tolist(), elliptic.tolist(), strict=True)
    return [Cone(*row) for row in rows]
