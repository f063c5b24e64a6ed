"""Changes of small models whose truth is known: planted harm, and changes that harm nothing.

Each model is MJCF text; a change replaces one piece of it. The measure that a harmful change makes
worse is named next to it. Why it is worse follows from the model, not from a verification.
"""

from dataclasses import dataclass, replace

import numpy as np

PINCH = """
<mujoco model="pinch">
  <option timestep="0.002" impratio="10" cone="elliptic" noslip_iterations="3"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="hand" pos="0 0 .3">
      <geom name="palm" type="box" size=".02 .06 .01" pos="0 0 .04" mass=".4"/>
      <body name="left" pos="0 .05 0">
        <joint name="left" type="slide" axis="0 -1 0" range="0 .05" damping="5"/>
        <geom name="left" type="box" size=".01 .005 .03" mass=".05" friction="1"/>
      </body>
      <body name="right" pos="0 -.05 0">
        <joint name="right" type="slide" axis="0 1 0" range="0 .05" damping="5"/>
        <geom name="right" type="box" size=".01 .005 .03" mass=".05" friction="1"/>
      </body>
    </body>
    <body name="box" pos="0 0 .285">
      <freejoint/>
      <geom name="box" type="box" size=".02 .02 .02" mass=".05"/>
    </body>
  </worldbody>
  <actuator>
    <position name="left" joint="left" kp="2000" ctrlrange="0 .05" forcerange="-5 5"/>
    <position name="right" joint="right" kp="2000" ctrlrange="0 .05" forcerange="-5 5"/>
  </actuator>
  <keyframe>
    <key name="closed" qpos=".0249 .0249 0 0 .285 1 0 0 0" ctrl=".05 .05"/>
  </keyframe>
</mujoco>
"""
"""Two jaws hold a box of 50 g with 5 N each. Without noslip, regularized friction creeps."""

BARE_JAWS = """
<mujoco model="bare_jaws">
  <option timestep="0.002" cone="elliptic" impratio="10"/>
  <worldbody>
    <body name="hand" pos="0 0 .3">
      <body name="left" pos="0 .05 0">
        <joint name="left" type="slide" axis="0 -1 0" range="0 .035" damping="5"/>
        <geom name="left" type="box" size=".01 .005 .03" mass=".05"/>
      </body>
      <body name="right" pos="0 -.05 0">
        <joint name="right" type="slide" axis="0 1 0" range="0 .035" damping="5"/>
        <geom name="right" type="box" size=".01 .005 .03" mass=".05"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="left" joint="left" kp="2000" ctrlrange="0 .035" forcerange="-5 5"/>
    <position name="right" joint="right" kp="2000" ctrlrange="0 .035" forcerange="-5 5"/>
  </actuator>
</mujoco>
"""
"""Jaws without an object. Their limits keep them 20 mm apart, so nothing touches in this file."""

ARM = """
<mujoco model="arm">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" range="-100 100" damping="1" armature="0.05"/>
      <geom name="upper" type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
      <body name="lower" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" range="-20 20" damping=".5" armature="0.02"/>
        <geom name="lower" type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="300" kv="20" ctrlrange="-1.5 1.5"/>
    <position name="elbow" joint="elbow" kp="100" kv="5" ctrlrange="-1.5 1.5"/>
  </actuator>
</mujoco>
"""
"""An arm of two links under position servos; the elbow's servo can press it against its limit."""

LINKAGE = """
<mujoco model="linkage">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="left" pos="0 0 1">
      <joint name="left" axis="0 1 0" damping=".05"/>
      <geom type="capsule" fromto="0 0 0 0 0 .2" size=".01" mass=".2" contype="0" conaffinity="0"/>
      <body name="coupler" pos="0 0 .2">
        <joint name="coupler" axis="0 1 0" damping=".05"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".01" mass=".3" contype="0"
          conaffinity="0"/>
      </body>
    </body>
    <body name="right" pos=".3 0 1">
      <joint name="right" axis="0 1 0" damping=".05"/>
      <geom type="capsule" fromto="0 0 0 0 0 .2" size=".01" mass=".2" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <equality>
    <connect name="loop" body1="coupler" body2="right" anchor=".3 0 0"/>
  </equality>
  <actuator>
    <position name="left" joint="left" kp="20" kv="1" ctrlrange="-.8 .8"/>
  </actuator>
</mujoco>
"""
"""A four-bar linkage, whose loop is closed by a connect equality."""

STACK = """
<mujoco model="stack">
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="low" pos="0 0 .05">
      <freejoint/>
      <geom name="low" type="box" size=".05 .05 .05" mass="1"/>
    </body>
    <body name="high" pos="0 0 .15">
      <freejoint/>
      <geom name="high" type="box" size=".05 .05 .05" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
"""Two boxes on a floor, pushed by the default task; at 20 degrees friction 1 holds them."""

PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.002" integrator="RK4"/>
  <worldbody>
    <body name="first" pos="0 0 2">
      <joint name="first" axis="0 1 0"/>
      <geom name="first" type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
"""A pendulum without friction: nothing may gain or lose energy."""


@dataclass(frozen=True)
class PlantedChange:
    """One change of a model.

    Attributes:
        name: the change in a few words.
        model: MJCF text of the original.
        old, new: the piece that is replaced, and its replacement.
        measures: names of measures. A right verification finds one of them worse. Empty for a
            change that harms nothing.
        same_model: whether it is declared another computation of the same model.
    """

    name: str
    model: str
    old: str
    new: str
    measures: tuple[str, ...] = ()
    same_model: bool = True

    @property
    def changed(self) -> str:
        """The changed MJCF text."""
        assert self.model.count(self.old) >= 1, self.name
        return self.model.replace(self.old, self.new)


_GRIP = ("grip creep", "pull-out force", "creep")
HARMFUL = (
    PlantedChange("noslip off", PINCH, ' noslip_iterations="3"', "", _GRIP),
    PlantedChange(
        "pyramidal cones", PINCH, 'impratio="10" cone="elliptic" noslip_iterations="3"', "", _GRIP
    ),
    PlantedChange(
        "half the pads' friction", PINCH, 'friction="1"', 'friction=".5" priority="1"',
        ("pull-out force",), same_model=False,
    ),
    PlantedChange(
        "pads without friction", PINCH, 'friction="1"', 'friction="1" condim="1" priority="1"',
        _GRIP, same_model=False,
    ),
    PlantedChange(
        "half the force", PINCH, 'forcerange="-5 5"', 'forcerange="-2.5 2.5"', ("pull-out force",),
        same_model=False,
    ),
    PlantedChange(
        "soft pads", PINCH, 'friction="1"', 'friction="1" solref=".1 1" priority="1"',
        ("grip depth", "depth", "resting depth"), same_model=False,
    ),
    PlantedChange(
        "a margin on the pads", PINCH, 'friction="1"', 'friction="1" margin=".005"',
        ("grip creep", "end position", "creep", "tracking error"), same_model=False,
    ),
    PlantedChange(
        "tenfold gains without force range", PINCH,
        'kp="2000" ctrlrange="0 .05" forcerange="-5 5"', 'kp="20000" ctrlrange="0 .05"',
        ("grip depth", "depth", "resting depth"), same_model=False,
    ),
    PlantedChange(
        "half the servo gain", ARM, 'kp="300"', 'kp="150"', ("tracking error",), same_model=False
    ),
    PlantedChange(
        "a servo that no step holds", ARM, 'kp="300" kv="20"', 'kp="1e8"',
        ("runs that the engine gave up",), same_model=False,
    ),
    PlantedChange(
        "armature tenfold", ARM, 'armature="0.05"', 'armature="0.5"', ("tracking error",),
        same_model=False,
    ),
    PlantedChange(
        "damping tenfold", ARM, 'damping="1"', 'damping="40"', ("tracking error",), same_model=False
    ),
    PlantedChange(
        "dry friction", ARM, 'damping="1"', 'damping="1" frictionloss="5"', ("tracking error",),
        same_model=False,
    ),
    PlantedChange(
        "a weak motor", ARM, 'kp="300" kv="20"', 'kp="300" kv="20" forcerange="-3 3"',
        ("tracking error", "end position"), same_model=False,
    ),
    PlantedChange(
        "a coarse step", ARM, 'timestep="0.002"', 'timestep="0.02"',
        ("tracking error", "numerical error"),
    ),
    PlantedChange(
        "explicit damping at a coarse step", ARM, 'timestep="0.002" integrator="implicitfast"',
        'timestep="0.01" integrator="Euler"', ("tracking error", "numerical error"),
    ),
    PlantedChange(
        "a joint without its limit", ARM, 'range="-20 20"', 'range="-20 20" limited="false"',
        ("hinge beyond its limit",), same_model=False,
    ),
    PlantedChange(
        "a soft limit", ARM, 'range="-20 20"', 'range="-20 20" solreflimit=".5 1"',
        ("hinge beyond its limit",), same_model=False,
    ),
    PlantedChange(
        "a load that is compensated", ARM, '<body name="lower"', '<body name="lower" gravcomp="1"',
        ("end position", "tracking error"), same_model=False,
    ),
    PlantedChange(
        "an open loop", LINKAGE, '<connect name="loop"', '<connect name="loop" active="false"',
        ("equality gap", "end position", "tracking error"), same_model=False,
    ),
    PlantedChange(
        "a soft loop", LINKAGE, '<connect name="loop"', '<connect name="loop" solref=".3 1"',
        ("equality gap",), same_model=False,
    ),
    PlantedChange(
        "a loop at a coarse step", LINKAGE, 'timestep="0.002"', 'timestep="0.02"',
        ("equality gap", "numerical error", "tracking error"),
    ),
    PlantedChange(
        "an exclude that hides contacts", STACK, "</worldbody>",
        '</worldbody><contact><exclude body1="low" body2="high"/></contact>',
        ("end position", "depth", "numerical error"),
    ),
    PlantedChange(
        "a geom that collides with nothing", STACK, 'name="high" type="box"',
        'name="high" type="box" contype="0" conaffinity="0"', ("end position", "numerical error"),
    ),
    PlantedChange(
        "soft contacts", STACK, 'type="box"', 'type="box" solref=".2 1"',
        ("depth", "resting depth"), same_model=False,
    ),
    PlantedChange(
        "slippery boxes", STACK, 'mass="1"', 'mass="1" friction=".1" priority="1"',
        ("creep", "end position"), same_model=False,
    ),
    PlantedChange(
        "bouncing contacts", STACK, 'type="box"', 'type="box" solref="-40000 -1"',
        ("end position", "depth", "numerical error"), same_model=False,
    ),
    PlantedChange("one iteration", STACK, "<option", '<option solver="PGS" iterations="1"',
        ("numerical error", "depth", "resting depth", "end position")),
    PlantedChange(
        "no contacts", STACK, "<option", '<option><flag contact="disable"/></option><option',
        ("end position", "numerical error"),
    ),
    PlantedChange(
        "Euler for Runge-Kutta", PENDULUM, 'integrator="RK4"', 'integrator="Euler"',
        ("energy gain", "energy error", "numerical error"),
    ),
    PlantedChange(
        "another gravity", PENDULUM, "<option", '<option gravity="0 0 -9"',
        ("end position", "energy error"), same_model=False,
    ),
)  # fmt: skip

_ASSET = '<asset><mesh name="unused" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody>'
_FAR = '<geom name="far" type="sphere" size=".1" pos="9 9 .2"/></worldbody>'
_SEEN = (
    '<geom name="seen" type="sphere" size=".1" contype="0" conaffinity="0" group="2"/></worldbody>'
)
HARMLESS = (
    PlantedChange("an unused mesh", PINCH, "<worldbody>", _ASSET),
    PlantedChange("an unused mesh in an arm", ARM, "<worldbody>", _ASSET),
    PlantedChange("a visual geom", STACK, "</worldbody>", _SEEN),
    PlantedChange("a far geom", PENDULUM, "</worldbody>", _FAR),
    PlantedChange(
        "sensors", ARM, "</actuator>",
        '</actuator><sensor><jointpos joint="elbow"/><jointvel joint="elbow"/></sensor>',
    ),
    PlantedChange(
        "a pair that never touches", PINCH, "<actuator>",
        '<contact><exclude body1="hand" body2="box"/></contact><actuator>',
    ),
    PlantedChange(
        "a pair of parent and child", ARM, "<actuator>",
        '<contact><exclude body1="upper" body2="lower"/></contact><actuator>',
    ),
    PlantedChange("a tighter tolerance", STACK, "<option", '<option tolerance="1e-12"'),
    PlantedChange("more iterations", STACK, "<option", '<option iterations="300"'),
    PlantedChange("a dense Jacobian", STACK, "<option", '<option jacobian="dense"'),
    PlantedChange("a sparse Jacobian", STACK, "<option", '<option jacobian="sparse"'),
    PlantedChange("a sparse Jacobian of an arm", ARM, "<option", '<option jacobian="sparse"'),
    PlantedChange("a sparse loop", LINKAGE, "<option", '<option jacobian="sparse"'),
    PlantedChange("half the step of a stack", STACK, 'timestep="0.002"', 'timestep="0.001"'),
    PlantedChange("half the step of an arm", ARM, 'timestep="0.002"', 'timestep="0.001"'),
    PlantedChange("half the step of a grip", PINCH, 'timestep="0.002"', 'timestep="0.001"'),
    PlantedChange("half the step of a loop", LINKAGE, 'timestep="0.002"', 'timestep="0.001"'),
    PlantedChange("a camera", STACK, "</worldbody>", '<camera pos="0 -2 1"/></worldbody>'),
    PlantedChange("a light", PINCH, "</worldbody>", '<light pos="0 0 2"/></worldbody>'),
    PlantedChange("a site", ARM, '<body name="lower"', '<site name="tip"/><body name="lower"'),
    PlantedChange("a keyframe", ARM, "</mujoco>",
        '<keyframe><key name="home"/></keyframe></mujoco>'),
    PlantedChange("more memory", STACK, "<worldbody>", '<size memory="20M"/><worldbody>'),
    PlantedChange("computed energy", STACK, "<worldbody>",
        '<option><flag energy="enable"/></option><worldbody>'),
    PlantedChange("noslip without friction loss in an arm", ARM, "<option",
        '<option noslip_iterations="3"'),
    PlantedChange("impratio without contacts", ARM, "<option", '<option impratio="10"'),
    PlantedChange("cones without contacts", ARM, "<option", '<option cone="elliptic"'),
    PlantedChange("cones of a pendulum", PENDULUM, "<option", '<option cone="elliptic"'),
    PlantedChange("another solver of a pendulum", PENDULUM, "<option", '<option solver="CG"'),
    PlantedChange("another solver of an arm", ARM, "<option", '<option solver="CG"'),
    PlantedChange("names of another model", STACK, 'model="stack"', 'model="pile"'),
)  # fmt: skip


def write_pile(geom: str) -> str:
    """Return a model of twelve bodies that fall on each other."""
    generator, bodies = np.random.default_rng(0), list[str]()
    for each in range(12):
        x, y = generator.uniform(-0.04, 0.04, 2)
        angles = " ".join(f"{angle:.0f}" for angle in generator.uniform(0, 90, 3))
        place = f"{x:.3f} {y:.3f} {0.05 + 0.045 * each:.3f}"
        bodies.append(f'<body pos="{place}" euler="{angles}"><freejoint/><geom {geom}/></body>')
    return f"""
<mujoco model="pile">
  <option timestep="0.002" noslip_iterations="3"/>
  <default><geom friction="1" solref="0.02 1"/></default>
  <worldbody><geom type="plane" size="2 2 .1"/>{"".join(bodies)}</worldbody>
</mujoco>
"""


BOXES = write_pile('type="box" size=".03 .02 .015"')
SPHERES = write_pile('size=".025"')
"""Where the bodies of a pile end is chance. They touch, slide and creep as their contacts say."""

_PILE_HARM = (
    PlantedChange("friction x.7", BOXES, 'friction="1"', 'friction="0.7"'),
    PlantedChange("no noslip", BOXES, ' noslip_iterations="3"', ""),
    PlantedChange("four times the step", BOXES, '"0.002"', '"0.008"'),
    PlantedChange("a margin", BOXES, 'friction="1"', 'friction="1" margin="0.005"'),
    PlantedChange("three times softer", BOXES, '"0.02 1"', '"0.06 1"'),
)
_PILE_HARMLESS = (
    PlantedChange("half the step", BOXES, '"0.002"', '"0.001"'),
    PlantedChange("a sparse Jacobian", BOXES, "<option", '<option jacobian="sparse"'),
    PlantedChange("a tighter tolerance", BOXES, "<option", '<option tolerance="1e-12"'),
    PlantedChange("another solver", BOXES, "<option", '<option solver="CG"'),
    PlantedChange("a camera", BOXES, "</worldbody>", '<camera pos="0 -2 1"/></worldbody>'),
)


def _on_both(changes: tuple[PlantedChange, ...]) -> tuple[PlantedChange, ...]:
    spheres = (
        replace(change, name=f"{change.name} of spheres", model=SPHERES)
        for change in changes
        if change.name != "no noslip"  # spheres that roll do not slip
    )
    return (*changes, *spheres)


HARMFUL_TO_PILES = _on_both(_PILE_HARM)
HARMLESS_TO_PILES = _on_both(_PILE_HARMLESS)
