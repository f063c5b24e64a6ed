"""`checks: verdict` records how much modeling choices decide each run, as an error budget does."""

from pathlib import Path
from typing import Any

import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

# A box that slides along the diagonal of a pyramid, which is weaker there than the ellipse.
SLIDE = """
<mujoco><option timestep=".002" gravity="8 8 -9" cone="{cone}"/>
  <worldbody><geom type="plane" size="9 9 .1"/>
    <body name="box" pos="0 0 .05"><freejoint/>
      <geom type="box" size=".1 .1 .05" mass="1" friction="1"/></body></worldbody>
</mujoco>
"""
SWEEP = """
version: 1
scene: model.xml
axes: {{}}
duration: 0.6
drive: none
checks: {checks}
trace: none
"""


def row_of(sweeper: Any, checks: str, cone: str) -> dict[str, Any]:
    (sweeper.folder / "model.xml").write_text(SLIDE.format(cone=cone))
    sweeper.run(SWEEP.format(checks=checks), f"{checks}-{cone}")
    (row,) = sweeper.rows(f"{checks}-{cone}")
    return row


def test_a_run_depends_on_the_choice_that_a_budget_names(sweeper: Any, tmp_path: Path) -> None:
    row = row_of(sweeper, "verdict", "pyramidal")
    options = TaskOptions(duration=0.6, seeds=1, drive="none")
    model = open_model(
        str(sweeper.folder / "model.xml"), Session(tmp_path / "other", 0), options, rows=None
    )
    (phase,) = model.budget.phases
    effects = {reading.name: reading.error for reading in phase.rows if reading.kind == "model"}
    friction = max(effects.get(name, 0.0) for name in ("cone", "impratio", "noslip"))
    assert row["friction_effect"] == pytest.approx(friction, rel=1e-6)
    assert row["friction_effect"] > 0.1
    assert "choice_dependent" in row["labels"]


def test_other_checks_do_not_measure_choices(sweeper: Any) -> None:
    row = row_of(sweeper, "all", "pyramidal")
    assert row["friction_effect"] is None
    assert row["softness_effect"] is None
    assert row["labels"] == ["stable"]
