"""The example of docs/how-to/budget.md runs as it stands there, on a model of the name it has."""

import re
from pathlib import Path

import pytest
from tests.budget_motions import WALKER

TEXT = (Path(__file__).parents[2] / "docs/how-to/budget.md").read_text(encoding="utf-8")


@pytest.mark.long
def test_the_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ant.xml").write_text(
        WALKER.format(step=0.01, integrator="Euler", solver="Newton", iterations=100)
    )
    monkeypatch.chdir(tmp_path)
    example = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    assert len(example) == 1
    exec(example[0], {})  # noqa: S102 - it is ours
    printed = capsys.readouterr().out
    assert printed.splitlines()[0].endswith("(tolerance 10 %)")
    assert "0 to 2 s: 3 seeds, 50 windows of 40 ms, steps of 10 ms" in printed
