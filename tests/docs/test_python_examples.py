"""The examples of docs/how-to/python.md run one after the other, as they stand there."""

import re
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.long

TEXT = (Path(__file__).parents[2] / "docs/how-to/python.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for example in EXAMPLES:
        exec(example, names)  # noqa: S102 - it is ours
    assert len(EXAMPLES) == 3
    assert len(names["store"].runs) == 4
    assert len(names["trace"].time) == names["record"].steps + 1
