"""A report as JSON: all of it, in the shape of its published schema."""

import json

from contactlab.printable import printable
from contactlab.writers.report import Report


def as_json(report: Report) -> str:
    """Return the data of a report as JSON."""
    # Pydantic itself writes no text that UTF-8 cannot hold, which data may have.
    data = report.record.model_dump(mode="json")
    return printable(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)) + "\n"
