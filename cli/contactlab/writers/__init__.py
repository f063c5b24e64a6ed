"""Reports of judges as text, Markdown, JUnit XML, annotations of GitHub, JSON and SARIF."""

from collections.abc import Callable, Mapping

from contactlab.writers.github import as_annotations
from contactlab.writers.junit import as_junit
from contactlab.writers.report import Report as Report
from contactlab.writers.report import Section as Section
from contactlab.writers.report import as_json
from contactlab.writers.report_document import as_markdown, as_text
from contactlab.writers.sarif import as_sarif

WRITERS: Mapping[str, Callable[[Report], str]] = {
    "text": as_text,
    "json": as_json,
    "markdown": as_markdown,
    "junit": as_junit,
    "github": as_annotations,
    "sarif": as_sarif,
}
"""By the name of the format."""
