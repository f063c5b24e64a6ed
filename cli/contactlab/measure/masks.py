"""Where a mask holds: in which runs, and from which step."""

import numpy as np
from numpy.typing import NDArray


def runs_where(mask: NDArray[np.bool_]) -> list[int]:
    """Return the runs in which a mask (n,) holds."""
    return np.flatnonzero(mask).tolist()


def first_step(mask: NDArray[np.bool_]) -> int:
    """Return the first step in which a mask (N,) holds; 0 if none."""
    return int(mask.argmax())
