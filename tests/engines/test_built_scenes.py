"""Engines whose scenes adapters build by the engine's own API, from the compiled model."""

import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.contact_laws import damping_ratio, restitution_from_damping
from contactlab.engines.adapted_engine import AdaptedEngine, adapted_engines
from contactlab.resources import ADAPTERS

ENGINES = {each.name: each for each in adapted_engines()}
ADAPTED = Path(__file__).parent / "adapted"
# What moves in every way that an engine knows.
TREES = {
    "bullet": re.sub('armature="[^"]*"', "", (ADAPTED / "tree.xml").read_text(encoding="utf-8")),
    "sapien": (ADAPTED / "branches.xml").read_text(encoding="utf-8"),
    "genesis": (ADAPTED / "tree.xml").read_text(encoding="utf-8"),
}


def installed(name: str, *values: object) -> Any:
    absent = not ENGINES[name].version
    why = f"contactlab parity --install {name} was not run here"
    return pytest.param(name, *values, marks=pytest.mark.skipif(absent, reason=why), id=name)


BUILT = ("bullet", "sapien", "genesis")
built = pytest.mark.parametrize("name", [installed(name) for name in BUILT])


def simulated(
    engine: AdaptedEngine, model: mujoco.MjModel, data: mujoco.MjData, steps: int
) -> dict[str, np.ndarray] | str:
    """Return what an engine makes of a model from a state, or what went wrong."""
    binary = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    request = {
        "operation": "simulate",
        "device": "",
        "models": [binary.tobytes()],
        "steps": steps,
        "places": np.zeros(0, int),
        "levels": np.zeros((1, steps, 0)),
        "mocap": np.zeros((1, 0)),
        "applied": data.xfrc_applied.reshape(1, -1),
    }
    request |= {name: getattr(data, name)[None] for name in ("qpos", "qvel", "ctrl", "act")}
    return engine._process.ask(request, lambda: None)  # pyright: ignore[reportPrivateUsage]


def states(engine: AdaptedEngine, model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> Any:
    told = simulated(engine, model, data, steps)
    assert not isinstance(told, str), told
    assert (told["cost"] > 0).all()
    return told["state"][0]


@pytest.mark.night
@built
def test_every_joint_moves_as_in_mujoco_to_first_order(name: str) -> None:
    """Both step velocities first, from forces at the old state: half the step, half the way off."""
    off = []
    for timestep in (1e-3, 5e-4, 2.5e-4):
        model = mujoco.MjModel.from_xml_string(TREES[name])
        model.opt.timestep = timestep
        data = mujoco.MjData(model)
        data.qvel[:] = np.sin(1 + np.arange(model.nv))
        mujoco.mj_integratePos(model, data.qpos, np.cos(np.arange(model.nv)), 0.3)
        data.ctrl[:] = 0.3
        told = states(ENGINES[name], model, data, steps := round(0.2 / timestep))
        assert told[0] == pytest.approx(np.concatenate([data.qpos, data.qvel]), abs=1e-12)
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        for _ in range(steps):
            mujoco.mj_step(model, data)
        off.append(np.abs(told[-1] - np.concatenate([data.qpos, data.qvel])).max())
    assert off[0] / off[1] == pytest.approx(2, rel=0.1)
    assert off[1] / off[2] == pytest.approx(2, rel=0.1)
    assert off[2] < 0.01


ONE = """
<mujoco><option timestep="{step}" {option}/>
  <worldbody><geom name="floor" type="plane" size="1 1 .1" {both}/>
    <body name="one" pos="0 0 {height}"><freejoint/>
      <geom name="one" {shape} mass="2" {both}/></body>
  </worldbody>{end}
</mujoco>"""
BOX = {"shape": 'type="box" size=".1 .1 .05"', "height": ".05"}
BALL = {"shape": 'size=".05"', "height": "1.05"}


def one(step: float, shape: dict[str, str], **rest: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    given = {"option": "", "both": "", "end": ""} | shape | rest
    model = mujoco.MjModel.from_xml_string(ONE.format(step=step, **given))
    return model, mujoco.MjData(model)


@pytest.mark.night
@built
def test_a_fall_and_a_pendulum_keep_their_closed_forms(name: str) -> None:
    model, data = one(0.001, BALL)
    fallen = states(ENGINES[name], model, data, 400)
    # Velocities first: g h^2 n (n + 1) / 2; 400 steps round 1.05 m.
    rounding = 400 * PRECISION[name] * 1.05
    assert fallen[-1, 2] - 1.05 == pytest.approx(-9.81 * 1e-6 * 400 * 401 / 2, abs=rounding)
    swings = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.0005"/><worldbody><body><joint axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -1" size=".02" mass="1"/>'
        "</body></worldbody></mujoco>"
    )
    data = mujoco.MjData(swings)
    data.qpos[0] = 0.01
    told = states(ENGINES[name], swings, data, 8000)[:, 0]
    crossings = np.flatnonzero((told[:-1] > 0) & (told[1:] <= 0))
    exact = crossings + told[crossings] / (told[crossings] - told[crossings + 1])
    inertia = swings.body_inertia[1, 1] + 0.25
    period = 2 * math.pi * math.sqrt(inertia / (9.81 * 0.5))
    # The amplitude adds .01^2 / 16 of it; the step (w h)^2 / 24, w h being 2e-3; 5,000 roundings.
    assert (exact[-1] - exact[0]) * 5e-4 / (len(exact) - 1) == pytest.approx(
        period, rel=1e-5 + 5000 * PRECISION[name]
    )


@pytest.mark.night
@pytest.mark.parametrize("name", [installed("cenic")])
def test_a_fall_with_error_control_is_off_by_the_root_of_its_accuracy(name: str) -> None:
    """Steps h of first order are off by a h^2 / 2 each, which the accuracy limits.

    Of a time T that is a T h / 2. Force and weight act alike: both are off by one share.
    """
    off: list[float] = []
    for accuracy in ("1e-4", "1e-6"):
        model, data = one(0.001, BALL, option=f'tolerance="{accuracy}"')
        data.xfrc_applied[1, 0] = 4
        data.qvel[3:] = spin = [1, 2, 3]
        told = states(ENGINES[name], model, data, 400)
        pushed, fallen = told[-1, 0] - 4 / 2 * 0.4**2 / 2, told[-1, 2] - 1.05 + 9.81 * 0.4**2 / 2
        assert pushed / fallen == pytest.approx(-4 / 2 / 9.81, rel=1e-6)
        assert told[-1, 10:13] == pytest.approx(spin, abs=1e-12)
        off.append(abs(fallen))
    assert off[0] / off[1] == pytest.approx(10, rel=0.1)
    assert off[1] < 1e-3


@pytest.mark.night
@pytest.mark.parametrize("name", [installed("cenic")])
def test_a_bounce_with_error_control_loses_less_the_more_accurate_it_is(name: str) -> None:
    def left(accuracy: str) -> float:
        option, both = f'tolerance="{accuracy}"', 'solref="-160000 0"'
        model, data = one(0.001, BALL, option=option, both=both)
        end = states(ENGINES[name], model, data, 700)[-1]
        return ((end[2] - 0.05) * 9.81 + end[9] ** 2 / 2) / 9.81

    # As above, of an energy: from 1e-4 to 1e-6 a tenth.
    assert abs(left("1e-6") - 1) < 0.2 * abs(left("1e-4") - 1)
    assert left("1e-6") == pytest.approx(1, abs=0.05)


@pytest.mark.night
@pytest.mark.parametrize("name", [installed(name) for name in (*BUILT, "cenic")])
@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_box_holds_below_the_arctangent_of_friction_and_slides_above(
    name: str, friction: float
) -> None:
    for off, moves in ((-0.5, False), (0.5, True)):
        tilt = math.atan(friction) + math.radians(off)
        gravity = f'gravity="{9.81 * math.sin(tilt)} 0 {-9.81 * math.cos(tilt)}"'
        option = f'{gravity} tolerance="1e-6"'
        model, data = one(0.001, BOX, option=option, both=f'friction="{friction}"')
        slid = states(ENGINES[name], model, data, 1000)[-1, 0]
        expected = 9.81 * (math.sin(tilt) - friction * math.cos(tilt)) / 2 * moves
        # Half a degree moves it by 43 mm in a second; what lands and rocks first, by a tenth.
        assert abs(slid - expected) < 5e-3


@pytest.mark.night
@built
def test_contact_forces_are_the_momentum_that_bodies_take(name: str) -> None:
    slots = "".join(
        f'<contact name="{each}" geom1="{one}" geom2="{other}" num="8" '
        'data="found force torque dist pos normal tangent linvel angvel"/>'
        for each, one, other in (("on", "floor", "one"), ("back", "one", "floor"))
    )
    model, data = one(0.002, BOX, end=f"<sensor>{slots}</sensor>")
    data.qvel[:3] = 1, 0.5, -1
    told = simulated(ENGINES[name], model, data, 100)
    assert not isinstance(told, str), told
    speeds = told["state"][0][:, 7:10]
    taken = np.diff(speeds, axis=0) / 0.002 * 2 - [0, 0, -9.81 * 2]
    for first, sign in ((0, 1), (8 * 23, -1)):
        rows = told["sensors"][0][:, first : first + 8 * 23].reshape(100, 8, 23)
        frames = np.stack(
            [rows[..., 11:14], rows[..., 14:17], np.cross(rows[..., 11:14], rows[..., 14:17])], 2
        )
        force = sign * np.einsum("nsi,nsij->nj", rows[..., 1:4], frames)
        scale = np.abs(taken).max()
        assert scale > 9.81
        # SAPIEN tells forces along normals alone.
        told_of = slice(2, 3) if name == "sapien" else slice(3)
        rounding = PRECISION[name] * 2 / 0.002 * 2
        assert np.abs(force - taken)[:, told_of].max() < 1e-9 * scale + 10 * rounding


PRECISION = {"bullet": 2e-16, "sapien": 6e-8, "genesis": 2e-16}

PLANTED = [
    ("bullet", "baseMass=float(", "baseMass=1.01 * float(",
     "the mass of body 'one' was sent as 2 and arrived as 2.02"),
    ("bullet", "inertia = list(model.body_inertia[body])",
     "inertia = list(model.body_inertia[body][::-1])", "the inertia of body 'one'"),
    ("bullet", "laws[name].get(geom, 0.0)}", "laws[name].get(1 - geom, 0.0)}",
     "the friction of geom 'one'"),
    ("bullet", "halfExtents=list(size)", "halfExtents=list(1.01 * size)", "the size of geom 'one'"),
    ("bullet", "touch = int((one, other) in self._pairs)", "touch = 1",
     "geom 'floor' and geom 'filtered' touch, which the model filters"),
    ("bullet", "touch = int((one, other) in self._pairs)", "touch = 0", "overlap by"),
    ("bullet", "np.array(self._model.jnt_axis[joint])", "-np.array(self._model.jnt_axis[joint])",
     "the place of body 'arm'"),
    ("sapien", "set_mass(float(", "set_mass(1.01 * float(",
     "the mass of body 'one' was sent as 2 and arrived as 2.02"),
    ("sapien", "set_inertia(inertias[body])", "set_inertia(inertias[body][::-1])",
     "the inertia of body 'one'"),
    ("sapien", "(self._laws[name].get(geom, 0.0)", "(self._laws[name].get(1 - geom, 0.0)",
     "the friction of geom 'floor'"),
    ("sapien", "CollisionShapeBox(np.array(size)", "CollisionShapeBox(1.01 * np.array(size)",
     "the size of geom 'one'"),
    ("sapien", "set_collision_groups([*self._masks[geom], 0, 0])",
     "set_collision_groups([63, 63, 0, 0])", "the mask of geom 'floor'"),
    ("sapien", "np.array(model.jnt_axis[number])", "-np.array(model.jnt_axis[number])",
     "the place of body 'arm'"),
    ("genesis", "sent.jnt_stiffness[:] = 0", "sent.body_mass[1] *= 1.01",
     "the mass of body 'one' was sent as 2 and arrived as 2.02"),
    ("genesis", "sent.jnt_stiffness[:] = 0", "sent.body_inertia[1] = sent.body_inertia[1][::-1]",
     "the inertia of body 'one'"),
    ("genesis", "sent.geom_friction[geom] = laws[geom][:3]",
     "sent.geom_friction[geom] = laws[(geom + 1) % 3][:3]", "the friction of geom 'floor'"),
    ("genesis", "sent.jnt_stiffness[:] = 0", "sent.geom_size[1] *= 1.01", "the size of geom 'one'"),
    ("genesis", "sent.geom_conaffinity[geom] = own, others",
     "sent.geom_conaffinity[geom] = own, 63",
     "geom 'floor' and geom 'filtered' may touch, which the model filters"),
    ("genesis", "sent.jnt_stiffness[:] = 0", "sent.jnt_axis[-2] *= -1", "the place of body 'arm'"),
]  # fmt: skip
SEEN = """
<mujoco><option timestep=".002"/>
  <worldbody><geom name="floor" type="plane" size="1 1 .1" friction=".5" contype="1"/>
    <body name="one" pos="0 0 .05"><freejoint/>
      <geom name="one" type="box" size=".1 .12 .05" mass="2" friction=".4" priority="1"/></body>
    <body name="other" pos="1 0 .05"><freejoint/>
      <geom name="other" type="box" size=".1 .12 .05" mass="2" friction=".3" priority="1"/></body>
    <body name="filtered" pos="2 0 .04"><freejoint/><geom name="filtered" size=".05" contype="2"
      conaffinity="2"/></body>
    <body pos="2 0 .2"><freejoint/><geom size=".05" contype="2" conaffinity="2"/></body>
    <body name="arm" pos="0 2 1"><joint axis="0 1 0" pos="0 0 .1"/>
      <geom size=".02" mass="1" contype="0" conaffinity="0"/>
      <body name="hung" pos=".2 0 0"><joint axis="1 0 .3" type="slide"/>
        <geom size=".02" mass="1" contype="0" conaffinity="0"/></body></body>
  </worldbody>
</mujoco>"""


def said_of_planted(
    folder: Path,
    name: str,
    part: str,
    change: tuple[str, str],
    model: mujoco.MjModel,
    steps: int,
) -> str:
    """Return what an adapter says of a model, which it simulates, once its code is changed."""
    data = mujoco.MjData(model)
    assert not isinstance(simulated(ENGINES[name], model, data, steps), str)
    shutil.copytree(ADAPTERS, folder / "adapters")
    engine, changed = folder / "adapters" / f"{name}.py", folder / "adapters" / part
    text = changed.read_text(encoding="utf-8")
    assert text.count(change[0]) == 1
    changed.write_text(text.replace(*change), encoding="utf-8")
    found = simulated(AdaptedEngine(engine), model, data, steps)
    assert isinstance(found, str)
    return found


@pytest.mark.night
@pytest.mark.parametrize(
    ("name", "code", "planted", "told"),
    [installed(name, *rest) for name, *rest in PLANTED],
)
def test_what_is_changed_on_the_way_is_found(
    tmp_path: Path, name: str, code: str, planted: str, told: str
) -> None:
    model = mujoco.MjModel.from_xml_string(SEEN)
    assert told in said_of_planted(tmp_path, name, f"{name}.py", (code, planted), model, 20)


PLANTED_IN_DYNAMICS = [
    ("drake", "beside/drake_contacts.py", "mass, centre = float(", "mass, centre = 1.01 * float(",
     "the mass of body 'one' was sent as 2 and arrived as 2.02"),
    ("drake", "beside/drake_contacts.py", "np.diag(model.body_inertia[body])",
     "np.diag(model.body_inertia[body][::-1])", "the inertia of body 'one'"),
    ("drake", "beside/drake_contacts.py", "CoulombFriction(friction, friction)",
     "CoulombFriction(friction + body / 10, friction)",
     "the friction of geom 'floor' and geom 'one'"),
    ("drake", "beside/drake_contacts.py", "_BOX: 2 * size}", "_BOX: 2.02 * size}",
     "the size of geom 'one'"),
    ("pinocchio", "pinocchio.py", "float(model.body_mass[body])",
     "1.01 * float(model.body_mass[body])", "the inertia of joint"),
    ("pinocchio", "pinocchio.py", "np.diag(model.body_inertia[body])",
     "np.diag(model.body_inertia[body][::-1])", "the inertia of joint"),
]  # fmt: skip
PUSHED = """
<mujoco><option timestep=".002"/>
  <worldbody><geom name="floor" type="plane" size="1 1 .1" friction=".5"/>
    <body name="one" pos="0 0 .05"><freejoint/><geom name="one" type="box" size=".1 .12 .05"
      pos=".01 0 0" euler="0 0 20" mass="2" friction=".5"/></body>
  </worldbody>
</mujoco>"""


@pytest.mark.night
@pytest.mark.parametrize(
    ("name", "part", "code", "planted", "told"),
    [installed(name, *rest) for name, *rest in PLANTED_IN_DYNAMICS],
)
def test_what_is_changed_on_the_way_to_free_bodies_and_arms_is_found(
    tmp_path: Path, name: str, part: str, code: str, planted: str, told: str
) -> None:
    model = mujoco.MjModel.from_xml_string(
        PUSHED if name == "drake" else (ADAPTED / "tree.xml").read_text(encoding="utf-8")
    )
    assert told in said_of_planted(tmp_path, name, part, (code, planted), model, 2)


@pytest.mark.night
@pytest.mark.parametrize("name", [installed("sapien")])
@pytest.mark.parametrize("step", [0.001, 0.004])
def test_a_ball_bounces_as_its_damping_says(name: str, step: float) -> None:
    model, data = one(step, BALL, both='solref="-160000 -144.7"')
    speeds = states(ENGINES[name], model, data, round(0.7 / step))[:, 9]
    expected = float(restitution_from_damping(damping_ratio((-160000.0, -144.7))))
    # A step of fall before and after, of 4.43 m/s.
    assert abs(speeds.max() / -speeds.min() - expected) < 2 * 9.81 * step / 4.43


@pytest.mark.night
@pytest.mark.parametrize("name", [installed("genesis")])
@pytest.mark.parametrize("damping", [0.0, 144.7])
def test_a_soft_ball_bounces_as_mujocos_does(name: str, damping: float) -> None:
    """Its contact is MuJoCo's spring, step by step; without damping it keeps the speed.

    An explicit spring of frequency w is off by (w h)^2 of an energy where contact begins and ends.
    """
    model, data = one(0.0005, BALL, both=f'solref="-160000 {-damping}"')
    told, own = states(ENGINES[name], model, data, 1400), []
    for _ in told:
        own.append(np.concatenate([data.qpos, data.qvel]))
        mujoco.mj_step(model, data)
    # What differs by rounding, 2e-16, of solvers that end at 1e-8 of a step's gain.
    assert np.abs(told - own).max() < 1e-7
    speeds = told[:, 9]
    expected = float(restitution_from_damping(damping_ratio((-160000.0, -damping))))
    assert speeds.max() / -speeds.min() == pytest.approx(expected, abs=(400 * 0.0005) ** 2)


def said_by(name: str, script: str) -> str:
    """Return what a script in the engine's own API prints in its environment."""
    python = ENGINES[name].environment / "bin" / "python"
    command = [str(python), str(ADAPTERS / "beside" / script)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.night
@pytest.mark.parametrize("name", [installed("bullet")])
def test_a_bounce_that_the_engine_gets_wrong_is_the_engines_own(name: str) -> None:
    """What the adapter's ball does, the same ball does in a script in the engine's own API."""
    said = said_by(name, "bullet_bounce.py")
    own = {float(step): float(e) for step, e in re.findall(r"([\d.]+) ms: e = ([\d.]+)", said)}
    assert len(own) == 4
    damped = (-160000.0, -144.7)
    expected = float(restitution_from_damping(damping_ratio(damped)))
    for milliseconds, told in own.items():
        both = f'solref="{damped[0]:g} {damped[1]:g}"'
        model, data = one(milliseconds / 1000, BALL, both=both)
        speeds = states(ENGINES[name], model, data, round(700 / milliseconds))[:, 9]
        assert speeds.max() / -speeds.min() == pytest.approx(told, abs=2e-3)
    assert max(abs(told - expected) for told in own.values()) > 0.05


KEEL = "-.1 0 0 .1 0 0 -.1 .05 .1 .1 .05 .1 -.1 -.05 .1 .1 -.05 .1"
TOUCHING = (
    '<sensor><contact geom1="floor" geom2="one" num="2" data="found force torque dist pos normal '
    'tangent linvel angvel"/></sensor>'
)
LONG = {
    "mesh": ('type="mesh" mesh="keel"', 0.0),
    "capsule": ('type="capsule" size=".05" fromto="-.1 0 0 .1 0 0"', 0.05),
}


@pytest.mark.night
@pytest.mark.parametrize("name", [installed("genesis")])
def test_a_corner_that_the_engine_does_not_find_is_the_engines_own(name: str) -> None:
    """Both ends of a keel and a capsule are 2 mm in the floor or deeper, where MuJoCo has two.

    Genesis finds other corners than the deepest by turning a shape by 5e-3 rad, .29 degrees.
    """
    said = said_by(name, "genesis_corners.py")
    counts = re.findall(r"([\d.]+) degrees: mesh (\d), capsule (\d)", said)
    own = {float(tilt): (int(mesh), int(capsule)) for tilt, mesh, capsule in counts}
    assert own == {tilt: (2, 2) if math.radians(tilt) < 5e-3 else (1, 1) for tilt in own}
    assert len(set(own.values())) == 2
    end = f'<asset><mesh name="keel" vertex="{KEEL}"/></asset>{TOUCHING}'
    for which, (shape, radius) in enumerate(LONG.values()):
        for tilt, expected in own.items():
            angle = math.radians(tilt)
            height = radius - 0.002 - 0.1 * math.sin(angle)
            model, data = one(0.01, {"shape": shape, "height": "0"}, end=end)
            data.qpos[2:] = height, math.cos(angle / 2), 0, math.sin(angle / 2), 0
            told = simulated(ENGINES[name], model, data, 1)
            assert not isinstance(told, str), told
            assert told["sensors"][0][0, 0] == expected[which]
            mujoco.mj_forward(model, data)
            assert data.ncon == 2
