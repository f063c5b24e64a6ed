"""`contactlab.fit`: the command as a function."""

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from contactlab.api.running_functions import RunOptions, Settings, assigned, session_in
from contactlab.resources import RESULTS
from contactlab.schema.study_reports import FitReport
from contactlab.studies.session import model_name
from contactlab_fit.fitting import FREE, FitRequest, run


def fit(
    scene: str | Path,
    *,
    free: Sequence[str] = FREE,
    set: Settings = (),
    fitted: int = 120,
    seed: int = 0,
    error: str = "reality",
    output: str | Path | None = None,
    **options: Unpack[RunOptions],
) -> FitReport:
    """Fit settings to recorded motion, with intervals, and try them on runs that were held out.

    The scene has a `recording`; `free` names what to fit, `NAME` or `NAME=LOW:HIGH`, `set` what all
    runs have, and `seed` draws which recorded runs are fitted, so many at most, so that the error,
    a metric, gets small. Everything goes to `results/fit/NAME` if `output` is left out.

    Raises:
        SceneError: the scene has no recording, or too few runs.
        SweepFileError: a setting or its bounds are wrong.
        ExpectationError: no run can be measured.
    """
    session = session_in(output or RESULTS / "fit" / model_name(str(scene)), **options)
    return run(FitRequest(str(scene), free, assigned(set), fitted, seed, error), session)
