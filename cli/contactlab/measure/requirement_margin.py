"""The margin by which runs meet what `must` says of them."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.context import Context
from contactlab.measure.entries import limits, metric
from contactlab.measure.required_contact import MODE_HOLD, contact_margins
from contactlab.measure.required_motion import motion_margins


@metric("1", "higher", 1e-9, kind="detail")
def requirement_margin(context: Context) -> Floats:
    """The least of what is left of any limit that `must` sets, as a share of it.

    1 where nothing of any is used, negative where one is exceeded: docs/driving.md says what is
    measured of each word. Not defined where nothing is required, or a state is no number.
    """
    hold = limits(context.setup.thresholds)[MODE_HOLD.name]
    least = np.minimum(motion_margins(context, hold), contact_margins(context, hold))
    return np.where(np.isfinite(least), least, np.nan)
