"""Where sweeps with passes after their runs are made."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work outside of any repository, whose state records would name."""
    monkeypatch.chdir(tmp_path)
