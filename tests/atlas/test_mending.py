"""A model with its change is judged on seeds that neither its task nor its changes have."""

from pathlib import Path

import pytest
from bench.atlas.mending import unseen_verdict
from tests.atlas.test_confirm import SPRING


@pytest.mark.long
def test_a_change_that_leaves_its_cause_is_seen(tmp_path: Path) -> None:
    """A step of a quarter of a period is the motion of no spring, one of a thirtieth is."""
    for step, integrator, sound in ((0.08, "Euler", False), (0.01, "RK4", True)):
        file = tmp_path / f"{integrator}.xml"
        file.write_text(SPRING.format(step=step, integrator=integrator))
        found, said = unseen_verdict(file, tmp_path / integrator)
        assert found == sound
        assert said.startswith(f"numerics {'ok' if sound else 'inaccurate'}")
