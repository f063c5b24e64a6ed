"""Metrics and labels of traces. A plug-in declares its own with the decorators exported here."""

# The order of these imports is the order of metrics, and so of columns.
# isort: off
from contactlab.measure import penetration, motion, soft_contact, friction
from contactlab.measure import grasp_hold, solver_work, oracle_error
from contactlab.measure import run_integrity, backward_error, constraint_violation
from contactlab.measure import energy_balance, friction_oracles, recorded_motion
from contactlab.measure import required_contact, required_motion, requirement_margin

# isort: on
from contactlab.contact.trace_arrays import Floats as Floats
from contactlab.measure.assessment import AppliedLabel as AppliedLabel
from contactlab.measure.assessment import Assessment as Assessment
from contactlab.measure.assessment import assess_runs as assess_runs
from contactlab.measure.context import Context as Context
from contactlab.measure.context import cached as cached
from contactlab.measure.context import contact_depths as contact_depths
from contactlab.measure.context import context_of as context_of
from contactlab.measure.context import first_step as first_step
from contactlab.measure.context import runs_where as runs_where
from contactlab.measure.context import worst_pair as worst_pair
from contactlab.measure.entries import LABELS as LABELS
from contactlab.measure.entries import METRICS as METRICS
from contactlab.measure.entries import ORACLES as ORACLES
from contactlab.measure.entries import THRESHOLDS as THRESHOLDS
from contactlab.measure.entries import Label as Label
from contactlab.measure.entries import MeasuredRuns as MeasuredRuns
from contactlab.measure.entries import Metric as Metric
from contactlab.measure.entries import Onset as Onset
from contactlab.measure.entries import OnsetIterator as OnsetIterator
from contactlab.measure.entries import Onsets as Onsets
from contactlab.measure.entries import Requirement as Requirement
from contactlab.measure.entries import Severity as Severity
from contactlab.measure.entries import Threshold as Threshold
from contactlab.measure.entries import added_labels as added_labels
from contactlab.measure.entries import label as label
from contactlab.measure.entries import labels_with as labels_with
from contactlab.measure.entries import metric as metric
from contactlab.measure.entries import oracle as oracle
from contactlab.measure.entries import threshold_values as threshold_values
from contactlab.measure.run_integrity import STABLE as STABLE
from contactlab.registry import settle

TOPICS = (
    *(penetration, motion, soft_contact, friction, grasp_hold, solver_work, oracle_error),
    *(run_integrity, backward_error, constraint_violation, energy_balance, friction_oracles),
    *(recorded_motion, required_contact, required_motion, requirement_margin),
)
"""Modules that declare metrics, labels and oracles, in the order of the table's columns."""

settle()
