"""The report of `contactlab fit`: the settings that explain recordings best, and how well."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about

REPORT, MODEL = "fit.json", "fitted.xml"


class FittedSetting(Model):
    """One setting that was free."""

    name: str
    value: Setting
    interval: tuple[float, float] | None = about(
        "95 % over resampled runs, and all values that are as good; null for a word."
    )
    profile: dict[str, float] = about("Mean error by its value, the others as fitted.")
    identified: bool = about("Whether the recordings tell its value: else the profile is flat.")


class FitReport(Model):
    """What a fit found; errors are means over recorded runs."""

    schema_version: Literal[1] = 1
    scene: str
    scene_hash: str
    error: str = about("The metric that was made small.")
    settings: tuple[FittedSetting, ...]
    fitted_runs: tuple[float, ...]
    fitted_error: float
    held_out: dict[str, float] = about("Error of each run that no setting was fitted to.")
    held_out_error: float
    held_out_interval: tuple[float, float] = about("95 %, over resampled runs.")
    written_error: float = about("Of the model as written, over the runs held out.")
    lines: tuple[str, ...] = about("What changes in the files of the model.")
    runs: int = about("Simulated in all.")
