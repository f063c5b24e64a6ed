"""The report of `contactlab explain`: meanings of words."""

from contactlab.rendering.text import render_text
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import Model, about


class WordMeaning(Model):
    """One meaning of a word."""

    word: str = about("The requested word.")
    title: str = about("The printed word, and its kind.")
    texts: tuple[str, ...] = about("The definition, then limits, values and advice.", default=())


class Explanation(ReportModel):
    """Meanings of words."""

    meanings: tuple[WordMeaning, ...] = ()

    def __str__(self) -> str:
        """Return the text."""
        return render_text(self.describe())
