"""What constraints gave and took is read off the books of a run, whatever made them."""

from collections.abc import Callable

import numpy as np
import pytest

from contactlab.contact.trace_arrays import ACTUATORS, CONSTRAINTS, Trace
from contactlab.contact.trace_setup import Setup
from contactlab.measure import assess_runs
from contactlab.measure.context import context_of
from contactlab.measure.energy_balance import constraint_loss

MakeTrace = Callable[..., Trace]
MakeSetup = Callable[..., Setup]
# The most kinetic energy [J], far above what lifts 1 kg by 1 mm; the steps in which forces act.
MOST, STEPS, FIRST, LAST = 8.0, 40, 10, 19


def booked(
    trace_of: MakeTrace, before: float, by_constraints: float, by_actuators: float, stored: float
) -> Trace:
    """Return a run that begins with a share of the most energy, and changes by others, evenly.

    Before they acted, constraints had stored a share, too.
    """
    work, acting = np.zeros((1, STEPS, 3)), slice(FIRST, LAST + 1)
    work[0, acting, CONSTRAINTS] = by_constraints * MOST / (LAST + 1 - FIRST)
    work[0, acting, ACTUATORS] = by_actuators * MOST / (LAST + 1 - FIRST)
    energy = before * MOST + np.concatenate([[0.0], np.cumsum(work[0].sum(axis=1))])
    given = np.array([[FIRST, LAST, stored * MOST, 0.0]])
    return trace_of(steps=STEPS, kinetic=energy[None, :-1], work=work, constraint_gain=given)


@pytest.mark.parametrize("pushed", [0.0, 0.25])
@pytest.mark.parametrize("stored", [0.125, 0.5, 0.75])
def test_constraints_give_what_they_had_not_stored(
    trace_of: MakeTrace, setup_of: MakeSetup, stored: float, pushed: float
) -> None:
    """Energy rises from 0 to the most; of it an actuator gave a share, and a spring had another."""
    trace = booked(trace_of, 0.0, 1 - pushed, pushed, stored)
    setup = setup_of(trace, passive=False, settings={"integrator": ["Euler"]})
    found = assess_runs(trace, setup).metrics
    assert found["constraint_gain"] == pytest.approx([1 - pushed - stored])


@pytest.mark.parametrize("taken", [-0.5, 0.25, 1.0])
def test_constraints_take_what_nothing_else_did(
    trace_of: MakeTrace, setup_of: MakeSetup, taken: float
) -> None:
    """Of what is passive and never touches; a contact may take what it likes."""
    trace = booked(trace_of, min(1.0, 1 + taken), -taken, 0.0, 0.0)
    settings = {"integrator": ["Euler"]}
    setup = setup_of(trace, passive=True, settings=settings)
    assert constraint_loss(context_of(trace, setup)) == pytest.approx([taken])
    driven = setup_of(trace, passive=False, settings=settings)
    assert np.isnan(constraint_loss(context_of(trace, driven))).all()
    trace.contacts[0, 3] = 1
    assert constraint_loss(context_of(trace, setup)).tolist() == [0.0]
