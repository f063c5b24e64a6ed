"""Laws of grips: Coulomb's limit, creep of regularized friction, mirrors, units, limits."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.grip.grippers import claw, claw_with_bar

import contactlab
from contactlab.errors import SceneError, SweepFileError
from contactlab.schema.grip import GripReport
from contactlab.studies.grip.grip_fixes import Grip
from contactlab.studies.grip.gripped_object import read_object
from contactlab.studies.grip.gripping import GripRequest, judge_grip
from contactlab.studies.grip.holding import fit_pace
from contactlab.studies.grip.rollouts import data_at, find_contacts

BOX = "box:50x40x40mm,.1kg"
GRAVITY = 9.81


def saved(folder: Path, text: str, name: str = "claw.xml") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def judged(folder: Path, text: str, **asked: object) -> tuple[GripReport, Grip]:
    """Return a report, and the grip that it is of."""
    grips = list[Grip]()
    asked = {"fixes": False, **asked}
    request = GripRequest(saved(folder, text), film=grips.append, **asked)  # pyright: ignore[reportArgumentType]
    return judge_grip(request), grips[0]


def fast(report: GripReport, name: str) -> float:
    (found,) = (drift for drift in report.drifts if drift.name == name)
    assert found.speed is not None
    return found.speed


@pytest.mark.parametrize("friction", ["0.3", pytest.param("0.7", marks=pytest.mark.long)])
def test_a_pull_wins_at_coulombs_limit(tmp_path: Path, friction: str) -> None:
    """Two pads that press with F hold 2 mu F: 20 N of the motors, whose slides have no friction.

    Friction mixes by the maximum, and the object has 1: it is given as a body, with the pads' own.
    Pulls differ by 5 % of that, and what slides is borne by as much at most: the tolerance.
    """
    text = claw_with_bar(20, 0.1, cone="elliptic", impratio="10", friction=friction)
    report, _ = judged(tmp_path, text, held_body="bar")
    assert [each.force for each in report.fingers] == pytest.approx([20, 20], rel=1e-3)
    assert report.pull.force == pytest.approx(2 * float(friction) * 20, rel=0.05)
    assert report.pull.weights == pytest.approx(report.pull.force / (0.1 * GRAVITY))


@pytest.mark.parametrize(
    ("impratio", "solref"),
    [
        pytest.param("1", ".02 1", marks=pytest.mark.long),
        ("5", ".02 1"),
        pytest.param("1", ".01 1", marks=pytest.mark.long),
    ],
)
def test_creep_is_that_of_regularised_friction(tmp_path: Path, impratio: str, solref: str) -> None:
    """An elliptic contact at rest bears f = b v / R, so that it creeps at v = f R / b.

    Its reference acceleration in the plane is -b v, b = 2 / (dmax timeconst); regularization is
    R = (1 - d) / d A / impratio, d the impedance at its depth, A the sum of both bodies' inverse
    weights in translation. N alike contacts share the weight, f = m g / N. What is left out is
    what depth differs by from contact to contact: 5 %.
    """
    text = claw_with_bar(20, 0.1, cone="elliptic", impratio=impratio, solref=solref)
    report, grip = judged(tmp_path, text, held_body="bar")
    model = grip.fixture.model
    found = find_contacts(model, data_at(model, grip.squeeze.row), grip.fixture.body)
    depth = float(np.mean([contact.depth for contact in found]))
    # solimp of MuJoCo: from .9 to .95 within a millimetre, by a quadratic on either side of half.
    way = min(depth / 1e-3, 1.0)
    share = 2 * way**2 if way < 0.5 else 1 - 2 * (1 - way) ** 2
    impedance = 0.9 + share * 0.05
    weights = model.body_invweight0[:, 0]
    bodies = model.geom_bodyid[[contact.geom for contact in found]]
    inverse = float(np.mean(weights[bodies])) + weights[grip.fixture.body]
    damping = 2 / (0.95 * float(solref.split(maxsplit=1)[0]))
    regular = (1 - impedance) / impedance * inverse / float(impratio)
    expected = 0.1 * GRAVITY / len(found) * regular / damping
    assert fast(report, "out of the hand") == pytest.approx(expected, rel=0.05)
    assert report.drifts[1].trend == "steady"


@pytest.mark.long
def test_no_step_cures_creep_and_impratio_does(tmp_path: Path) -> None:
    """Regularized friction is the model's: a quarter of the step creeps as fast, within 2 %."""
    base = claw(cone="elliptic")
    coarse, _ = judged(tmp_path, base, held_body=BOX, fixes=True)
    fine, _ = judged(tmp_path, base.replace('"0.002"', '"0.0005"'), held_body=BOX)
    stiff, _ = judged(tmp_path, claw(cone="elliptic", impratio="10"), held_body=BOX)
    speed = fast(coarse, "out of the hand")
    assert fast(fine, "out of the hand") == pytest.approx(speed, rel=0.02)
    assert fast(stiff, "out of the hand") == pytest.approx(speed / 10, rel=0.05)
    assert coarse.causes[0].kind == "regularized friction"


@pytest.mark.long
def test_a_mirrored_gripper_is_the_same(tmp_path: Path) -> None:
    """Sides, names, the sense of a slide's axis and the base's pose change nothing.

    Contacts are found in another order and frame: numbers agree to 2 %, that of a solver's stop.
    """
    mirrored = claw(left="q", right="p", base="z", quat="0 0 0 1", way="1")
    one, other = (
        judged(tmp_path, text.replace("0.002", "0.004"), held_body=BOX)[0]
        for text in (claw(), mirrored)
    )
    assert other.verdict == one.verdict
    assert other.opening == pytest.approx(one.opening, rel=1e-3)
    assert other.fingers[0].force == pytest.approx(one.fingers[0].force, rel=0.02)
    assert fast(other, "out of the hand") == pytest.approx(fast(one, "out of the hand"), rel=0.02)
    # The slide that points the other way closes at the other end.
    signs = {each.name: np.sign(each.closed_control) for each in other.controls}
    assert signs["a"] == -signs["b"]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("box:50x40x40mm,.1kg", "box:5x4x4cm,100g"),
        ("cylinder:30x60mm,.2kg", "cylinder:.03x.06m,200g"),
        ("box:30x40x40mm", "box:3x4x4cm,100g"),
    ],
)
def test_units_of_an_object(one: str, other: str) -> None:
    first, second = read_object(one), read_object(other)
    assert first.size == pytest.approx(second.size, rel=1e-12)
    assert first.mass == pytest.approx(second.mass, rel=1e-12)
    assert first.words == second.words


def test_what_is_round_is_held_by_the_middle_of_pads(tmp_path: Path) -> None:
    """Nearest points of flat pads are any that face each other; at an edge it would roll out."""
    asked = "cylinder:50x40mm,.1kg"
    report, grip = judged(tmp_path, claw(cone="elliptic", impratio="100"), held_body=asked)
    assert [each.force for each in report.fingers] == pytest.approx([20, 20], rel=1e-3)
    assert grip.squeeze.approach is not None
    assert np.linalg.norm((grip.squeeze.approach.point - [0.1, 0.2, 0.5])[1:]) < 1e-4
    assert report.verdict != "drops"


def test_actuators_are_held_against_their_limits(tmp_path: Path) -> None:
    text = claw().replace('ctrlrange="-20 20"', 'ctrlrange="-20 20" forcerange="-12 12"')
    report, _ = judged(tmp_path, text, held_body=BOX)
    assert {each.limit for each in report.controls} == {12.0}
    assert [each.force for each in report.fingers] == pytest.approx([12, 12], rel=1e-3)


@pytest.mark.long
def test_a_squeeze_is_found_or_refused(tmp_path: Path) -> None:
    report, _ = judged(tmp_path, claw(most="12"), held_body=BOX, squeeze=5.0)
    # To within the hundredth that a squeeze is sought to.
    assert [each.force for each in report.fingers] == pytest.approx([5, 5], rel=0.011)
    with pytest.raises(SweepFileError, match="the actuators give 12 N"):
        judged(tmp_path, claw(most="12"), held_body=BOX, squeeze=13.0)


def test_too_weak_a_squeeze_drops(tmp_path: Path) -> None:
    """2 mu F = 2 N holds no 3 N, but the motors have 20 N."""
    text = claw_with_bar(1, 0.3, cone="elliptic", impratio="100")
    report, _ = judged(tmp_path, text, keyframe="held", fixes=True)
    assert report.verdict == "drops"
    assert report.causes[0].kind == "weak squeeze"
    assert report.pull.weights < 1


@pytest.mark.parametrize("fixes", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_cause_names_only_tested_changes(tmp_path: Path, fixes: bool) -> None:
    """The control range of this squeeze ends at it, so that no more squeeze can be tested."""
    text = claw_with_bar(1, 0.3, cone="elliptic", impratio="100", most="1")
    report, _ = judged(tmp_path, text, keyframe="held", fixes=fixes)
    assert report.verdict == "drops"
    assert not any("squeeze" in fix.name for fix in report.fixes)
    sentence = report.causes[0].sentence
    assert "nor more squeeze" not in sentence
    assert ("friction" in sentence) == fixes


@pytest.mark.long
def test_a_full_force_is_why_no_more_squeeze_is_tested(tmp_path: Path) -> None:
    """Their controls leave a twentyfold squeeze, which their force limits do not."""
    text = claw_with_bar(1, 0.3, cone="elliptic", impratio="100")
    limited = text.replace('ctrlrange="-20 20"', 'ctrlrange="-20 20" forcerange="-1 1"')
    report, _ = judged(tmp_path, limited, keyframe="held", fixes=True)
    (note,) = (note for note in report.notes if "squeeze" in note)
    assert note == "More squeeze was not tested, since a and b press with their largest force."


def test_a_hand_that_gives_way_holds_as_much(tmp_path: Path) -> None:
    """Its slide follows a pull, which changes no force between pads and bar: 2 mu F = 2 N.

    Pulls differ by 5 % of that, and what slides is borne by as much at most: the tolerance.
    """
    text = claw_with_bar(1, 0.3, cone="elliptic", impratio="100")
    held, _ = judged(tmp_path, text, keyframe="held")
    slide = '<joint type="slide" axis="0 0 1" stiffness="500" damping="20"/>'
    text = text.replace('quat="1 0 0 0">', f'quat="1 0 0 0">{slide}')
    report, _ = judged(tmp_path, text.replace('qpos="', 'qpos="0 '), keyframe="held")
    assert held.pull.force == pytest.approx(2, rel=0.05)
    assert report.pull.force == pytest.approx(2, rel=0.05)


@pytest.mark.long
def test_remedies_of_a_keyframe_rank_and_hold_in_plain_mujoco(tmp_path: Path) -> None:
    """What is said to hold does: from the keyframe, four seconds of mj_step, at the speed told."""
    report, grip = judged(tmp_path, claw_with_bar(8, 0.1), keyframe="held", fixes=True)
    names = [each.name for each in report.fixes]
    first, friction = report.fixes[0], names.index("twice the pads' friction")
    assert report.verdict == "creeps"
    assert first.name.startswith(("elliptic", "noslip"))
    assert all(names.index(name) < friction for name in names if name.startswith("elliptic"))
    assert report.fixes[friction].worse
    for each in report.fixes:
        if each.verdict == "holds":
            assert each.lines
            model = grip.fixture.model.__copy__()
            model.opt.cone = int(each.options.get("cone", "pyramidal") == "elliptic")
            model.opt.impratio = float(str(each.options.get("impratio", 1)))
            model.opt.noslip_iterations = int(str(each.options.get("noslip_iterations", 0)))
            assert plain_speed(model) < report.tolerance
    own = plain_speed(grip.fixture.model)
    assert own == pytest.approx(fast(report, "as it is"), rel=0.1)


def plain_speed(model: mujoco.MjModel) -> float:
    """Return how fast a bar goes in the last two of four seconds from its keyframe [m/s]."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("held").id)
    steps = round(2 / model.opt.timestep)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    before = data.body("bar").xipos.copy()
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return float(np.linalg.norm(data.body("bar").xipos - before)) / 2


@pytest.mark.long
def test_the_bench_is_plain_mujoco(tmp_path: Path) -> None:
    """Loads on every body are gravity: a loop of mj_step under it goes the same way."""
    report, grip = judged(tmp_path, claw(), held_body=BOX)
    model = grip.fixture.model.__copy__()
    name = "out of the hand"
    model.opt.gravity[:] = GRAVITY * grip.directions()[name]
    data = mujoco.MjData(model)
    state = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_setState(model, data, grip.squeeze.row, state)
    steps = round(1 / model.opt.timestep)
    places = list[np.ndarray]()
    for _ in range(2):
        for _ in range(steps):
            mujoco.mj_step(model, data)
        places.append(data.xipos[grip.fixture.body].copy())
    speed = float(np.linalg.norm(places[1] - places[0]))
    # Of the second second; the report's is that of its last half.
    assert speed == pytest.approx(fast(report, name), rel=0.01)


@pytest.mark.parametrize(
    ("speeds", "trend"),
    [
        ([9, 1, 1, 1], "steady"),
        ([9, 1, 0.8, 0.6], "fading"),
        ([0, 1, 1.3, 1.7], "growing"),
        ([9, 1, 3, 0.1], "uneven"),
        ([9, 1, 1, 0], "still"),
    ],
)
def test_trends(speeds: list[float], trend: str) -> None:
    assert fit_pace(1e-3 * np.array(speeds, float)).trend == trend


@pytest.mark.parametrize(
    ("rest", "more", "ratio"), [(0, 2, 0.6), (1, 2, 0.5), (3, -2, 0.8), (0, 1, 1.3)]
)
def test_a_pace_goes_on_as_its_series(rest: float, more: float, ratio: float) -> None:
    """Speeds rest + more ratio^k go on so: the way is their sum, and when it is gone its inverse.

    A series that is none below zero and no faster than the speeds is told without an error.
    """
    speeds = rest + more * ratio ** np.arange(24.0)
    pace = fit_pace(speeds[:4])
    for windows in (1, 5, 20):
        way = float(speeds[4 : 4 + windows].sum())
        assert pace.travel_in(windows) == pytest.approx(way, rel=1e-9)
        assert pace.windows_until(way) == pytest.approx(windows, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "asked", "said"),
    [
        (claw().split("<actuator>", maxsplit=1)[0] + "</mujoco>", {}, "no actuators"),
        (claw(), {"held_body": "box:30mm"}, "write box:30x40x40mm"),
        (claw(), {"held_body": "box:200x40x40mm"}, "200 mm wide"),
        (claw(), {"held_body": "mug"}, "no body 'mug'"),
        (claw(), {"keyframe": "held"}, "no keyframe 'held'"),
        (claw(), {"base": "claws"}, "claws"),
        (claw(), {"base": "left"}, "no actuator moves two bodies"),
        (claw_with_bar(0, 0.1), {"keyframe": "held"}, "held"),
    ],
)
def test_what_cannot_be_measured_is_refused(
    tmp_path: Path, text: str, asked: dict[str, object], said: str
) -> None:
    with pytest.raises(SceneError, match=said):
        judged(tmp_path, text, **asked)


def test_python_and_words_agree(tmp_path: Path) -> None:
    path = saved(tmp_path, claw(cone="elliptic", impratio="100"))
    report = contactlab.grip(path, object=BOX)
    assert report.holds
    assert report.sentence.startswith("holds a box of 50x40x40 mm")
    with pytest.raises(SweepFileError, match="above 0"):
        contactlab.grip(path, tolerance=0.0)
    with pytest.raises(SweepFileError, match="write a speed"):
        contactlab.grip(path, tolerance="1mm")
