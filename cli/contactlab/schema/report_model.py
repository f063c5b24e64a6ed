"""The base of reports: the data that a study returns, and the document that says it in words."""

from contactlab.registry import own_parts
from contactlab.rendering.document import Document
from contactlab.rendering.html import render_html
from contactlab.rendering.markdown import render_markdown
from contactlab.schema.strict_model import Model


class DescribedReport:
    """A result that a document describes. Its class is registered with the describing function."""

    @property
    def problem(self) -> str:
        """Why the command ends with exit code 1; empty if it ends with 0."""
        return ""

    def describe(self, **options: object) -> Document:
        """Return the document of this report; options are those of its describing function."""
        return own_parts("description")[type(self).__name__].load()(self, **options)

    def _repr_html_(self) -> str:
        """Return the report as HTML, for notebooks."""
        return render_html(self.describe())

    def _repr_markdown_(self) -> str:
        """Return the report as Markdown, for notebooks."""
        return render_markdown(self.describe())


class ReportModel(DescribedReport, Model):
    """A result of a command, as its JSON is written."""
