"""What a second, untimed pass over a group of runs found."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.arrays import Floats


@dataclass(frozen=True)
class Checks:
    """Self-checks of n runs, of N steps; those that do not apply to a run are NaN.

    Attributes:
        residual: (n, N) how far forces and accelerations contradict each other, over the largest
            constraint force of the run [1]; 0 to rounding for a solver that converged.
        jacobian: (n, K) relative difference of the accelerations that a dense and a sparse
            constraint Jacobian give, at sampled states [1].
        jacobian_steps: (K,) the steps of these states.
        overlap: (n, L) deepest geometric overlap of a graded pair that has no contact [m].
        apart: (n, L) largest geometric distance of a graded pair whose contact says less [m].
        geometry_steps: (L,) the steps of these states.
        repeats: (n,) whether a second rollout gave every state again, bit for bit.
    """

    residual: Floats
    jacobian: Floats
    jacobian_steps: NDArray[np.intp]
    overlap: Floats
    apart: Floats
    geometry_steps: NDArray[np.intp]
    repeats: NDArray[np.bool_]

    @property
    def runs(self) -> int:
        """How many runs were checked."""
        return len(self.repeats)
