"""Models that were made slow on purpose, each beside the one that it was made of.

Run: python -m bench.planted FOLDER [MODEL.xml ...]

writes NAME.xml and NAME_slow.xml of each; of models that are given, a folder NAME_slow with the
files of each, in which one of five costs was planted, in turn. `contactlab tune NAME_slow.xml`
ought to come back to what NAME.xml costs, and end where NAME_slow.xml does; `python -m
bench.tune_cost` measures both. `python -m bench.planted share NAME.xml NAME_slow.xml` says what
error NAME.xml has, which is what to ask for where shorter steps were planted. The pile's cost are
vertices of hulls: `--hulls 11mm` lets them go.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from contactlab.parts import register_parts
from contactlab.plan.task_options import TaskOptions
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_names import name_of
from contactlab.scene.model_writer import write_model
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.reference_error import TaskReference
from contactlab.tasks.session import Session

EXACT = 'solver="PGS" iterations="500" tolerance="1e-15"'


def _mesh(name: str, size: float, count: int = 200, *, faces: bool = False) -> str:
    """Return a mesh whose hull has all of its vertices: points on a sphere.

    With faces, its mass does not hang on how many of them its hull has.
    """
    points = np.random.default_rng(len(name)).normal(size=(count, 3))
    points *= size / np.linalg.norm(points, axis=1)[:, None]
    text = " ".join(f"{each:.5f}" for each in points.ravel())
    face = ""
    if faces:
        hull = ConvexHull(points)
        inward = np.cross(
            *(points[hull.simplices[:, k]] - points[hull.simplices[:, 0]] for k in (1, 2))
        )
        back = (inward * hull.equations[:, :3]).sum(axis=1) < 0
        hull.simplices[back] = hull.simplices[back][:, ::-1]
        face = f' face="{" ".join(map(str, hull.simplices.ravel()))}"'
    return f'<mesh name="{name}" vertex="{text}"{face}/>'


QUADRUPED = """<mujoco>
  <option timestep="0.002" integrator="implicitfast" {option}/>
  <default><geom friction="1 .005 .0001" {geom}/></default>
  <worldbody>
    <geom type="plane" size="9 9 .1"/>
    <body pos="0 0 .36"><freejoint/><geom type="box" size=".2 .1 .05" mass="6"/>{legs}</body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>"""
_LEG = """<body pos="{x} {y} 0">
  <joint name="hip{n}" axis="0 1 0" damping=".5" range="-60 60"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.15" size=".02" mass=".4"/>
  <body pos="0 0 -.15"><joint name="knee{n}" axis="0 1 0" damping=".5" range="-100 10"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.17" size=".02" mass=".2"/></body></body>"""


def quadruped(option: str = "", geom: str = "") -> str:
    """Return a robot on four legs."""
    places = [(x, y) for x in (-0.17, 0.17) for y in (-0.13, 0.13)]
    legs = "".join(_LEG.format(x=x, y=y, n=n) for n, (x, y) in enumerate(places))
    motors = "".join(
        f'<position joint="{part}{n}" kp="60" kv="2" ctrlrange="-.5 .5"/>'
        for n in range(4)
        for part in ("hip", "knee")
    )
    return QUADRUPED.format(option=option, geom=geom, legs=legs, motors=motors)


PUSHER = """<mujoco>
  <option timestep="0.002" integrator="implicitfast" cone="elliptic" {option}/>
  <default><geom {geom}/></default>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 .1">
      <joint name="turn" axis="0 0 1" damping="1" range="-100 100"/>
      <geom type="capsule" fromto=".1 0 0 .4 0 0" size=".03"/>
      <body pos=".4 0 0"><joint name="elbow" axis="0 0 1" damping="1" range="-100 100"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body>
    </body>
    <body pos=".5 .5 .06"><freejoint/><geom type="box" size=".06 .06 .06" mass=".4"/></body>
    <body pos=".5 -.5 .06"><freejoint/><geom type="box" size=".06 .06 .06" mass=".4"/></body>
  </worldbody>
  <actuator>
    <position joint="turn" kp="60" kv="6" ctrlrange="-1.5 1.5"/>
    <position joint="elbow" kp="40" kv="4" ctrlrange="-1.5 1.5"/>
  </actuator>
</mujoco>"""
GRIPPER = """<mujoco>
  <option timestep="0.002" integrator="implicitfast" cone="elliptic" {option}/>
  <default><geom condim="4" friction="1 .01 .0001" {geom}/></default>
  <worldbody>
    <body name="palm" pos="0 0 .5">
      <joint name="lift" type="slide" axis="0 0 1" damping="20" range="-.1 .1"/>
      <geom type="box" size=".02 .1 .02" contype="0" conaffinity="0" mass="1"/>
      <body pos="0 -.07 -.08">
        <joint name="left" type="slide" axis="0 1 0" damping="5" range="0 .04"/>
        <geom type="box" size=".02 .01 .06" mass=".1"/></body>
      <body pos="0 .07 -.08">
        <joint name="right" type="slide" axis="0 -1 0" damping="5" range="0 .04"/>
        <geom type="box" size=".02 .01 .06" mass=".1"/></body>
    </body>
    <body pos="0 0 .42"><freejoint/><geom type="box" size=".03 .0595 .03" mass=".2"/></body>
  </worldbody>
  <actuator>
    <position joint="lift" kp="600" kv="40" ctrlrange="-.05 .05"/>
    <motor joint="left" gear="20" ctrlrange=".8 1"/>
    <motor joint="right" gear="20" ctrlrange=".8 1"/>
  </actuator>
  <keyframe><key qpos="0 0 0 0 0 .42 1 0 0 0" ctrl="0 1 1"/></keyframe>
</mujoco>"""
STACK = """<mujoco>
  <option timestep="0.002" cone="elliptic" {option}/>
  <default><geom {geom}/></default>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 .05"><freejoint/><geom type="box" size=".1 .1 .05"/></body>
    <body pos="0 0 .15"><freejoint/><geom type="box" size=".1 .1 .05"/></body>
    <body pos="0 0 .25"><freejoint/><geom type="box" size=".1 .1 .05"/></body>
  </worldbody>
</mujoco>"""
VEHICLE = """<mujoco>
  <option timestep="0.002" {option}/>
  <default><geom {geom}/></default>
  <worldbody>
    <geom type="plane" size="50 50 .1"/>
    <body pos="0 0 .1">
      <freejoint/><geom type="box" size=".25 .1 .04" pos="0 0 .05" mass="5"/>{wheels}
    </body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>"""


def vehicle(option: str = "", geom: str = "") -> str:
    """Return a body on four driven wheels."""
    places = [(x, y) for x in (-0.18, 0.18) for y in (-0.15, 0.15)]
    wheels = "".join(
        f'<body pos="{x} {y} 0"><joint name="w{n}" axis="0 1 0" damping=".05"/>'
        f'<geom type="sphere" size=".1" mass=".5"/></body>'
        for n, (x, y) in enumerate(places)
    )
    motors = "".join(f'<velocity joint="w{n}" kv=".3" ctrlrange="-6 6"/>' for n in range(4))
    return VEHICLE.format(option=option, geom=geom, wheels=wheels, motors=motors)


FOUR_BAR = """<mujoco>
  <option timestep="{h}" integrator="RK4" {option}/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body pos="0 0 1"><joint axis="0 1 0" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/>
      <body pos="0 0 -.2"><joint axis="0 1 0" damping=".02"/>
        <geom type="capsule" fromto="0 0 0 .4 0 0" size=".02"/>
        <body name="rocker" pos=".4 0 0"><joint axis="0 1 0" damping=".02"/>
          <geom type="capsule" fromto="0 0 0 0 0 .2" size=".02"/></body></body></body>
  </worldbody>
  <equality><connect body1="rocker" anchor="0 0 .2"/></equality>
</mujoco>"""
SHELLS = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <asset>{meshes}</asset>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 1"><joint name="yaw" axis="0 0 1" damping="2" range="-120 120"/>
      <geom type="capsule" fromto="0 0 0 0 0 .2" size=".05"/>{first}
      <body pos="0 0 .25"><joint name="lift" axis="0 1 0" damping="2" range="-80 30"/>
        <geom type="capsule" fromto=".06 0 0 .3 0 0" size=".04"/>{second}
        <body pos=".36 0 0"><joint name="bow" axis="0 1 0" damping="1" range="-60 60"/>
          <geom type="capsule" fromto=".05 0 0 .2 0 0" size=".03"/>{third}</body></body></body>
  </worldbody>
  <actuator>
    <position joint="yaw" kp="80" kv="8" ctrlrange="-2 2"/>
    <position joint="lift" kp="120" kv="8" ctrlrange="-1.3 .5"/>
    <position joint="bow" kp="60" kv="4" ctrlrange="-1 1"/>
  </actuator>
</mujoco>"""


def shells(bits: str) -> str:
    """Return an arm with meshes around its links."""
    meshes = _mesh("ab", 0.05) + _mesh("abc", 0.045) + _mesh("abcd", 0.035)

    def on(mesh: str, *places: str) -> str:
        geom = f'<geom type="mesh" mesh="{mesh}" mass="0" {bits}'
        return "".join(f'{geom} pos="{each}"/>' for each in places)

    first = on("ab", "0 0 0", "0 0 .05", "0 0 .1", "0 0 .15", "0 0 .2")
    second = on("abc", ".06 0 0", ".12 0 0", ".18 0 0", ".24 0 0", ".3 0 0")
    third = on("abcd", ".05 0 0", ".1 0 0", ".15 0 0", ".2 0 0")
    return SHELLS.format(meshes=meshes, first=first, second=second, third=third)


PILE = """<mujoco>
  <option timestep="0.002"/>
  <asset>{meshes}</asset>
  <worldbody><geom type="plane" size="5 5 .1"/>{stones}</worldbody>
</mujoco>"""


def pile(most: int) -> str:
    """Return stones whose hulls have so many vertices, on the ground and on each other."""
    stone = '<body pos="{} {} {}"><freejoint/><geom type="mesh" mesh="stone" condim="6"/></body>'
    places = [(0.11 * x, 0.11 * y, 0.08 + 0.13 * z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    stones = "".join(stone.format(*each) for each in places)
    mesh = _mesh("stone", 0.06, faces=True).replace("<mesh", f'<mesh maxhullvert="{most}"')
    return PILE.format(meshes=mesh, stones=stones)


SWINGS = """<mujoco>
  <option timestep="{h}" integrator="RK4" {option}/>
  <worldbody>
    <body pos="0 0 2"><joint type="ball" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" {geom}/>
      <body pos="0 0 -.4"><joint axis="0 1 0" damping=".02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" {geom}/></body></body>
    <body pos="2 0 2"><joint axis="0 1 0" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" {geom}/></body>
  </worldbody>
</mujoco>"""

MODELS = {
    "quadruped": (quadruped(), quadruped(EXACT)),
    "pusher": (
        PUSHER.format(option="", geom=""),
        PUSHER.format(option=EXACT + ' noslip_iterations="30"', geom='condim="6"'),
    ),
    "gripper": (
        GRIPPER.format(option='noslip_iterations="3"', geom=""),
        GRIPPER.format(option=EXACT + ' noslip_iterations="100"', geom=""),
    ),
    "stack": (STACK.format(option="", geom=""), STACK.format(option=EXACT, geom='condim="6"')),
    "vehicle": (vehicle(), vehicle(option=EXACT)),
    "rolling": (vehicle(), vehicle(geom='condim="6"')),
    "four_bar": (
        FOUR_BAR.format(h=0.004, option=""),
        FOUR_BAR.format(h=0.0005, option=EXACT),
    ),
    "shells": (shells('contype="0" conaffinity="0"'), shells("")),
    "pile": (pile(24), pile(200)),
    "swings": (
        SWINGS.format(h=0.008, option="", geom='contype="0" conaffinity="0"'),
        SWINGS.format(h=0.001, option='tolerance="1e-15"', geom='condim="6"'),
    ),
}


def costs_of(model: mujoco.MjModel) -> list[dict[str, object]]:
    """Return the costs that are planted: settings, none of which makes a motion less accurate."""
    step = float(model.opt.timestep)
    contacts = {
        f"geom_condim[{name_of(model, 'geom', geom)}]": 6
        for geom in range(model.ngeom)
        if (model.geom_contype[geom] or model.geom_conaffinity[geom])
        and model.geom_condim[geom] > 1
    }
    return [
        {"solver": "PGS", "iterations": 500, "tolerance": 1e-15},
        {"timestep": step / 4},
        {"integrator": "RK4", "timestep": step / 2},
        {**contacts, "noslip_iterations": 20},
        {"solver": "CG", "iterations": 500, "ls_iterations": 200, "tolerance": 1e-15},
    ]


def plant(file: Path, cost: int, folder: Path) -> Path:
    """Write a model with a cost into a folder."""
    examined = open_model(str(file), Session(folder))
    settings = costs_of(mujoco.MjModel.from_xml_path(str(file)))[cost]
    return write_model(examined.scene, ModelEdits(settings=settings), folder, "slow.xml").path


def error_of(original: str, slow: str, duration: float) -> float:
    """Return the error of a model beside what it was made slow of, as `tune` would tell it.

    What is planted may be accuracy, as shorter steps are: to come back to the original's time is to
    come back to its error, so `tune` is asked for that.
    """
    options = TaskOptions(duration=duration)
    motions = open_model(slow, Session(Path()), options).motions
    own = mujoco.MjModel.from_xml_path(original)
    finer = max(1, round(8 * motions[0].model.opt.timestep / own.opt.timestep))
    finer = next(rate for rate in range(finer, 999) if _is_whole(own, motions[0].model, rate))
    yards = TaskReference.run_references(motions, finer, 1)
    return yards.estimate_error(own, round(own.opt.timestep / yards.step)).error


def _is_whole(own: mujoco.MjModel, slow: mujoco.MjModel, rate: int) -> bool:
    steps = own.opt.timestep / (slow.opt.timestep / rate)
    return abs(steps - round(steps)) < 1e-6 * steps


if __name__ == "__main__":
    register_parts()
    if sys.argv[1] == "share":
        print(f"{error_of(*sys.argv[2:4], duration=0.5):.4f}")
        sys.exit()
    folder = Path(sys.argv[1])
    for number, file in enumerate(map(Path, sys.argv[2:])):
        name = f"{file.parent.name}_{file.stem}_slow"
        print(plant(file, number % 5, folder / name), file)
    for name, (original, slow) in MODELS.items() if not sys.argv[2:] else ():
        (folder / f"{name}.xml").write_text(original)
        (folder / f"{name}_slow.xml").write_text(slow)
