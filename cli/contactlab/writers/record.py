"""A report as JSON: all of it, in the shape of its published schema."""

import json
import math
from typing import Any

from contactlab.printable import printable
from contactlab.writers.report import Report


def as_json(report: Report) -> str:
    """Return the data of a report as JSON; numbers that are not finite are null."""
    # Pydantic itself writes no text that UTF-8 cannot hold, which data may have.
    data = _finite(report.record.model_dump(mode="json"))
    return printable(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)) + "\n"


def _finite(data: Any) -> Any:  # noqa: ANN401 - data of JSON
    if isinstance(data, dict):
        return {name: _finite(part) for name, part in data.items()}
    if isinstance(data, list):
        return [_finite(part) for part in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
