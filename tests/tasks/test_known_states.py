"""States of changed models are compared with known ones bit for bit, first steps first."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import contactlab.tasks.stress_motions as stress
from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.contact.trace_arrays import Floats
from contactlab.tasks.stress_motions import KnownStates

BALL = """<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="1 1 1"/>
<body pos="0 0 2"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


@pytest.fixture
def falling() -> Motion:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    return Motion(model, start[None], np.empty((1, 100, 0)), name="whole")


@pytest.mark.parametrize(
    ("field", "value", "alike", "steps"),
    [
        ("tolerance", 1e-8, True, 120),
        ("gravity", (0.0, 0.0, -9.0), False, 20),
        ("impratio", 2.0, False, 120),
        ("disableflags", int(mujoco.mjtDisableBit.mjDSBL_CONTACT), False, 120),
    ],
)
def test_a_change_that_shows_early_is_found_in_the_first_steps(
    field: str,
    value: float | tuple[float, ...],
    alike: bool,
    steps: int,
    falling: Motion,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = list[int]()

    def count_steps(motion: Motion, workers: int) -> Floats:
        made.append(motion.steps)
        return whole(motion, workers)

    whole = stress.visit_states
    monkeypatch.setattr(stress, "visit_states", count_steps)
    changed = mujoco.MjModel.from_xml_string(BALL)
    if isinstance(value, tuple):
        getattr(changed.opt, field)[:] = value
    else:
        setattr(changed.opt, field, value)
    states = KnownStates([falling], 1)
    assert states.match_models([changed]) is alike
    assert sum(made) == 2 * steps
    made.clear()
    assert states.match_models([changed]) is alike
    assert sum(made) == steps, "those of the known motion are not run again"


def test_a_change_that_shows_at_a_contact_is_found_soon_after_it(
    falling: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ball lands after 63 of 600 steps."""
    made = list[int]()

    def count_steps(motion: Motion, workers: int) -> Floats:
        made.append(motion.steps)
        return whole(motion, workers)

    whole = stress.visit_states
    monkeypatch.setattr(stress, "visit_states", count_steps)
    longer = replace(falling, inputs=np.empty((1, 600, 0)))
    changed = mujoco.MjModel.from_xml_string(BALL)
    changed.opt.impratio = 2.0
    changed.geom_solref[:] = 0.1, 1.0
    states = KnownStates([longer], 1)
    assert not states.match_models([changed])
    assert made == [20, 20, 100, 100]
    assert states.match_models([longer.model])


def test_positions_are_those_before_each_step(falling: Motion) -> None:
    (positions,) = KnownStates([falling], 1).list_positions()
    fallen = 2 - 9.81 * 1e-4 * np.arange(40) * (np.arange(40) + 1) / 2
    assert positions[:40, 2] == pytest.approx(fallen)
    assert replace(falling).steps <= len(positions) <= falling.steps + 1
