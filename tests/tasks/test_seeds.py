"""The seeds of a task: as many as requested, or more while they disagree about the tolerance."""

from pathlib import Path

import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.tasks.checked_model import MOST_SEEDS, CheckedModel, open_model
from contactlab.tasks.session import Session

BOX = """
<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="5 5 .1"/>
<body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .06 .04" mass="1"/></body>
</worldbody></mujoco>
"""


def opened(folder: Path, options: TaskOptions) -> CheckedModel:
    (folder / "box.xml").write_text(BOX)
    found = open_model(str(folder / "box.xml"), Session(folder, 0), options)
    found.add_seeds()
    return found


def test_a_requested_number_of_seeds_is_kept(tmp_path: Path) -> None:
    near = opened(tmp_path, TaskOptions(seeds=2, tolerance=(0.03, "1")))
    assert near.task.seeds == (0, 1)
    assert all(phase.run.seeds.size == 2 for phase in near.budget.phases)


@pytest.mark.parametrize("tolerance", [0.5, 0.03])
def test_seeds_are_added_while_they_disagree(tmp_path: Path, tolerance: float) -> None:
    found = opened(tmp_path, TaskOptions(duration=1.0, tolerance=(tolerance, "1")))
    seeds = len(found.task.seeds)
    disagree = any(phase.seeds_disagree(tolerance) for phase in found.budget.phases)
    assert seeds == 3 or tolerance < 0.5
    assert not disagree or seeds == MOST_SEEDS
    assert all(phase.run.seeds.size == seeds for phase in found.budget.phases)
    # Seeds that are added leave the first ones as they are.
    alone = opened(tmp_path, TaskOptions(duration=1.0, tolerance=(tolerance, "1"), seeds=3))
    for more, first in zip(found.budget.phases, alone.budget.phases, strict=True):
        assert more.run.seeds[:3] == pytest.approx(first.run.seeds, rel=1e-9) or (
            more.run.body != first.run.body
        )
