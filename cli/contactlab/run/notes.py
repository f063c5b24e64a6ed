"""What later passes find of a run, as it lies in the store's notes until the end."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from contactlab.run.job import Finished, Purpose

Note = Mapping[str, Any]

_LABELS: Mapping[Purpose, str] = {
    "record": "recorded",
    "errors": "held against references",
    "work": "counted",
    "times": "timed",
}


def note(purpose: Purpose, run_id: str, found: Note) -> Finished:
    """Return what a pass found of a run, as a worker hands it over."""
    row = json.dumps({"pass": purpose, "run_id": run_id, "found": found}).encode()
    return Finished(row=row, label=_LABELS[purpose], status="ok", expectation_met=None)


def noted(notes: Iterable[Note], purpose: Purpose) -> dict[str, Note]:
    """Return run id to what a pass found."""
    return {each["run_id"]: each["found"] for each in notes if each["pass"] == purpose}
