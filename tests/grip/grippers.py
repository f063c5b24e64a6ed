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


# Two fingers with long flat pads, which one actuator closes through a tendon: a rod that splits its
# force, or a cord.
_TENDON_JAWS = """<mujoco><worldbody><body name="palm" pos="0 0 .3">
  <geom type="box" size=".05 .08 .02" mass=".4"/><site name="drum"/>
  <body name="left" pos="0 -.05 -.02">{left}<site name="left" pos="0 .008 -.05"/>
    <geom type="box" pos="0 0 -.05" size=".015 .006 .05" mass=".05"/></body>
  <body name="right" pos="0 .05 -.02">{right}<site name="right" pos="0 -.008 -.05"/>
    <geom type="box" pos="0 0 -.05" size=".015 .006 .05" mass=".05"/></body></body></worldbody>
  {rest}</mujoco>"""
_SLIDE = '<joint name="{}" type="slide" axis="0 {} 0" range="0 .045" damping="5" armature=".05"/>'
_SPRUNG = """<joint name="{}" axis="{} 0 0" range="-40 30" stiffness=".1" springref="-35"
  damping=".05" armature=".001"/>"""
TENDON_JAWS = {
    "coupled": _TENDON_JAWS.format(
        left=_SLIDE.format("l", 1),
        right=_SLIDE.format("r", -1),
        rest="""<tendon><fixed name="rod"><joint joint="l" coef=".5"/><joint joint="r" coef=".5"/>
  </fixed></tendon><equality><joint joint1="l" joint2="r"/></equality>
  <actuator><position tendon="rod" kp="800" kv="20" ctrlrange="0 .045" forcerange="-40 40"/>
  </actuator>""",
    ),
    "cord": _TENDON_JAWS.format(
        left=_SPRUNG.format("l", 1),
        right=_SPRUNG.format("r", -1),
        rest="""<tendon><spatial name="cord"><site site="left"/><site site="drum"/>
  <site site="right"/></spatial></tendon>
  <actuator><general tendon="cord" gainprm="-1" ctrlrange="0 30"/></actuator>""",
    ),
}
