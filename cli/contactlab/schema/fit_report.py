"""The report of `contactlab fit`: the settings that explain recordings best, and how well."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about

FIT_VERSION = 1
REPORT, MODEL = "fit.json", "fitted.xml"


class FittedSetting(Model):
    """One setting that was free."""

    name: str
    value: Setting
    low: float | None = about(
        "Lower end of the 95 % interval over resampled runs; null for a word."
    )
    high: float | None = about("Its upper end.")
    profile: dict[str, float] = about(
        "Mean error of the fitted runs by value, with all other settings as fitted."
    )
    identified: bool = about("Whether the recordings tell its value: else the profile is flat.")


class FitReport(Model):
    """What a fit found."""

    schema_version: Literal[1] = FIT_VERSION
    scene: str
    scene_hash: str
    error: str = about("The metric whose mean over recorded runs was made small.")
    settings: tuple[FittedSetting, ...]
    fitted_runs: tuple[float, ...]
    held_out: tuple[float, ...] = about("Recorded runs that no setting was fitted to.")
    fitted_error: float = about("Mean over the fitted runs.")
    held_out_error: float
    held_out_interval: tuple[float, float] = about("95 %, over resampled runs.")
    written_error: float | None = about("Of the model as written, over the runs held out.")
    run_errors: dict[str, float] = about("Of each run held out: which does no setting explain?")
    lines: tuple[str, ...] = about("What changes in the files of the model.")
    runs: int = about("Simulated in all.")
