"""What `must` says has to hold is judged by the laws of Coulomb, Newton and the pendulum."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactlab
from contactlab.errors import SweepFileError
from contactlab.plan.task_options import TaskOptions
from contactlab.schema.requirement import read_requirement
from contactlab.studies.effects.configuration_runs import build_sweep
from contactlab.studies.effects.effects_request import EffectsRequest, read_setup

G = 9.81
WORDS = ("broken_requirement", "pair_expectation")


def record_of(folder: Path, model: str, must: Any, duration: float = 1.0, **keys: Any) -> Any:
    """Return the record of one run of a model."""
    (folder / "model.xml").write_text(model, encoding="utf-8")
    sweep = {"version": 1, "scene": str(folder / "model.xml"), "duration": duration, **keys}
    sweep |= {"must": must, "drive": "none"}
    store = contactlab.sweep(sweep, output=folder / "store", workers=0, fresh=True)
    return next(iter(store.records()))


def broken(record: Any) -> list[tuple[str, str, int]]:
    return [(each.label, each.reason, each.step) for each in record.labels if each.label in WORDS]


def slope(tilt: float, friction: float) -> str:
    """Return a box on a slope, as a box on a floor under tilted gravity."""
    x, z = G * np.sin(tilt), -G * np.cos(tilt)
    return f"""<mujoco><option timestep=".001" cone="elliptic" impratio="100" gravity="{x} 0 {z}"/>
<default><geom friction="{friction} 0 0" condim="3"/></default><worldbody>
<geom name="slope" type="plane" size="9 9 1"/><body name="box" pos="0 0 .05"><freejoint/>
<geom type="box" size=".1 .1 .05" mass="1"/></body></worldbody></mujoco>"""


def test_a_box_beyond_the_angle_of_friction_slides_by_coulombs_law(tmp_path: Path) -> None:
    friction, beyond, limit = 0.4, 0.1, 0.05
    tilt = float(np.arctan(friction) + beyond)
    must = [f"still(box, {limit} m)", "slides(box, from: 0.05 s)"]
    ((label, reason, step),) = broken(record_of(tmp_path, slope(tilt, friction), must))
    assert (label, f"still(box, {limit} m): moves by up to") == (label, reason[:34])
    # s = a t^2 / 2 from rest. Contact settles within a few time constants of its spring (20 ms),
    # before which the normal force, and so friction, is another: at most 20 ms of delay.
    along = G * (np.sin(tilt) - friction * np.cos(tilt))
    assert step * 0.001 == pytest.approx((2 * limit / along) ** 0.5, abs=0.02)


def test_a_box_within_the_angle_of_friction_is_still_and_does_not_slide(tmp_path: Path) -> None:
    friction = 0.4
    tilt = float(np.arctan(friction) - 0.1)
    must = ["still(box, 1 mm)", "stays(box)", "upright(box)", "slides(box, from: 0.05 s)"]
    ((label, reason, _),) = broken(record_of(tmp_path, slope(tilt, friction), must))
    assert label == "pair_expectation"
    assert "should slide, but sticks" in reason


LENGTH, START, LIMIT = 0.5, 0.1, np.pi / 6
PENDULUM = f"""<mujoco><option timestep=".001" integrator="RK4"/><worldbody>
<body name="pole"><joint axis="0 1 0"/><geom pos="0 0 {LENGTH}" size=".001" mass="1"
 contype="0" conaffinity="0"/><inertial pos="0 0 {LENGTH}" mass="1" diaginertia="0.0 0 0"/>
</body></worldbody><keyframe><key qpos="{START}"/></keyframe></mujoco>"""


def fall_time(inertia: float) -> float:
    """Return when a pendulum let go at an angle from the top reaches the limit [s].

    Energy: inertia w^2 / 2 = m g L (cos START - cos angle). With angle = START cosh u, whose
    derivative vanishes where w does, the integrand of dt = d(angle) / w is smooth.
    """
    end = np.arccosh(LIMIT / START)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    u = (nodes + 1) * end / 2
    angle = START * np.cosh(u)
    speed = np.sqrt(2 * G * LENGTH / inertia * (np.cos(START) - np.cos(angle)))
    return float((weights * START * np.sinh(u) / speed).sum() * end / 2)


def test_a_falling_pendulum_is_upright_until_the_closed_forms_time(tmp_path: Path) -> None:
    moment = 1e-5
    model = PENDULUM.replace('diaginertia="0.0 0 0"', f'diaginertia="{moment} {moment} {moment}"')
    record = record_of(tmp_path, model, "upright(pole)", axes={"keyframe": ["key[0]"]})
    ((_, reason, step),) = broken(record)
    assert reason.startswith("upright(pole): tilts by up to ")
    # RK4's error is far below a step, so that the first state beyond is the next one.
    assert 0 <= step * 0.001 - fall_time(LENGTH**2 + moment) <= 0.001


def test_a_pendulum_is_upright_within_the_time_and_the_angle_that_are_asked(tmp_path: Path) -> None:
    axes = {"keyframe": ["key[0]"]}
    until = fall_time(LENGTH**2) - 0.005
    text = [f"upright(pole, until: {until:.4f})", "upright(pole, 5.5 deg, until: 1 ms)"]
    model = PENDULUM.replace('"0.0 0 0"', '"1e-5 1e-5 1e-5"')
    assert broken(record_of(tmp_path, model, text[:1], axes=axes)) == []
    ((_, reason, step),) = broken(record_of(tmp_path, model, text, axes=axes))
    assert (reason[: len(text[1])], step) == (text[1], 0)


MASS, SQUEEZE = 0.2, 10.0


def grip(friction: float) -> str:
    """Return a mug between two pads of a hand, each pressed on it by a constant force."""
    pads = "".join(
        f"""<body name="{name}" pos="{x} 0 1"><joint name="{name}" type="slide" axis="{-sign} 0 0"
 damping="20"/><geom type="box" size=".01 .03 .03" mass=".1"/></body>"""
        for name, x, sign in (("left", -0.04, -1), ("right", 0.04, 1))
    )
    return f"""<mujoco><option timestep=".001" cone="elliptic" impratio="100"/>
<default><geom friction="{friction} 0 0" condim="3" solref=".005 1"/></default><worldbody>
<body name="hand">{pads}</body><body name="mug" pos="0 0 1"><freejoint/>
<geom type="box" size=".03 .03 .03" mass="{MASS}"/></body></worldbody><actuator>
<motor joint="left"/><motor joint="right"/></actuator><keyframe>
<key qpos="0 0 0 0 1 1 0 0 0" ctrl="{SQUEEZE} {SQUEEZE}"/></keyframe></mujoco>"""


def test_a_mug_is_held_while_friction_bears_its_weight(tmp_path: Path) -> None:
    must, axes = "held(mug, by: hand)", {"keyframe": ["key[0]"]}
    bearing = MASS * G / (2 * SQUEEZE)
    assert broken(record_of(tmp_path, grip(2 * bearing), must, axes=axes)) == []
    friction = 0.5 * bearing
    ((label, reason, step),) = broken(record_of(tmp_path, grip(friction), must, 0.5, axes=axes))
    assert label == "broken_requirement"
    assert reason.startswith(f"{must}: moves in its grip by up to")
    # It sinks by 10 mm at the rate that friction of both pads leaves of gravity; the grip closes
    # within a few time constants of contact (5 ms), in which it is free.
    sinking = G - 2 * friction * SQUEEZE / MASS
    assert step * 0.001 == pytest.approx((2 * 0.01 / sinking) ** 0.5, abs=0.01)


def test_what_rests_beside_a_hand_is_not_held(tmp_path: Path) -> None:
    model = (
        grip(1.0)
        .replace('ctrl="10.0 10.0"', 'ctrl="-1 -1"')
        .replace("<worldbody>", '<worldbody><geom type="plane" size="1 1 1" pos="0 0 .97"/>')
        .replace('pos="-0.04 0 1"', 'pos="-0.06 0 1.1"')
        .replace('pos="0.04 0 1"', 'pos="0.06 0 1.1"')
    )
    ((_, reason, _),) = broken(
        record_of(tmp_path, model, "held(mug, by: hand)", 0.3, axes={"keyframe": ["key[0]"]})
    )
    assert "its holder does not touch it for 0.3 s, from 0 s on" in reason


def falling(beside: float) -> str:
    return f"""<mujoco><option timestep=".001"/><worldbody><body name="plate" pos="0 0 .5"/>
<site name="hole" pos="0 0 .5"/><body name="peg" pos="{beside} 0 1"><freejoint/>
<geom size=".01"/></body></worldbody></mujoco>"""


@pytest.mark.long
@pytest.mark.parametrize("hole", ["hole", "plate"])
def test_a_falling_peg_passes_the_hole_that_it_is_above_of(tmp_path: Path, hole: str) -> None:
    fall = (2 * 0.5 / G) ** 0.5
    assert broken(record_of(tmp_path, falling(0.004), f"passes(peg, {hole}, 5 mm)", 0.5)) == []
    text = f"passes(peg, {hole}, 5 mm)"
    ((_, reason, step),) = broken(record_of(tmp_path, falling(0.012), text, 0.5))
    assert f"{text}: it passes at 12 mm, which is 7 mm too far" in reason
    # Semi-implicit steps fall farther than g t^2 / 2 by g t h / 2, half a step's way.
    assert step * 0.001 == pytest.approx(fall, abs=0.0015)
    late = f"passes(peg, {hole}, until: {fall - 0.05:.3f})"
    ((_, reason, _),) = broken(record_of(tmp_path, falling(0), late, 0.5))
    assert "it stays on one side" in reason


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("stil(box)", "did you mean 'still'"),
        ("hovers(box)", "write one of held(mug, by: hand), still(box, 1 mm)"),
        ("still(box", "is not whole; write still(box, 1 mm)"),
        ("still()", "'still' is written still(box, 1 mm)"),
        ("still(box, 1 kg)", "'1 kg' is not a tolerance here"),
        ("upright(box, 3 mm)", "'3 mm' is not a tolerance here"),
        ("slides(box, 1 mm)", "'slides' is written"),
        ("held(mug)", "needs `by:`"),
        ("still(mug, by: hand)", "takes no `by:`"),
        ("stays(box, from: 2 mm)", "`from: 2 mm` is no time"),
        ("stays(box, from: 2 s, until: 1 s)", "`until` is not after `from`"),
    ],
)
def test_what_is_written_wrongly_is_refused_with_what_to_write(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        read_requirement(text)


def test_units_are_read() -> None:
    said = read_requirement("still(a.b[3], 5deg, from: 20 ms, until: 1.5)")
    found = said.names, said.unit, said.start, said.stop
    assert found == (("a.b[3]",), "rad", 0.02, 1.5)
    assert said.limit == pytest.approx(np.radians(5))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("still(bix)", "no body 'bix'; did you mean 'box'"),
        ("passes(box, slop)", "no body or site 'slop'"),
        ("held(box, by: bx)", "no body 'bx'; did you mean 'box'"),
        ("slides(world, until: 3 s)", "3 s is after the end of the run"),
        ("stays(box, from: 1 s)", "1 s is outside the run"),
    ],
)
def test_names_and_times_are_those_of_the_model(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(SweepFileError) as refused:
        record_of(tmp_path, slope(0.1, 1), [text])
    assert said in str(refused.value)
    with pytest.raises(SweepFileError) as refused:
        contactlab.examine(
            tmp_path / "model.xml",
            section=["checks"],
            require=text,
            duration=1,
            output=tmp_path / "c",
        )
    assert said in str(refused.value)


def test_a_scene_keeps_what_must_hold(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(slope(0.6, 0.4), encoding="utf-8")
    scene = """version: 1\ntitle: slope\ndescription: a box on a slope\nduration: 1
pairs: [{bodies: [world, box]}]\nmust: ["still(box)"]\n"""
    (tmp_path / "scene.yaml").write_text(scene, encoding="utf-8")
    sweep = {"version": 1, "scene": str(tmp_path)}
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    ((_, reason, _),) = broken(next(iter(store.records())))
    assert reason.startswith("still(box): moves by up to")
    (tmp_path / "scene.yaml").write_text(scene.replace("box)", "bx)"), encoding="utf-8")
    with pytest.raises(SweepFileError, match="no body 'bx'; did you mean 'box'"):
        contactlab.sweep(sweep, output=tmp_path / "other", workers=0)


@pytest.mark.long
def test_check_and_stability_fail_what_must_hold_and_say_why(tmp_path: Path) -> None:
    (tmp_path / "model.xml").write_text(slope(0.6, 0.4), encoding="utf-8")
    keys: dict[str, Any] = {"duration": "0.3s", "drive": "none", "workers": 0}
    must = ["still(box, 1 mm)", "stays(box, 2 m)"]
    model, folder = tmp_path / "model.xml", tmp_path / "check"
    report = contactlab.examine(model, check=["requirements"], require=must, output=folder, **keys)
    (result,) = report.checks
    assert (report.passed, result.verdict) == (False, "fail")
    assert [note.split(" by ")[0] for note in result.notes] == [
        f"seed {seed}: still(box, 1 mm): moves" for seed in range(3)
    ]
    met = contactlab.examine(model, check=["requirements"], require=must[1], output=folder, **keys)
    assert met.passed
    held = contactlab.examine(model, section=["labels"], require=must, output=folder, **keys)
    assert not held.passed
    (label,) = held.labels
    assert (label.label, label.runs) == ("broken_requirement", 3)
    assert label.reason.startswith("still(box, 1 mm): moves by up to")


def test_what_would_be_ignored_is_refused_with_what_to_write(tmp_path: Path) -> None:
    record_of(tmp_path, slope(0.1, 1), [], 0.05)
    store = tmp_path / "store"
    parts = {"tolerance": "10%", "observe": "box", "require": "still(box)", "duration": "1s"}
    for name, value in parts.items():
        part: dict[str, Any] = {name: value}
        with pytest.raises(SweepFileError, match=f"--{name} would be ignored: the runs of") as said:
            contactlab.tradeoff(store, **part)
        assert "\n" not in str(said.value)
    with pytest.raises(
        SweepFileError, match=r"--tolerance would be .* write --tolerance METRIC=VALUE"
    ):
        contactlab.report(store, tolerance="10%")


def test_an_ablation_keeps_what_must_hold_in_every_run(tmp_path: Path) -> None:
    (tmp_path / "model.xml").write_text(slope(0.6, 0.4), encoding="utf-8")
    sweep = {"version": 1, "scene": "model.xml", "must": "still(box)"}
    (tmp_path / "sweep.yaml").write_text(json.dumps(sweep), encoding="utf-8")
    of_file = read_setup(EffectsRequest(str(tmp_path / "sweep.yaml")))
    said = TaskOptions(require=("stays(box)", "upright(box)"))
    of_flag = read_setup(EffectsRequest(str(tmp_path / "sweep.yaml"), task=said))
    assert build_sweep(of_file, [{}], {})["must"] == ["still(box)"]
    assert build_sweep(of_flag, [{}], {})["must"] == ["stays(box)", "upright(box)"]
