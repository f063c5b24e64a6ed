"""What a shorter timestep cures and what it does not: the sweeps state it, and it comes out."""

from pathlib import Path

import pytest

from contactlab import resources
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep

pytestmark = pytest.mark.night


@pytest.mark.parametrize("name", ["grip", "plate", "ball", "disk"])
def test_everything_stated_comes_out(tmp_path: Path, name: str) -> None:
    path = resources.sweep_file(f"timestep-claim-{name}")
    ask = read_request(path, path.stem, tmp_path / "store", folder=path.parent, workers=2)
    manifest = run_sweep(ask, lambda *_: None, lambda _: None)
    assert manifest.expectations.get("unmet", 0) == 0
    assert manifest.expectations["met"] >= 20
