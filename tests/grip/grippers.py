"""Grippers of a few lines, of which laws are known."""

CLAW = """
<mujoco model="claw">
  <option timestep="0.002" cone="{cone}" impratio="{impratio}"/>
  <default><geom friction="{friction} .005 .0001" solref="{solref}"/></default>
  <worldbody>
    <body name="{base}" pos=".1 .2 .5" quat="{quat}">
      <geom type="box" size=".06 .02 .01" pos="0 0 .08" contype="0" conaffinity="0"/>
      <body name="{left}" pos="-.025 0 0">
        <joint name="{left} slide" type="slide" axis="1 0 0" range="-.03 .03" damping="5"
          armature=".1"/>
        <geom name="{left} pad" type="box" size=".005 .01 .01" pos="-.005 0 0" mass=".05"/>
      </body>
      <body name="{right}" pos=".025 0 0">
        <joint name="{right} slide" type="slide" axis="{way} 0 0" range="{range}" damping="5"
          armature=".1"/>
        <geom name="{right} pad" type="box" size=".005 .01 .01" pos=".005 0 0" mass=".05"/>
      </body>
    </body>
    {more}
  </worldbody>
  <actuator>
    <motor name="a" joint="{left} slide" ctrlrange="-{most} {most}"/>
    <motor name="b" joint="{right} slide" ctrlrange="-{most} {most}"/>
  </actuator>
  {end}
</mujoco>
"""
DEFAULT_OBJECT = {
    "cone": "pyramidal",
    "impratio": "1",
    "friction": "1",
    "solref": ".02 1",
    "base": "claw",
    "quat": "1 0 0 0",
    "left": "left",
    "right": "right",
    "way": "-1",
    "range": "-.03 .03",
    "most": "20",
    "more": "",
    "end": "",
}
BAR = """
<body name="bar" pos=".1 .2 .5">
  <freejoint/><geom name="bar" type="box" size=".025 .02 .06" mass="{mass}"/>
</body>
"""
HELD = '<keyframe><key name="held" qpos="0 0 .1 .2 .5 1 0 0 0" ctrl="{force} {force}"/></keyframe>'


def claw(**changed: str) -> str:
    """Return two pads on slides, each pushed by a motor."""
    return CLAW.format(**{**DEFAULT_OBJECT, **changed})


def claw_with_bar(force: float, mass: float, **changed: str) -> str:
    """Return a claw that squeezes a bar in its keyframe `held`."""
    return claw(more=BAR.format(mass=mass), end=HELD.format(force=force), **changed)
