"""The report of `contactlab fit`."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import Model, about

FIT_REPORT, FITTED = "fit.json", "fitted.xml"


class FittedSetting(Model):
    """One fitted setting."""

    name: str
    value: Setting
    interval: tuple[float, float] | None = about(
        "95 % over resampled runs, with all values that are as good; null for a word."
    )
    profile: dict[str, float] = about("Mean error by its value, with the other settings as fitted.")
    identified: bool = about(
        "Whether the recordings determine its value; else the profile is flat."
    )


class FitReport(ReportModel):
    """Result of a fit; errors are means over recorded runs."""

    schema_version: Literal[2] = 2
    scene: str
    scene_hash: str
    metric: str = about("The metric that was minimized.")
    settings: tuple[FittedSetting, ...]
    fitted_runs: tuple[float, ...]
    fitted_error: float
    held_out: dict[str, float] = about("Error of each held-out run.")
    held_out_error: float
    held_out_interval: tuple[float, float] = about("95 %, over resampled runs.")
    current_error: float = about("Error of the model as written, over the held-out runs.")
    noise_floor: float | None = about(
        "Mean change of the error of a run by the start noise of the scene, its `perturb`; null if "
        "the scene declares none.",
        default=None,
    )
    lines: tuple[str, ...] = about("Changed lines of the model files.")
    runs: int = about("Number of simulated runs.")
