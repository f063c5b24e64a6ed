"""`contactlab.tune`: the command as a function."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, Unpack

from contactlab.api.running_functions import RunOptions, session_in
from contactlab.plan.overrides import drive_option
from contactlab.resources import RESULTS
from contactlab.schema.study_reports import Goal, TuneReport
from contactlab.studies.session import model_name
from contactlab_tune.tune_request import TuneRequest
from contactlab_tune.tuning import run


def tune(
    model: str | Path,
    *,
    goal: Goal = "fastest",
    error: float | Literal["reality"] | None = None,
    tolerance: Mapping[str, float] | None = None,
    budget: float = 300.0,
    free: Sequence[str] = (),
    drop_sensors: bool = False,
    drive: str | None = None,
    output: str | Path | None = None,
    **options: Unpack[RunOptions],
) -> TuneReport:
    """Find the settings to use, write the model that has them, and prove that it is as good.

    The model is as for `check`, or a sweep file; error [m], or `reality`, and tolerances are its
    limits, the budget is wall time [s]. Everything goes to `results/tune/NAME` if `output` is left
    out.

    Raises:
        SceneError: there is no such model, or nothing in it moves.
        SweepFileError: a tolerance is of no metric, or the budget is too short for a proof.
        ExpectationError: runs of the model as written fail.
    """
    session = session_in(output or RESULTS / "tune" / model_name(str(model)), **options)
    limits, driven = tolerance or {}, drive_option(drive)
    request = TuneRequest(str(model), goal, error, limits, budget, free, drop_sensors, driven)
    return run(request, session)
