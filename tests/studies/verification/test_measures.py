"""A measure is worse beyond its spread, its relative tolerance and its floor."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.studies.verification.test_tracking import PENDULUM

from contactlab.plan.task_options import TaskOptions
from contactlab.studies.verification.panel import VerificationRequest, verify_change
from contactlab.studies.verification.run_measures import RELATIVE_TOLERANCE, average_measure
from contactlab.tasks.checked_model import CheckedModel, open_model
from contactlab.tasks.session import Session


@pytest.mark.parametrize("before", [1.0, 250.0])
@pytest.mark.parametrize(
    ("twin", "floor", "allowed"),
    [
        (0.0, 0.0, RELATIVE_TOLERANCE),
        (2 * RELATIVE_TOLERANCE, 0.0, 2 * RELATIVE_TOLERANCE),
        (0.0, 3 * RELATIVE_TOLERANCE, 3 * RELATIVE_TOLERANCE),
    ],
)
def test_the_largest_tolerance_counts(
    before: float, twin: float, floor: float, allowed: float
) -> None:
    """All three are shares of the value before: what a twin adds, a relative one, and the floor."""
    for factor, worse in ((0.99, False), (1.01, True)):
        after = before * (1 + factor * allowed)
        means = before, after, before * (1 + twin), before
        values = [lambda each=each: np.array([each]) for each in means]
        found = average_measure(
            "depth", "task", "m", values, floor * before, "floor", chaotic=False
        )
        assert found.worse is worse


@pytest.mark.long
def test_a_step_as_fine_as_a_reference_has_an_error(tmp_path: Path) -> None:
    """The reference has half of its step, or its error would seem to be zero.

    Errors of Euler are of first order, and corrected for the step of the reference, so that an
    eighth of the step has an eighth of the error. Terms of second order are below 1 %.
    """
    models = dict[str, CheckedModel]()
    for name, step in (("original", "0.005"), ("changed", "0.000625")):
        (tmp_path / name).mkdir()
        file = tmp_path / name / "pendulum.xml"
        file.write_text(PENDULUM.replace("0.005", step))
        session = Session(tmp_path / name / "results")
        models[name] = open_model(str(file), session, TaskOptions(duration=1.0))
    request = VerificationRequest(models["original"], models["changed"], with_labels=False)
    found = verify_change(replace(request, must_improve=("numerical error",)))
    errors = [measure for measure in found.measures if measure.name == "numerical error"]
    assert found.passed
    assert errors
    for error in errors:
        assert error.after == pytest.approx((error.before or 0.0) / 8, rel=0.01)
    assert "numerical error" not in found.sentence
