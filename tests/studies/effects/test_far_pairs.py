"""Collisions of bodies that stayed far apart are offered, and go only on request."""

from pathlib import Path

import pytest

from contactlab.plan.task_options import read_task_options
from contactlab.studies.effects.model_parts import FAR_PAIRS, ModelPart, find_parts
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session
from contactlab.tasks.stress_motions import KnownStates

BOXES = "".join(
    f'<body name="{name}" pos="{place} 0 .1"><freejoint/>'
    f'<geom name="{name}" type="box" size=".1 .1 .1"/></body>'
    for name, place in (("left", 0.0), ("near", 0.22), ("far", 3.0))
)
MODEL = f"""<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/>{BOXES}
</worldbody></mujoco>"""


def find_far_pairs(folder: Path, keep: tuple[str, ...], far: float | None) -> list[ModelPart]:
    (folder / "boxes.xml").write_text(MODEL)
    task = read_task_options(drive="none", duration="0.1s")
    checked = open_model(str(folder / "boxes.xml"), Session(folder / "out", 0), task)
    states = KnownStates(checked.motions, 1)
    positions = [*states.list_positions()]
    model = checked.motions[0].model
    parts = find_parts(checked, model, states, positions, keep, with_masks=True, far=far)
    return [part for part in parts if part.name == FAR_PAIRS]


@pytest.mark.parametrize(
    ("far", "pairs"),
    [
        (None, {"far - left", "far - near"}),
        (0.05, {"far - left", "far - near"}),
        (0.001, {"far - left", "far - near", "left - near"}),
        (9.0, set[str]()),
    ],
)
def test_pairs_beyond_the_distance_are_named(
    far: float | None, pairs: set[str], tmp_path: Path
) -> None:
    parts = find_far_pairs(tmp_path, (), far)
    named = {" - ".join(sorted(name.split(" - "))) for part in parts for name in part.members}
    assert named == pairs
    for part in parts:
        assert bool(part.reason_to_stay) is (far is None)
        assert part.assumed


def test_pairs_of_a_kept_body_stay(tmp_path: Path) -> None:
    assert find_far_pairs(tmp_path, ("far",), 0.05) == []
