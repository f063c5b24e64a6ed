"""Models for comparing releases: the shipped scenes, named ones, and generated ones."""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from contactlab import resources

SCENES, GENERATED = "scenes", "generated"
"""Words that stand for all shipped scenes, and for all generated models."""
_SHAPES = {
    "sphere": 'type="sphere" size=".1"',
    "capsule": 'type="capsule" size=".06 .1"',
    "ellipsoid": 'type="ellipsoid" size=".08 .1 .13"',
    "cylinder": 'type="cylinder" size=".09 .1"',
    "box": 'type="box" size=".08 .1 .12"',
    "mesh": 'type="mesh" mesh="hull"',
}
_PLANE = 'type="plane" size="2 2 .1"'
_CONSTRAINTS = {
    "weld": '<equality><weld body1="arm" body2="load"/></equality>',
    "connect": '<equality><connect body1="arm" body2="load" anchor=".2 0 0"/></equality>',
    "joint": '<equality><joint joint1="one" joint2="two" polycoef="0 2 0 0 0"/></equality>',
    "limit": '<default><joint limited="true" range="-5 5"/></default>',
    "friction": '<default><joint frictionloss=".5"/></default>',
    "servo": '<actuator><position joint="one" kp="50" kv="5" forcerange="-2 2"/></actuator>',
    "tendon": '<tendon><fixed limited="true" range="-.05 .05"><joint joint="one" coef="1"/>'
    '<joint joint="two" coef="-1"/></fixed></tendon>',
    "elliptic": '<option cone="elliptic" impratio="5"/>',
    "implicit": '<option integrator="implicitfast"/>',
    "RK4": '<option integrator="RK4"/>',
}


_SENSORS = ("accelerometer", "gyro", "velocimeter", "force", "torque", "magnetometer", "touch")
_FLEXES = {
    "rope": '<flexcomp name="rope" type="grid" dim="1" count="8 1 1" spacing=".05 1 1" '
    'radius=".01" mass=".1" pos="0 0 .3"><edge equality="true"/></flexcomp>',
    "cloth": '<flexcomp name="cloth" type="grid" dim="2" count="9 9 1" spacing=".05 .05 1" '
    'radius=".01" mass=".1" pos="0 0 .009"><edge equality="true"/>'
    '<contact selfcollide="none"/></flexcomp>',
    "soft": '<flexcomp name="soft" type="grid" dim="3" count="3 3 3" spacing=".1 .1 .1" '
    'radius=".01" mass="1" pos="0 0 .15"><edge equality="true"/>'
    '<contact selfcollide="none"/></flexcomp>',
}
_BODY = '<body name="{0}"><joint name="{0}" type="slide"/><geom name="{0}" size=".1"/></body>'
_LAYOUTS = {
    "frames": f"<mujoco><worldbody><frame>{_BODY.format('one')}</frame>{_BODY.format('two')}"
    f"<frame pos='1 0 0'>{_BODY.format('three')}</frame></worldbody></mujoco>",
    "classes": "<mujoco><default><geom friction='.5'/><default class='slick'>"
    "<geom friction='.1'/></default></default><worldbody><body childclass='slick'><freejoint/>"
    "<geom size='.1' pos='.2 0 0'/><geom class='main' size='.1'/></body></worldbody></mujoco>",
    "turns": "<mujoco><default><geom euler='90 0 0'/></default><worldbody><body><freejoint/>"
    "<geom type='box' size='.1 .2 .3' quat='1 0 0 0'/></body></worldbody></mujoco>",
    "mass": f"<mujoco><compiler settotalmass='5'/><worldbody>{_BODY.format('one')}"
    "</worldbody></mujoco>",
    "energy": f"<mujoco><worldbody>{_BODY.format('one')}</worldbody><sensor><e_potential name='e'/>"
    "<e_kinetic name='k'/></sensor></mujoco>",
    "ranges": "<mujoco><worldbody><body><joint name='one' type='slide' actuatorfrcrange='-1 1'/>"
    "<geom size='.1'/></body></worldbody><tendon><fixed name='cable' actuatorfrcrange='-.05 .05'>"
    "<joint joint='one' coef='1'/></fixed></tendon><actuator><motor tendon='cable'/>"
    "<position joint='one' kp='10' dampratio='1'/></actuator></mujoco>",
}
"""Models with parts that a compiler resolves: frames, classes, ranges and settings of masses."""


class CorpusModel(NamedTuple):
    """A model of the corpus.

    Attributes:
        name: in reports.
        reference: a scene, or the path of a file.
        text: its MJCF, if that needs no other files; otherwise empty.
    """

    name: str
    reference: str
    text: str = ""


def list_models(names: Sequence[str], folder: Path) -> Iterator[CorpusModel]:
    """Yield the models that some names stand for; generated ones are written into a folder."""
    for name in names:
        if name == SCENES:
            yield from (CorpusModel(scene, scene) for scene in resources.scene_names())
        elif name == GENERATED:
            for model_name, text in generate_models():
                file = folder / f"{model_name}.xml"
                file.write_text(text, encoding="utf-8")
                yield CorpusModel(model_name, str(file), text)
        else:
            yield CorpusModel(Path(name).name, name)


def generate_models() -> Iterator[tuple[str, str]]:
    """Yield name and MJCF of models: pairs of shapes, random trees, and constraints."""
    for first, second in itertools.combinations_with_replacement(["plane", *_SHAPES], 2):
        if second != "plane":
            yield f"{first}-{second}", _pair_text(first, second)
    for seed in range(24):
        yield f"tree-{seed}", _tree_text(seed)
    for name, text in _CONSTRAINTS.items():
        yield f"constraint-{name}", _constraint_text(text)
    for integrator in ("Euler", "RK4", "implicit", "implicitfast"):
        yield f"servo-{integrator}", _servo_text(integrator)
        yield f"tumble-{integrator}", _tumble_text(integrator)
    for sensor, place in itertools.product(_SENSORS, ("fixed", "moving")):
        yield f"sensor-{sensor}-{place}", _sensor_text(sensor, place)
    for name, text in _LAYOUTS.items():
        yield f"layout-{name}", text
    for name, text in _FLEXES.items():
        yield f"flex-{name}", f"<mujoco><worldbody><geom {_PLANE}/>{text}</worldbody></mujoco>"


def _hull_text() -> str:
    points = np.random.default_rng(0).normal(size=(12, 3))
    points *= 0.12 / np.linalg.norm(points, axis=1)[:, None]
    return f'<mesh name="hull" vertex="{_format_numbers(points)}"/>'


def _format_numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.4f}" for value in np.ravel(values))


def _pair_text(first: str, second: str) -> str:
    # Pairs are apart, so that only the two shapes of a pair touch.
    draw, bodies = np.random.default_rng(1), list[str]()
    poses = 6  # enough for faces, edges and corners to meet
    for place in range(poses):
        turn, other = draw.normal(size=4), draw.normal(size=4)
        away = draw.normal(size=3)
        away *= draw.uniform(0.1, 0.2) / np.linalg.norm(away)
        at = np.array([1.5 * place, 0, 0.1])
        if first != "plane":
            bodies.append(
                f'<body pos="{_format_numbers(at)}" quat="{_format_numbers(turn)}"><freejoint/>'
                f"<geom {_SHAPES[first]}/></body>"
            )
        below = at + (away if first != "plane" else [0, 0, -0.01])
        bodies.append(
            f'<body pos="{_format_numbers(below)}" quat="{_format_numbers(other)}"><freejoint/>'
            f"<geom {_SHAPES[second]}/></body>"
        )
    floor = f"<geom {_PLANE}/>" if first == "plane" else ""
    gravity = "" if first == "plane" else '<option gravity="0 0 0"/>'
    return (
        f"<mujoco>{gravity}<asset>{_hull_text()}</asset>"
        f"<worldbody>{floor}{''.join(bodies)}</worldbody></mujoco>"
    )


def _tree_text(seed: int) -> str:
    # Half of the trees use sparse matrices, since engines have other code for these.
    draw = np.random.default_rng(seed)
    count = int(draw.integers(6, 14))
    parents = [-1, *(int(draw.integers(0, body)) for body in range(1, count))]

    def body_text(number: int) -> str:
        axis = ("1 0 0", "0 1 0", "0 0 1")[int(draw.integers(3))]
        joint = f'<joint axis="{axis}" damping=".01" range="-60 60"/>' if number else "<freejoint/>"
        at = f".11 {0.04 * (number % 3 - 1):g} 0" if number else "0 0 .05"
        inner = "".join(body_text(child) for child in range(count) if parents[child] == number)
        geom = '<geom type="capsule" fromto="0 0 0 .1 0 0" size=".02"/>'
        return f'<body pos="{at}">{joint}{geom}{inner}</body>'

    storage = "sparse" if seed % 2 else "dense"
    return (
        f'<mujoco><option jacobian="{storage}"/>'
        f"<worldbody><geom {_PLANE}/>{body_text(0)}</worldbody></mujoco>"
    )


def _constraint_text(part: str) -> str:
    return f"""<mujoco>{part}<worldbody><geom {_PLANE}/>
      <body name="arm" pos="0 0 .4"><joint name="one" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
        <body pos=".3 0 0"><joint name="two" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 .2 0 0" size=".03"/></body></body>
      <body name="load" pos=".2 .2 .1"><freejoint/>
        <geom type="box" size=".05 .05 .099"/></body></worldbody></mujoco>"""


def _servo_text(integrator: str) -> str:
    # The force of a servo has no limit, one of the actuator, or one of the joint.
    return f"""<mujoco><option integrator="{integrator}" timestep=".01" gravity="0 0 0"/><worldbody>
      <body><joint name="free" type="slide"/><geom size=".1" mass="1"/></body>
      <body pos="1 0 0"><joint name="clamped" type="slide"/><geom size=".1" mass="1"/></body>
      <body pos="2 0 0"><joint name="limited" type="slide" actuatorfrcrange="-1 1"/>
        <geom size=".1" mass="1"/></body></worldbody>
      <actuator><velocity joint="free" kv="9"/><velocity joint="clamped" kv="9" forcerange="-1 1"/>
      <velocity joint="limited" kv="9"/></actuator>
      <keyframe><key ctrl="1 1 1"/></keyframe></mujoco>"""


def _tumble_text(integrator: str) -> str:
    return f"""<mujoco><option integrator="{integrator}" timestep=".01" gravity="0 0 0"/><worldbody>
      <body><freejoint/><geom type="box" size=".1 .2 .3"/></body>
      <body pos="2 0 0"><joint type="ball"/><geom type="box" size=".1 .2 .3" pos=".1 0 0"/></body>
      </worldbody><keyframe><key qvel="1 0 0 3 1 5 2 5 1"/></keyframe></mujoco>"""


def _sensor_text(sensor: str, place: str) -> str:
    joint = '<joint axis="0 1 0"/>' if place == "moving" else ""
    return f"""<mujoco><worldbody><site name="anchor" pos=".5 0 2"/>
      <body name="arm" pos="0 0 1">{joint}<geom type="capsule" fromto="0 0 0 .5 0 0" size=".05"/>
        <site name="place"/><site name="end" pos=".5 0 0"/></body>
      <body name="ball" pos="0 2 1"><freejoint/><geom size=".1"/></body></worldbody>
      <tendon><spatial springlength="0" stiffness="10"><site site="anchor"/><site site="end"/>
      </spatial></tendon><equality><weld body1="arm"/></equality>
      <sensor><{sensor} site="place"/></sensor></mujoco>"""
