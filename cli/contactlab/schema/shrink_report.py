"""The report of `contactlab shrink`: the smallest model that fails as a stored run does."""

from typing import Literal

from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import about


class ShrinkReport(ReportModel):
    """The smallest model that fails as a stored run does, compared with that run."""

    shrink_version: Literal[2] = 2
    run: str = about("Id of the stored run.")
    label: str = about("Label of both runs.")
    bodies: tuple[str, ...] = about("Bodies that the label is about.", default=())
    reason: str = about("Why the label applies to the small model.")
    stored_reason: str = about("Why it applies to the stored run.")
    before: dict[str, int] = about("Parts of the run's model by kind, without visual ones.")
    after: dict[str, int] = about("Parts of the small model.")
    start_time: float = about("Time of the stored run at which the small run starts.", unit="s")
    duration: float = about("Simulated time of the small model's run.", unit="s")
    stored_duration: float = about("Simulated time of the stored run.", unit="s")
    models_run: int = about("Number of models that were run.")
    finished: bool = about("Whether every part was tried; false if the time limit was reached.")
    seconds: float = about("Wall time of the search.", unit="s")
    folder: str = about("Folder of model.xml, sweep.yaml and issue.md.")
