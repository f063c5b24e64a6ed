"""Margins of runs to the requirements in `must`."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.context import Context
from contactlab.measure.entries import metric, threshold_values
from contactlab.measure.required_contact import MODE_HOLD, contact_margins
from contactlab.measure.required_motion import motion_margins


@metric("1", "higher", 1e-9, kind="detail")
def requirement_margin(context: Context) -> Floats:
    """The least remaining margin of any limit in `must`, as a share of the limit.

    It is 1 if no limit is used at all, negative if one is exceeded; docs/how-to/driving.md lists
    the measured quantity of each word. Not defined without requirements, or if a state is NaN.
    """
    hold = threshold_values(context.setup.thresholds)[MODE_HOLD.name]
    least = np.minimum(motion_margins(context, hold), contact_margins(context, hold))
    return np.where(np.isfinite(least), least, np.nan)
