"""The examples of docs/how-to/plugins.md declare what they say they do."""

import re
from pathlib import Path
from typing import Any

import pytest

from contactlab.engines import ENGINES
from contactlab.judge.limits import LIMITS
from contactlab.measure import LABELS, METRICS, ORACLES, THRESHOLDS
from contactlab.studies.check.check_entries import CHECKS

TEXT = (Path(__file__).parents[2] / "docs/how-to/plugins.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)

pytestmark = pytest.mark.usefixtures("_registries_restored")


def test_each_example_adds_its_entries() -> None:
    names: dict[str, Any] = {"__name__": "example"}
    for example in EXAMPLES:
        exec(example, names)  # noqa: S102 - it is ours
    gained = "Largest height that the first body gains over its start."
    assert METRICS["hover_height"].definition == gained
    assert LABELS["hovering"].thresholds == (THRESHOLDS["hover"],)
    assert ORACLES["fall"].relative
    assert ENGINES["mine"].version == "1.0"
    assert CHECKS["mass"].limits == (LIMITS["mass"],)
    assert names["ring"]("ding", times=2) == "ding ding"
    assert len(EXAMPLES) == 3
