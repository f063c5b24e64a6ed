"""A truth equals the numpy that it stands for, and nothing else gets in."""

import pickle
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from tests.verdicts.motion import Motion, finer, watch
from tests.verdicts.truth import Truth

from contactlab.expression import ExpressionError

PENDULUM = """<mujoco><option timestep=".02" sleep_tolerance="10"><flag sleep="enable"/></option>
<worldbody><site name="nail" pos=".3 0 0"/><body name="arm"><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/><site name="tip" pos=".3 0 0"/>
<body name="fore" pos=".3 0 0"><joint name="elbow" axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass=".3"/></body></body></worldbody>
<keyframe><key qpos=".2 -.4" qvel="1 0"/></keyframe></mujoco>"""
SLEEPLESS = PENDULUM.replace("enable", "disable")


@pytest.fixture(scope="module")
def motion() -> Motion:
    return watch(SLEEPLESS, 0.4)


def alternation_by_loop(values: np.ndarray) -> float:
    """Return the rms of the second differences by four, one by one."""
    rows = [values[k] - 2 * values[k - 1] + values[k - 2] for k in range(2, len(values))]
    return float(np.sqrt(sum(row**2 for row in rows) / len(rows))) / 4


def test_a_truth_equals_numpy(motion: Motion) -> None:
    arm, fore, hinge, elbow = motion.xpos[:, 1], motion.xpos[:, 2, 2], *motion.qpos.T
    late = slice(15, None)  # of 21 rows
    inside = [bool((hinge[: k + 1] < 0.6).all()) for k in range(21)]
    expected = {
        "max(abs(joint('hinge') - 0.3))": np.abs(hinge - 0.3).max(),
        "max(gap('tip', 'nail')[late])": np.linalg.norm(
            motion.site[late, 0] - motion.site[late, 1], axis=1
        ).max(),
        "speed('elbow')[-1]": motion.qvel[-1, 1],
        "max(body('fore')[late, 2])": motion.xpos[late, 2, 2].max(),
        "max(norm(xpos[:, 2] - (0, 0, 0.5)))": max(
            np.linalg.norm(row - [0, 0, 0.5]) for row in motion.xpos[:, 2]
        ),
        "span(energy[early])": np.ptp(motion.energy[:5]),
        "max(min(joint('hinge'), joint('elbow')))": max(map(min, hinge, elbow)),
        "max(highest(xpos[:, 1:, 2]) - lowest(xpos[settled, 1:, 2])[0])": (
            motion.xpos[:, 1:, 2].max(axis=1).max() - motion.xpos[5, 1:, 2].min()
        ),
        "max(held(joint('hinge') < 0.6) * time)": max(motion.time[inside]),
        "restless": np.sqrt((motion.qvel[late] ** 2).mean()),
        "rms(qvel[late])": np.sqrt((motion.qvel[late] ** 2).mean()),
        "trembles(0.5, 'hinge', 'elbow')": max(
            alternation_by_loop(motion.qvel[late, k]) for k in (0, 1)
        )
        / 0.5,
        "beyond(joint('hinge'), -0.1, 0.3)": (hinge.max() - 0.3) / 0.4,
        "beyond(joint('hinge'), -9, 9)": 0.0,
        "max(max(time, 0.1), 0.2)[3] - min(time, 0.1)[9]": 0.2 - 0.1,
        "time[-1] ** 2 * cos(pi / 3) + radians(90)": motion.time[-1] ** 2 / 2 + np.pi / 2,
        "(max(joint('hinge')) > 0.3) * 4.0": 4.0,
        "beyond('hinge', -0.1, 0.3)": (hinge.max() - 0.3) / 0.4,
        "max(qpos[1:-1:3, ::1])": max(map(max, motion.qpos[[1, 4, 7, 10, 13, 16, 19]])),
        "mean(qpos[-1] - (0.1, 0.2))": (hinge[-1] + elbow[-1] - 0.3) / 2,
        "departs(joint('hinge'), 0.2 * time)": max(abs(hinge - 0.2 * motion.time)),
        "ends_off(joint('elbow'), 0.3, 0.5)": max(abs(elbow[late] - 0.3)) / 0.5,
        "opened('tip', 'nail')": max(
            map(np.linalg.norm, motion.site[late, 0] - motion.site[late, 1])
        ),
        "below('fore', 9)": 9 - min(fore),
        "below('fore', -9)": 0.0,
        "under('fore', 0.1, 0.5)": (0.1 - min(fore)) / 0.5,
        "past('fore', -0.3, 0.5)": (max(fore) + 0.3) / 0.5,
        "past('fore', 9, 0.5)": 0.0,
        "rests_off('fore', 0.1)": max(abs(fore[late] - 0.1)),
        "gained(0.5)": (max(motion.energy) - motion.energy[0]) / 0.5,
        "unbalanced(0.5)": max(abs(motion.energy - motion.energy[0])) / 0.5,
        "1 / (time[0] * (1, 1)[0])": np.inf,
        "atan2(body('fore')[-1, 2], body('fore')[-1, 0])": np.arctan2(
            motion.xpos[-1, 2, 2], motion.xpos[-1, 2, 0]
        ),
    }
    assert not arm.any()  # the frame of the arm is on its hinge
    for text, number in expected.items():
        assert Truth(text).measure(motion) == pytest.approx(float(number), rel=1e-12), text


def test_finer_and_awake_are_other_motions_for_a_place_alone(motion: Motion) -> None:
    hinge = motion.qpos[:, 0]
    for factor in (2, 4):
        fine = np.abs(hinge - finer(motion, factor).qpos[:, 0]).max() / 0.5
        assert fine > 0
        for text in (
            f"strays(joint('hinge'), 0.5, {factor})",
            f"max(abs(joint('hinge') - finer(joint('hinge'), {factor}))) / 0.5",
            f"max(abs(finer(joint('hinge'), {factor}) - joint('hinge'))) / 0.5",
        ):
            assert Truth(text).measure(motion) == fine
    assert Truth("strays(qpos, 1.0)").measure(motion) == Truth("strays(qpos, 1, 16)").measure(
        motion
    )
    asleep = watch(PENDULUM, 0.4)
    woken = np.abs(asleep.qpos - motion.qpos).max()
    assert woken > 0
    assert Truth("max(abs(qpos - awake(qpos)))").measure(asleep) == woken


def test_halved_steps_stray_half_as_far() -> None:
    """The semi-implicit Euler method is of first order: its error is proportional to the step."""
    strays = [
        Truth("strays(qpos, 1.0, 64)").measure(watch(SLEEPLESS, 0.2, factor=factor))
        for factor in (4, 8)
    ]
    # Errors are e = c h + O(h^2): the ratio is 2 + O(h), where h is 0.005 s of the 1 s of a swing.
    assert strays[0] / strays[1] == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("__import__('os')", "the functions are "),
        ("qpos.dtype", "'qpos.dtype' is none of time, qpos"),
        ("model", "'model' is none of "),
        ("joint", "'joint' is a function"),
        ("[row for row in qpos]", "only numbers, names"),
        ("lambda: 1", "only numbers, names"),
        ("motion", "'motion' is none of "),
        ("qpos[1.5]", "an index has whole numbers"),
        ("qpos[qvel]", "an index has whole numbers"),
        ("gap('tip')", "gap takes first, second"),
        ("strays(qpos)", "strays takes place, size, factor=16"),
        ("trembles(1.0)", r"trembles takes speed, joint, \*joints"),
        ("max()", r"max takes array, \*others"),
        ("max(qpos, axis=1)", "max takes"),
    ],
)
def test_other_text_is_no_truth(text: str, message: str) -> None:
    with pytest.raises(ExpressionError, match=message):
        Truth(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joint('knee')[0]", "knee"),
        ("qpos", r"an array of shape \(21, 2\), not a number"),
        ("qpos[99, 0]", "out of bounds"),
        ("qpos[0, 0, 0]", "too many indices"),
        ("max(qpos - energy)", "could not be broadcast"),
        ("late + 1", "unsupported operand"),
        ("late", "neither an array nor a number"),
        ("'hinge'", "neither an array nor a number"),
        ("1 / 0", "division by zero"),
        ("qpos > 0 and energy > 0", "ambiguous"),
    ],
)
def test_what_cannot_be_measured_says_why(motion: Motion, text: str, message: str) -> None:
    with pytest.raises(ExpressionError, match=message):
        Truth(text).measure(motion)


def test_pickles_as_itself() -> None:
    again = pickle.loads(pickle.dumps(Truth("max(time)")))  # noqa: S301
    assert isinstance(again, Truth)
    few = cast("Motion", SimpleNamespace(time=np.arange(3.0)))
    assert again.measure(few) == 2
