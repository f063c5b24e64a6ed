"""The report of `contactlab explain`: meanings of words, or the contacts of a model."""

from contactlab.rendering.text import render_text
from contactlab.schema.examination import RestingContact
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import Model, about


class WordMeaning(Model):
    """One meaning of a word."""

    word: str = about("The requested word.")
    title: str = about("The printed word, and its kind.")
    texts: tuple[str, ...] = about("The definition, then limits, values and advice.", default=())


class Explanation(ReportModel):
    """Meanings of words, or the contacts of a model in units of the world."""

    meanings: tuple[WordMeaning, ...] = ()
    task: str = about("The task that the contacts were measured in; empty for words.", default="")
    contacts: tuple[RestingContact, ...] = ()
    requested: tuple[str, ...] = about("Requested values, such as `depth_at_rest`.", default=())
    missed: tuple[str, ...] = about(
        "Requested values that a run with these settings does not reach.", default=()
    )

    def __str__(self) -> str:
        """Return the text."""
        return render_text(self.describe())
