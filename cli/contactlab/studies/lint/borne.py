"""Whether a start throws back what lies beyond a limit or in another body, or loads hold it there.

A constraint that is violated asks for an acceleration, `efc_aref`. Where a start is one at rest, as
of a lid on its stop or a handle in closed fingers, loads and other constraints balance it, and next
to no acceleration comes of it; where nothing does, nearly all of it.
"""

import mujoco
import numpy as np

_THROWN = 0.5  # share of the acceleration asked for: a start at rest has 0, a free one about 1


def is_borne(model: mujoco.MjModel, data: mujoco.MjData, rows: slice) -> bool:
    """Return whether loads hold what the mean of some rows of constraints would push back.

    The data is from `mj_forward`. What moves deeper or out is not at rest.
    """
    came = np.empty(data.nefc)
    mujoco.mj_mulJacVec(model, data, came, data.qacc)
    asked = float(data.efc_aref[rows].mean())
    return bool(asked > 0 and came[rows].mean() < _THROWN * asked)


def limit_rows(data: mujoco.MjData, joint: int) -> slice | None:
    """Return the row of a joint's limit, if it acts."""
    limits = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
    rows = np.flatnonzero(limits & (data.efc_id == joint))
    return slice(int(rows[0]), int(rows[0]) + 1) if rows.size else None


def contact_rows(model: mujoco.MjModel, data: mujoco.MjData, contact: int) -> slice | None:
    """Return the rows of a contact whose mean is along its normal, if it acts."""
    first, size = int(data.contact.efc_address[contact]), int(data.contact.dim[contact])
    if first < 0:
        return None
    elliptic = size == 1 or model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    return slice(first, first + (1 if elliptic else 2 * (size - 1)))
