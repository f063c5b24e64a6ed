"""The report of `contactlab shrink`: the smallest model that fails as a stored run does."""

from contactlab.schema.strict_model import Model, about


class ShrinkReport(Model):
    """A model that fails as a run does, and what it was made of."""

    run: str = about("Id of the stored run.")
    label: str = about("What both are labelled.")
    bodies: tuple[str, ...] = about("Those that the label is of.", default=())
    reason: str = about("Why the label applies to the small model.")
    stored_reason: str = about("Why it applies to the stored run.")
    before: dict[str, int] = about("Parts of the run's model by kind, those that only look apart.")
    after: dict[str, int] = about("Parts of the small model.")
    begins: float = about("When in the stored run the small model's begins.", unit="s")
    duration: float = about("Simulated time of the small model's run.", unit="s")
    stored_duration: float = about("That of the stored run.", unit="s")
    tried: int = about("Models that were run.")
    finished: bool = about("Whether every part was tried; false if the time ended first.")
    seconds: float = about("How long it took.", unit="s")
    folder: str = about("Folder of model.xml, sweep.yaml and issue.md.")
