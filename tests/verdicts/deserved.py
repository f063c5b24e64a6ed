"""Flags of public models that plain MuJoCo bears out: `deserved.json` has the measurements."""

import json
from fnmatch import fnmatchcase
from pathlib import Path

_FLAGS = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))["flags"]


def deserved(model: str, label: str) -> str | None:
    """Return why a flag is deserved, None if nobody has shown that it is."""
    for flag in _FLAGS:
        flagged = any(fnmatchcase(label, pattern) for pattern in flag["labels"])
        if flagged and fnmatchcase(model, flag["models"]):
            return flag["why"]
    return None
