"""A peak is repeated over falls: the mean of plain falls, and worse only if contacts are."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.schema.verification import VerifiedMeasure
from contactlab.studies.verification.falls import FALLS, START_NOISE, repeat_measure
from contactlab.studies.verification.runs import (
    PairedRun,
    hold_inputs,
    pair_motions,
)
from contactlab.studies.verification.state_tables import StateTable
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

BOX = """
<mujoco>
  <option timestep=".004"/>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 .2" euler="20 30 0"><freejoint/><geom type="box" size=".03 .04 .05"/></body>
  </worldbody>
</mujoco>
"""
SECONDS = 0.4


def _open_run(folder: Path, changed_text: str, original_text: str = BOX) -> PairedRun:
    motions = list[Motion]()
    for name, text in (("original", original_text), ("changed", changed_text)):
        path = folder / name / "box.xml"
        path.parent.mkdir(parents=True)
        path.write_text(text)
        motion = open_model(str(path), Session(path.parent / "results")).motions[0]
        motions.append(hold_inputs(motion, SECONDS, lambda own: own))
    return pair_motions("fall", motions[0], motions[1], at_rest=True)


def _repeat_depth(run: PairedRun, known: dict[str, StateTable]) -> VerifiedMeasure:
    peak = VerifiedMeasure(
        name="depth", run="fall", unit="m", before=0.0, after=1.0, spread=0.0, tolerance=0.0,
        place="", worse=True,
    )  # fmt: skip
    return repeat_measure(run, peak, 1, known)


def _plain_depth(model: mujoco.MjModel, noise: np.ndarray) -> float:
    data, depth = mujoco.MjData(model), 0.0
    data.qvel[:] = noise
    for _ in range(round(SECONDS / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_fwdPosition(model, data)
        depth = max(depth, -data.contact.dist.min(initial=0.0))
    return depth


def test_a_peak_is_the_mean_of_plain_falls(tmp_path: Path) -> None:
    run, known = _open_run(tmp_path, BOX), dict[str, StateTable]()
    found = _repeat_depth(run, known)
    model = mujoco.MjModel.from_xml_string(BOX)
    noise = np.random.default_rng(FALLS).uniform(-START_NOISE, START_NOISE, (FALLS, model.nv))
    assert found.before == pytest.approx(np.mean([_plain_depth(model, each) for each in noise]))
    assert (found.after, found.worse) == (found.before, False)
    assert {*known} == {"fall"}


def test_softer_contacts_are_worse_in_each_fall(tmp_path: Path) -> None:
    soft = BOX.replace("<worldbody>", '<default><geom solref="0.03 1"/></default><worldbody>')
    assert _repeat_depth(_open_run(tmp_path, soft), {}).worse


RESTING = """
<mujoco>
  <option timestep=".004" gravity="3 0 -9"/>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 .03"><freejoint/><geom type="box" size=".05 .05 .03"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("friction", [1.0, 0.2])
def test_a_body_that_slides_in_each_fall_is_worse(tmp_path: Path, friction: float) -> None:
    """A lean of a third of the weight holds with friction 1, not with friction .2."""
    slippery = f'<default><geom friction="{friction}"/></default><worldbody>'
    run = _open_run(tmp_path, RESTING.replace("<worldbody>", slippery), RESTING)
    creep = VerifiedMeasure(
        name="creep", run="fall", unit="m/s", before=0.0, after=1.0, spread=0.0, tolerance=0.0,
        place="", worse=True,
    )  # fmt: skip
    found = repeat_measure(run, creep, 1, {})
    assert (found.worse, found.place) == (friction < 1 / 3, "body[1]")
