"""What is too fast for its step goes through walls of any shape, and is caught; else it is not."""

from math import prod
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines import passages
from contactlab.engines.passages import Passages

CUBE = "-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"
WALLS = {
    "box": 'type="box" size=".004 .2 .2"',
    "ellipsoid": 'type="ellipsoid" size=".004 .2 .2"',
    "cylinder": 'type="cylinder" size=".2 .004" euler="0 90 0"',
    "capsule": 'type="capsule" size=".006 .2"',
    "mesh": 'type="mesh" mesh="sheet"',
    "hfield": 'type="hfield" hfield="ground" euler="0 -90 0"',
    "plane": 'type="plane" size=".2 .2 .1" euler="0 -90 0"',
}
MODEL = f"""
<mujoco>
  <compiler angle="degree"/>
  <option timestep="0.002" gravity="0 0 0"/>
  <asset>
    <mesh name="sheet" scale=".004 .2 .2" vertex="{CUBE}"/>
    <hfield name="ground" nrow="3" ncol="3" size=".2 .2 .01 .05" elevation="0 0 0 0 1 0 0 0 0"/>
  </asset>
  <worldbody>
    <body name="wall" pos="0 0 0">{{hinge}}<geom name="wall" {{wall}} mass="5"/></body>
    <body name="shot" pos="-.3 0 0">{{joint}}<geom name="shot" size=".01" mass=".1"
      solref=".004 1" priority="1"/></body>
  </worldbody>
  <keyframe><key qvel="{{still}}{{speed}}{{rest}}"/></keyframe>
</mujoco>
"""
SWEEP = "version: 1\nscene: model.xml\nduration: .2\ndrive: none\ntrace: none\naxes: {}\n"
FREE, SLIDE = ("<freejoint/>", " 0 0 0 0 0"), ('<joint type="slide" axis="1 0 0"/>', "")


def reasons(sweeper: Any, **parts: object) -> list[str]:
    (sweeper.folder / "model.xml").write_text(MODEL.format(**parts))
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    return [each for each in row["label_reasons"] if "passed" in each or "deeper" in each]


@pytest.mark.long
@pytest.mark.parametrize("joint", [FREE, SLIDE], ids=["free", "slide"])
@pytest.mark.parametrize("wall", WALLS)
@pytest.mark.parametrize(("speed", "passes"), [(60, True), (2, False)])
def test_a_shot_goes_through_a_wall_of_any_shape(
    sweeper: Any, wall: str, joint: tuple[str, str], speed: float, passes: bool
) -> None:
    """At 60 m/s a step is 12 cm long: six times what the shot and the thickest wall measure."""
    (text, rest), moves = joint, {"hinge": "", "still": ""}
    found = reasons(sweeper, wall=WALLS[wall], joint=text, speed=speed, rest=rest, **moves)
    assert bool(found) == passes


def test_a_moving_wall_passes_a_body_at_rest(sweeper: Any) -> None:
    hinge = '<joint axis="0 0 1" pos="0 -.2 0"/>'
    parts = {"wall": WALLS["box"], "joint": FREE[0], "speed": "0", "rest": FREE[1]}
    # At 200 rad/s the middle of the wall, .2 m from its hinge, moves by 8 cm in a step.
    assert reasons(sweeper, hinge=hinge, still="200 ", **parts)


def test_what_cannot_touch_may_pass(sweeper: Any) -> None:
    wall = WALLS["box"] + ' contype="0" conaffinity="0"'
    parts = {"joint": FREE[0], "speed": 60, "rest": FREE[1], "hinge": "", "still": ""}
    assert not reasons(sweeper, wall=wall, **parts)


NET = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <flexcomp name="net" type="grid" count="{count}" spacing=".05 .05 .05" pos="0 0 0" radius=".005"
      dim="{dim}" mass="1"><edge equality="true" damping=".1"/>
      <contact selfcollide="none"/></flexcomp>
    <body name="shot" pos=".012 .007 .2"><joint type="slide" axis="0 0 -1"/>
      <geom name="shot" size=".01" mass=".01"/></body>
  </worldbody>
  <keyframe><key qvel="{still}{speed}"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize(("speed", "passes"), [(60, True), (1, False)])
@pytest.mark.parametrize(("dim", "count"), [(2, (5, 5, 1)), (3, (4, 4, 2))], ids=["cloth", "body"])
def test_a_shot_goes_through_a_flex(
    sweeper: Any, dim: int, count: tuple[int, int, int], speed: float, passes: bool
) -> None:
    """At 60 m/s a step is 12 cm long, and the flex at z = 0 is met in the second one."""
    still = "0 " * 3 * prod(count)
    model = NET.format(still=still, speed=speed, dim=dim, count="{} {} {}".format(*count))
    (sweeper.folder / "model.xml").write_text(model)
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    assert ("shot passed through net" in " ".join(row["label_reasons"])) == passes


@pytest.mark.parametrize("speed", [20.0, 0.5])
def test_a_rod_passes_by_its_end_too(sweeper: Any, speed: float) -> None:
    """Its centre goes 0.3 m above the wall, and its end through it, by 4 cm a step or 1 mm."""
    (sweeper.folder / "model.xml").write_text(
        f"""<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody>
        <geom name="wall" type="box" size=".004 .2 .05" pos="0 .1 .01"/><body pos="-.05 0 0">
        <joint type="slide" axis="1 0 0"/><geom name="rod" type="capsule" size=".005"
        fromto="0 0 0 0 0 .6" mass=".1" solref=".004 1"/></body></worldbody>
        <keyframe><key qvel="{speed}"/></keyframe></mujoco>"""
    )
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    assert any("passed through" in each for each in row["label_reasons"]) == (speed > 1)


@pytest.mark.parametrize(("far", "step", "passes"), [(0.25, 0.02, True), (0.35, 0.02, False)])
def test_what_turns_far_in_a_step_is_followed_within_it(
    sweeper: Any, far: float, step: float, passes: bool
) -> None:
    """At 90 rad/s a step turns the blade, .32 m long, by 1.8 rad: past a bar that is near enough.

    The bar lies across, and neither its centre nor its ends are where the blade goes.
    """
    (sweeper.folder / "model.xml").write_text(
        f"""<mujoco><option timestep="{step}"/><worldbody><body>
        <joint axis="1 0 0"/><geom name="blade" type="box" size=".004 .16 .015" pos="0 .16 0"
        mass=".1"/></body><geom name="bar" type="capsule" size=".008"
        fromto="-.1 0 {far} .05 0 {far}"/></worldbody><keyframe><key qvel="90"/></keyframe>
        </mujoco>"""
    )
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    assert any("passed through" in each for each in row["label_reasons"]) == passes


def test_a_ball_that_spins_fast_passes_nothing(sweeper: Any) -> None:
    """It grazes a bar and spins away: seen from what turns, the bar swirls through the ball."""
    (sweeper.folder / "model.xml").write_text(
        """<mujoco><option timestep=".005" gravity="0 0 0"/><worldbody>
        <geom type="capsule" size=".02 .3"/><body pos="-.5 .0385 0"><freejoint/>
        <geom size=".02" mass=".1" solref=".01 1"/></body></worldbody>
        <keyframe><key qvel="20 0 0 0 0 0"/></keyframe></mujoco>"""
    )
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    assert row["labels"] == ["stable"]


@pytest.mark.parametrize(("speed", "passes"), [(60, True), (0.2, False)])
@pytest.mark.parametrize("place", [0.0, 0.02], ids=["vertex", "edge"])
def test_a_bar_is_passed_by_a_rope(sweeper: Any, place: float, speed: float, passes: bool) -> None:
    """It falls across the bar, which meets a vertex of it or the middle of an edge."""
    velocity = f" 0 0 -{speed}" * 5
    (sweeper.folder / "model.xml").write_text(
        f"""<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody><geom name="bar"
        type="box" size=".01 .3 .01" pos="{place} 0 -.2"/><flexcomp name="rope" type="grid" dim="1"
        count="5 1 1" spacing=".04 .04 .04" mass=".1" radius=".005"><edge equality="true"/>
        <contact selfcollide="none"/></flexcomp></worldbody>
        <keyframe><key qvel="{velocity}"/></keyframe></mujoco>"""
    )
    sweeper.run(SWEEP)
    (row,) = sweeper.rows()
    assert ("rope passed through bar" in " ".join(row["label_reasons"])) == passes


@pytest.mark.long
def test_stretches_hide_no_passage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast bodies that turn pass through each other and a plate: as many as in whole runs."""
    rng, total = np.random.default_rng(0), 0
    starts: Any = SimpleNamespace(input_rows=lambda *_: np.zeros((1, 0)))
    for _ in range(12):
        model, states = random_motion(rng)
        search = Passages(model, 1)
        search.enter_run(0, model, starts, states)
        with monkeypatch.context() as patch:
            patch.setattr(passages.ClosePairs, "find_stretch", whole_stretch)
            obvious = Passages(model, 1)
            obvious.enter_run(0, model, starts, states)
        assert search.found == obvious.found
        total += len(search.found[0])
    assert total > 20


def whole_stretch(close: Any, mover: int, *_: object) -> slice:
    return slice(len(close.position) if mover > 1 else 0)  # a plane and a field do not move


def random_motion(rng: np.random.Generator) -> tuple[mujoco.MjModel, np.ndarray]:
    """Return four fast bodies over a plane, a plate and a height field, and 60 of their states."""
    kinds = ["sphere", "box", "capsule", "ellipsoid", "cylinder"]
    bodies = "".join(
        f'<body pos="{x:.3f} {y:.3f} {abs(z) + 0.3:.3f}"><freejoint/>'
        f'<geom type="{rng.choice(kinds)}" size="{r:.3f} {s:.3f} {t:.3f}" pos="{r:.3f} 0 0"/>'
        f'<geom type="{rng.choice(kinds)}" size="{t:.3f} {r:.3f} {s:.3f}" euler="10 20 30"/></body>'
        for (x, y, z), (r, s, t) in zip(
            rng.normal(0, 0.4, (4, 3)), 10 ** rng.uniform(-2, -0.5, (4, 3)), strict=True
        )
    )
    asset = (
        '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 .2 .1" elevation="0 1 1 0"/></asset>'
    )
    fixed = '<geom type="plane" size="3 3 .1"/><geom type="hfield" hfield="h" pos="0 0 .1"/>'
    plate = '<geom type="box" size="1 1 .01" pos="0 0 .4"/>'
    option = '<option timestep="0.01"/><default><geom solref="-30 -1"/></default>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco>{option}{asset}<worldbody>{fixed}{plate}{bodies}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel[:] = rng.normal(0, 8, model.nv)
    states = [np.concatenate([[data.time], data.qpos, data.qvel])]
    for _ in range(60):
        mujoco.mj_step(model, data)
        states.append(np.concatenate([[data.time], data.qpos, data.qvel]))
    return model, np.array(states)
