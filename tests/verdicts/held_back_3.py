"""A third part that no rule may be written by: robots and machines that users bring.

Its author had read none of the code that judges, and ran it on none of these models. A limit is a
share of the model's own size, speed, weight or energy. A twin differs from its failing model by one
number, or by the name of an integrator or a flag.
"""

import numpy as np
from tests.verdicts.corpus import (
    Truth,
    beyond,
    case,
    departs,
    gained,
    opened,
    restless,
    rests_off,
    slipped,
    strays,
    trembles,
    unbalanced,
)

_LEG = """<body pos="{x} {y} 0"><joint name="{n}_hip" axis="0 1 0" damping=".2"/>
<geom type="capsule" fromto="0 0 0 -.14 0 -.14" size=".02" mass=".4"/>
<body pos="-.14 0 -.14"><joint name="{n}_knee" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .14 0 -.14" size=".012" mass=".1"/>
<geom type="sphere" size=".02" pos=".14 0 -.14" mass=".03" friction="1"/></body></body>"""
_LEGS = "".join(
    _LEG.format(x=x, y=y, n=name)
    for name, x, y in (("fl", 0.2, 0.1), ("fr", 0.2, -0.1), ("rl", -0.2, 0.1), ("rr", -0.2, -0.1))
)
_LEG_SERVOS = "".join(
    f"""<position joint="{name}_hip" kp="80" kv="2"/>
    <position joint="{name}_knee" kp="60" kv="4"/>"""
    for name in ("fl", "fr", "rl", "rr")
)


def _shakes(dofs: slice, speed: float) -> Truth:
    """Return what `trembles` measures, of degrees of freedom that no scalar joint has."""
    return lambda motion: float(
        np.sqrt(np.mean(np.square(np.diff(motion.qvel[motion.end, dofs], 2, axis=0)))) / 4 / speed
    )


ACTUATORS = [
    case(
        "actuator",
        "a quadruped on its test stand whose knees buzz",
        f"""<option timestep=".004" integrator="<<way>>"/><default><position forcerange="-25 25"/>
        </default><worldbody><geom type="plane" size="5 5 .1"/>
        <geom type="box" size=".1 .06 .2" pos="0 0 .2"/><body name="trunk" pos="0 0 .45">
        <freejoint/><geom type="box" size=".24 .08 .05" mass="7"/>{_LEGS}</body></worldbody>
        <actuator>{_LEG_SERVOS}</actuator>
        <keyframe><key qpos="0 0 .45 1 0 0 0 0 0 0 0 0 0 0 0"
        ctrl="0 .2 0 .2 0 -.2 0 -.2"/></keyframe>""",
        {"way": ("Euler", "implicitfast")},
        trembles(1.0, "fl_knee", "rr_knee"),
        0.2,
    ),
    case(
        "actuator",
        "a cable robot whose winches shake its platform",
        """<option timestep=".005"/><default><position kp="<<kp>>" kv="40"
        forcerange="-300 0"/></default><worldbody><site name="nw" pos="-1.5 0 2"/>
        <site name="ne" pos="1.5 0 2"/><site name="sw" pos="-1.5 0 0"/>
        <site name="se" pos="1.5 0 0"/><body name="platform" pos="0 0 1">
        <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
        <joint name="tilt" axis="0 1 0"/><geom type="box" size=".15 .1 .05" mass="4"/>
        <site name="pnw" pos="-.15 0 .05"/><site name="pne" pos=".15 0 .05"/>
        <site name="psw" pos="-.15 0 -.05"/><site name="pse" pos=".15 0 -.05"/></body></worldbody>
        <tendon><spatial name="nw"><site site="nw"/><site site="pnw"/></spatial>
        <spatial name="ne"><site site="ne"/><site site="pne"/></spatial>
        <spatial name="sw"><site site="sw"/><site site="psw"/></spatial>
        <spatial name="se"><site site="se"/><site site="pse"/></spatial></tendon><actuator>
        <position tendon="nw"/><position tendon="ne"/><position tendon="sw"/>
        <position tendon="se"/></actuator>
        <keyframe><key ctrl="1.6 1.6 1.6 1.6"/></keyframe>""",
        {"kp": (400000, 900)},
        restless,
        0.2,
    ),
    case(
        "actuator",
        "a winch whose geared motor is braked to and fro by its own voltage",
        """<option timestep=".005"/><default><geom contype="0" conaffinity="0"/></default>
        <worldbody><body name="drum" pos="0 0 2"><joint name="drum" axis="0 1 0" armature=".05"/>
        <geom type="cylinder" size=".06 .1" euler="90 0 0" mass="1.2"/></body>
        <body name="bucket" pos=".06 0 1"><joint name="rise" type="slide" axis="0 0 1"
        damping="30"/><geom type="cylinder" size=".12 .15" mass="6"/></body></worldbody>
        <tendon><fixed name="rope" stiffness="20000" damping="150">
        <joint joint="drum" coef="-.06"/><joint joint="rise" coef="-1"/></fixed></tendon>
        <actuator><dcmotor joint="drum" gear="40" motorconst=".06 .06" resistance="<<ohm>>"
        saturation="4 0 0" ctrlrange="-24 24"/></actuator>
        <keyframe><key ctrl="5"/></keyframe>""",
        {"ohm": (0.1, 2)},
        trembles(1.0, "drum"),
        0.2,
    ),
    case(
        "actuator",
        "a landing drone that its rate loop shakes",
        """<option timestep=".008"/><worldbody><geom type="plane" size="5 5 .1"/>
        <body name="drone" pos="0 0 .2"><freejoint/><geom type="box" size=".09 .06 .025" mass=".7"/>
        <geom type="capsule" fromto="-.16 -.16 0 .16 .16 0" size=".012" mass=".12"/>
        <geom type="capsule" fromto="-.16 .16 0 .16 -.16 0" size=".012" mass=".12"/>
        <geom type="capsule" fromto="-.1 .1 -.08 .1 .1 -.08" size=".008" mass=".03"/>
        <geom type="capsule" fromto="-.1 -.1 -.08 .1 -.1 -.08" size=".008" mass=".03"/>
        <site name="hub"/></body></worldbody><actuator>
        <motor site="hub" gear="0 0 1 0 0 0"/>
        <velocity site="hub" gear="0 0 0 1 0 0" kv="<<kv>>" forcerange="-3 3"/>
        <velocity site="hub" gear="0 0 0 0 1 0" kv="<<kv>>" forcerange="-3 3"/>
        <velocity site="hub" gear="0 0 0 0 0 1" kv=".1" forcerange="-3 3"/></actuator>
        <keyframe><key qpos="0 0 .2 1 0 0 0" qvel="0 0 0 .1 .2 0" ctrl="9 0 0 0"/></keyframe>""",
        {"kv": (2, 0.15)},
        _shakes(slice(3, 5), 1.0),
        0.2,
    ),
    case(
        "actuator",
        "a toggle press whose ram servo rattles its crank",
        """<option timestep=".004"/><default><geom contype="0" conaffinity="0"/></default>
        <worldbody><body name="crank" pos="0 0 1"><joint name="crank" axis="0 1 0" damping="1"/>
        <geom type="cylinder" size=".15 .03" euler="90 0 0" mass="9"/>
        <site name="pin" pos=".1 0 0"/></body><site name="ram" pos="0 0 .2" euler="0 0 0"/>
        </worldbody><actuator><position cranksite="pin" slidersite="ram" cranklength=".6"
        kp="2000" kv="<<kv>>" forcerange="-900 900"/></actuator>
        <keyframe><key qpos=".2" ctrl=".2"/></keyframe>""",
        {"kv": (9000, 300)},
        trembles(1.0, "crank"),
        0.2,
    ),
    case(
        "actuator",
        "a camera head on a ball joint that its stabiliser throws about",
        """<option timestep=".01"/><worldbody><body pos="0 0 1.5"><joint name="neck" type="ball"
        damping=".01"/><geom type="box" size=".06 .05 .04" mass=".8"/>
        <geom type="cylinder" size=".025 .04" pos=".09 0 0" euler="0 90 0" mass=".25"/></body>
        </worldbody><actuator><position joint="neck" gear="1 0 0" kp="6" kv="<<kv>>"
        forcerange="-4 4"/><position joint="neck" gear="0 1 0" kp="6" kv="<<kv>>"
        forcerange="-4 4"/><position joint="neck" gear="0 0 1" kp="6" kv="<<kv>>"
        forcerange="-4 4"/></actuator>
        <keyframe><key qpos=".99 .1 .05 .05" ctrl="0 0 0"/></keyframe>""",
        {"kv": (2, 0.15)},
        _shakes(slice(0, 3), 1.0),
        0.2,
    ),
    case(
        "actuator",
        "a pick and place axis whose integral gain outruns its step",
        """<option timestep="<<h>>" integrator="implicitfast"/><worldbody>
        <body name="carriage" pos="0 0 .8"><joint name="x" type="slide" axis="1 0 0"/>
        <geom type="box" size=".08 .1 .06" mass="3"/><body pos="0 0 -.1">
        <joint name="z" type="slide" axis="0 0 -1"/><geom type="box" size=".03 .03 .15" mass=".8"/>
        <geom type="cylinder" size=".02 .03" pos="0 0 -.18" mass=".1"/></body></body></worldbody>
        <actuator><pid joint="x" kp="30000" kv="500" ki="20000" imax=".02" input="pos"
        forcerange="-400 400"/><pid joint="z" kp="12000" kv="150" ki="8000" imax=".02"
        input="pos" forcerange="-150 150"/></actuator>
        <keyframe><key ctrl=".3 .1"/></keyframe>""",
        {"h": (0.025, 0.002)},
        restless,
        0.1,
        3.0,
    ),
]

CONSTRAINTS = [
    case(
        "constraint",
        "a catapult whose arm flies through its stop",
        """<option timestep="<<h>>"/><worldbody><body name="arm" pos="0 0 .6">
        <joint name="axle" axis="0 -1 0" range="-30 75" solreflimit=".002 1" damping=".02"
        stiffness="15"
        springref="120" armature=".01"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".015"
        mass=".4"/><geom type="sphere" size=".05" pos=".5 0 0" mass=".3"/></body></worldbody>
        <keyframe><key qpos="-.5"/></keyframe>""",
        {"h": (0.02, 0.0005)},
        beyond("axle", -np.pi / 6, np.radians(75)),
        0.1,
    ),
    case(
        "constraint",
        "a valve lifter whose cam law gives under its load",
        """<option timestep=".002"/><default><geom contype="0" conaffinity="0"/></default>
        <worldbody><body pos="0 0 .5"><joint name="cam" axis="0 1 0" damping=".4"
        armature=".01"/><geom type="cylinder" size=".02 .01" euler="90 0 0" mass=".02"/></body>
        <body name="lifter" pos="0 0 .6"><joint name="lift" type="slide" axis="0 0 1"/>
        <geom type="cylinder" size=".03 .05" mass="20"/></body></worldbody><equality>
        <joint joint1="lift" joint2="cam" polycoef="0 .01 .012 0 0"
        solimp="<<d>>"/></equality><actuator>
        <motor joint="cam" gear="3.5"/></actuator><keyframe><key qpos=".6 .01032" ctrl="1"/>
        </keyframe>""",
        {"d": (".9 .95 .001", ".9999 .99999 .001")},
        lambda motion: float(
            np.abs(
                motion.joint("lift") - 0.01 * motion.joint("cam") - 0.012 * motion.joint("cam") ** 2
            ).max()
            / 0.1
        ),
        0.05,
    ),
    case(
        "constraint",
        "a climber whose rope throws him higher than he fell from",
        """<option timestep="<<h>>"/><worldbody><site name="bolt" pos="0 0 10"/>
        <body name="climber" pos="0 0 9"><joint name="fall" type="slide" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 -.3 0 0 .3" size=".15" mass="70"/>
        <site name="harness"/></body></worldbody><tendon><spatial name="rope" limited="true"
        range="0 1.5" solreflimit="-18000 -2" solimplimit=".99 .99 .001"><site site="bolt"/>
        <site site="harness"/></spatial></tendon>""",
        {"h": (0.012, 0.0005)},
        gained(70 * 9.81 * 0.5),
        0.1,
        3.0,
    ),
    case(
        "constraint",
        "a ceiling lamp that stretches its cable",
        """<option timestep=".004" integrator="implicitfast"/><worldbody>
        <flexcomp name="cable" type="grid" dim="1" count="11 1 1" spacing=".06 .06 .06"
        pos=".3 0 2" euler="0 90 0" mass=".3" radius=".004"><edge equality="true" solimp="<<d>>"/>
        <contact selfcollide="none" contype="0" conaffinity="0"/><pin id="0"/></flexcomp>
        <body name="lamp" pos=".3 0 1.3"><freejoint/><geom type="ellipsoid" size=".15 .15 .08"
        mass="3"/></body></worldbody>
        <equality><connect body1="lamp" body2="cable_10" anchor="0 0 .1"
        solimp=".999 .9999 .001"/></equality>""",
        {"d": (".9 .95 .001", ".999 .9999 .001")},
        lambda motion: float(
            np.linalg.norm(
                motion.vertex[motion.end, 10] - motion.vertex[motion.end, 0], axis=1
            ).max()
            / 0.6
            - 1
        ),
        0.15,
        2.0,
    ),
    case(
        "constraint",
        "a parallel gripper whose mimic finger is left behind",
        """<option timestep=".002"/><worldbody><body pos="0 0 .3">
        <body name="driver" pos="-.05 0 0"><joint name="driver" type="slide" axis="1 0 0"
        range="-.01 .06" damping="30"/><geom type="box" size=".004 .012 .03" mass=".02"/></body>
        <body name="mimic" pos=".05 0 0"><joint name="mimic" type="slide" axis="-1 0 0"
        range="-.01 .06"/><geom type="box" size=".004 .012 .03" mass=".02"/></body></body>
        <geom type="box" size=".006 .02 .02" pos=".025 0 .3" contype="0" conaffinity="0"/>
        <geom type="cylinder" size=".02 .02" pos=".01 0 .3" solref=".004 1"
        solimp=".998 .999 .001" priority="1"/></worldbody><equality>
        <joint joint1="mimic" joint2="driver" solimp="<<d>>"/></equality><actuator>
        <motor joint="driver" ctrlrange="0 60"/></actuator><keyframe><key ctrl="40"/></keyframe>""",
        {"d": (".9 .95 .001", ".999 .9995 .001")},
        lambda motion: float(
            np.abs(motion.joint("mimic") - motion.joint("driver"))[motion.end].max() / 0.05
        ),
        0.2,
    ),
    case(
        "constraint",
        "a ventilation flap that hangs off its stop",
        """<option timestep=".002"/><worldbody><body name="flap" pos="0 0 1">
        <joint name="hinge" axis="0 1 0" range="-5 80" margin="<<m>>" damping=".05"/>
        <geom type="box" size=".15 .2 .003" pos=".15 0 0" mass=".6"/></body></worldbody>
        <keyframe><key qpos=".9"/></keyframe>""",
        {"m": (0.35, 0.002)},
        lambda motion: float(np.abs(motion.joint("hinge")[-1] - np.radians(80)) / np.radians(85)),
        0.1,
        3.0,
    ),
    case(
        "constraint",
        "a peg that is pushed out of the gripper it is welded to",
        """<option timestep=".002"/><worldbody><body name="wrist" pos="0 0 .5">
        <joint name="feed" type="slide" axis="0 0 -1" damping="80"/>
        <geom type="box" size=".05 .05 .03" mass="1.5" contype="0" conaffinity="0"/>
        <site name="jaw" pos="0 0 -.05"/></body><body name="peg" pos="0 0 .41"><freejoint/>
        <geom type="cylinder" size=".008 .04" mass="<<peg>>"/><site name="head" pos="0 0 .04"/>
        </body><geom type="box" size=".05 .05 .1" pos="0 0 .25" solref=".004 1"
        solimp=".998 .999 .001" priority="1"/></worldbody><equality>
        <weld site1="jaw" site2="head"/></equality><actuator>
        <motor joint="feed" ctrlrange="0 300"/></actuator><keyframe>
        <key qpos="0 0 0 .41 1 0 0 0" ctrl="120"/></keyframe>""",
        {"peg": (0.015, 1.5)},
        lambda motion: opened("jaw", "head")(motion) / 0.08,
        0.1,
    ),
]

_STILL = " ".join("0" * (4 * 4 * 3 * 3))
_RIDGE = " ".join("0 0 0 0 0 0 0 1 0 0 0 0 0 0 0" for _ in range(5))


def _past(joint: str, level: float, size: float) -> Truth:
    """Return what measures how far a joint gets past a level, in a size of what should stop it."""
    return lambda motion: float((motion.joint(joint).max() - level) / size)


PASSING = [
    case(
        "passing",
        "a hopper whose point foot steps through a stair",
        """<option timestep="<<h>>"/><default><geom solref=".0004 1"/></default>
        <worldbody><geom type="plane" size="3 3 .1"/>
        <geom name="tread" type="box" size=".15 .4 .008" pos="0 0 .5"/>
        <body name="hopper" pos="0 0 2.2"><joint name="z" type="slide" axis="0 0 1"/>
        <geom type="box" size=".12 .1 .06" mass="5" contype="0" conaffinity="0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".6" contype="0"
        conaffinity="0"/><body name="foot" pos="0 0 -.35"><joint name="leg" type="slide"
        axis="0 0 1" stiffness="4000" damping="12"/>
        <geom type="sphere" size=".012" mass=".05"/></body></body></worldbody>
        <keyframe><key qvel="-1 0"/></keyframe>""",
        {"h": (0.01, 0.0005)},
        lambda motion: float((0.45 - motion.body("foot")[:, 2]).max() / 0.1),
        1.0,
        1.0,
    ),
    case(
        "passing",
        "the blades of two whisks that cut through each other",
        """<option timestep="<<h>>" gravity="0 0 0"/><default><geom solref=".0004 1"/></default>
        <worldbody><body name="near"><joint name="near" axis="0 0 1"/>
        <geom type="capsule" fromto=".02 0 0 .3 0 0" size=".006" mass=".1"/></body>
        <body name="far" pos=".4 0 0"><joint name="far" axis="0 0 1"/>
        <geom type="capsule" fromto="-.02 0 0 -.3 0 0" size=".006" mass=".1"/></body></worldbody>
        <keyframe><key qpos="-1.14 -1.14" qvel="30 30"/></keyframe>""",
        {"h": (0.004, 0.0001)},
        lambda motion: float(np.minimum(motion.joint("near"), motion.joint("far")).max()),
        0.2,
        0.2,
    ),
    case(
        "passing",
        "a seat belt tongue that shoots past its bolt",
        """<option timestep="<<h>>" gravity="0 0 0"/><default><geom solref=".0002 1"/></default>
        <worldbody><geom name="bolt" type="capsule" fromto=".168 -.02 0 .168 .02 0" size=".004"/>
        <body name="tongue"><joint name="slot" type="slide" axis="1 0 0"/>
        <geom type="ellipsoid" size=".012 .01 .003" mass=".04"/></body></worldbody><actuator>
        <motor joint="slot"/></actuator><keyframe><key qvel="9" ctrl="2"/></keyframe>""",
        {"h": (0.005, 0.0001)},
        _past("slot", 0.168, 0.012),
        2.0,
        0.2,
    ),
    case(
        "passing",
        "a drone that drops through the deck of a rising boat",
        """<option timestep="<<h>>"/><default><geom solref=".0004 1"/></default><worldbody>
        <body name="boat" pos="0 0 .2">
        <joint name="heave" type="slide" axis="0 0 1" stiffness="9000" damping="200"
        springref=".1"/><geom name="deck" type="box" size=".8 .5 .005" mass="60"/>
        <geom type="ellipsoid" size=".9 .4 .1" pos="0 0 -.3" mass="120" contype="0"
        conaffinity="0"/></body><body name="drone" pos="0 .1 3"><freejoint/>
        <geom type="cylinder" size=".15 .02" mass="1.1"/><geom type="sphere" size=".05"
        pos="0 0 .03" mass=".2" contype="0" conaffinity="0"/></body></worldbody>
        <keyframe><key qvel="2 0 0 -8 0 0 0"/></keyframe>""",
        {"h": (0.008, 0.0002)},
        lambda motion: float((motion.body("boat")[:, 2] - motion.body("drone")[:, 2]).max() / 0.04),
        1.0,
        0.6,
    ),
    case(
        "passing",
        "a ball that leaves a block of rubber as it came",
        f"""<option timestep="<<h>>" gravity="0 0 0"/><default><geom solref=".0004 1"/></default>
        <worldbody>
        <flexcomp name="rubber" type="grid" dim="3" count="4 4 3" spacing=".06 .06 .03" pos="0 0 .5"
        mass="3" radius=".002"><edge equality="true"/><contact selfcollide="none" solref=".0004 1"/>
        </flexcomp><body name="ball" pos=".011 .007 .8"><freejoint/><geom type="sphere" size=".02"
        mass=".02"/></body></worldbody>
        <keyframe><key qvel="{_STILL} 0 0 -20 0 0 0"/></keyframe>""",
        {"h": (0.01, 0.0005)},
        lambda motion: float((0.45 - motion.body("ball")[:, 2]).max() / 0.06),
        1.0,
        0.1,
    ),
    case(
        "passing",
        "a scraper that is drawn through a ridge of its field",
        f"""<option timestep="<<h>>" gravity="0 0 -1"/><asset><hfield name="field" nrow="5"
        ncol="15" size=".35 .4 .25 .05" elevation="{_RIDGE}"/></asset><worldbody>
        <geom type="hfield" hfield="field" solref=".0004 1"/><body name="scraper" pos="-.3 0 .06">
        <joint name="x" type="slide" axis="1 0 0"/><geom type="ellipsoid" size=".02 .06 .02"
        mass=".8" solref=".0004 1"/></body></worldbody>
        <keyframe><key qvel="14"/></keyframe>""",
        {"h": (0.012, 0.0002)},
        _past("x", 0.3, 0.05),
        2.0,
        0.2,
    ),
    case(
        "passing",
        "a latch bolt that its spring drives through the strike",
        """<option timestep="<<h>>"/><worldbody><geom name="strike" type="box"
        size=".002 .03 .03" pos=".12 0 1" solref=".0004 1"/>
        <body name="bolt" pos="0 0 1"><joint name="throw" type="slide" axis="1 0 0"
        stiffness="300" springref=".14" damping=".4"/>
        <geom type="box" size=".008 .008 .006" mass=".08" solref=".0004 1"/></body></worldbody>""",
        {"h": (0.006, 0.0001)},
        _past("throw", 0.11, 0.004),
        2.0,
        0.5,
    ),
]

_SPOKES = "".join(
    f"""<geom type="capsule" fromto="0 0 0 {0.3 * np.sin(angle):.4f} 0 {0.3 * np.cos(angle):.4f}"
    size=".02" mass=".25"/>"""
    for angle in np.arange(8) * np.pi / 4
)
_WHIP = """<body pos="0 0 -.25"><joint type="ball"/><geom type="capsule" fromto="0 0 0 0 0 -.25"
size=".015" mass=".4"/>"""

ENERGY = [
    case(
        "contact",
        "a pogo stick that hops higher with nobody on it",
        """<option timestep="<<h>>"/><worldbody><geom type="plane" size="3 3 .1" solref=".016 .2"/>
        <body name="frame" pos="0 0 1"><joint name="z" type="slide" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 -.2 0 0 .3" size=".03" mass="3"/>
        <geom type="capsule" fromto="0 -.15 .3 0 .15 .3" size=".015" mass=".4"/>
        <body name="foot" pos="0 0 -.4"><joint name="spring" type="slide" axis="0 0 1"
        stiffness="6000"/><geom type="sphere" size=".04" mass=".3"
        solref=".016 .2"/></body></body></worldbody>""",
        {"h": (0.004, 0.0002)},
        gained(3.4 * 9.81 * 0.56),
        0.1,
        3.0,
    ),
    case(
        "contact",
        "a rimless wheel that runs uphill from its spokes",
        f"""<option timestep="<<h>>"/><default><geom solref="-60000 -4" friction="1"/></default>
        <worldbody><geom type="plane" size="9 9 .1"/><body name="wheel" pos="0 0 .45">
        <freejoint/>{_SPOKES}<geom type="cylinder" size=".05 .08" euler="90 0 0" mass="2"/></body>
        </worldbody><keyframe><key qpos="0 0 .45 1 0 0 0" qvel="1 0 0 0 3 0"/></keyframe>""",
        {"h": (0.006, 0.0002)},
        gained(4 * 9.81 * 0.13),
        0.2,
        3.0,
    ),
    case(
        "contact",
        "a garden gate that its post throws wider open",
        """<option timestep="<<h>>"/><worldbody><geom name="post" type="cylinder" size=".05 .6"
        pos="1.15 .08 .6" solref="-120000 -6"/><body name="gate" pos="0 0 .6">
        <joint name="hinge" axis="0 0 1" stiffness="30"/><geom type="box" size=".58 .03 .4"
        pos=".6 0 0" mass="12" solref="-120000 -6"/></body></worldbody>
        <keyframe><key qpos="-1"/></keyframe>""",
        {"h": (0.006, 0.0005)},
        gained(0.5 * 30),
        0.1,
        3.0,
    ),
    case(
        "contact",
        "a dumb-bell that leaps about on the mat it was dropped on",
        """<option timestep="<<h>>"/><default><geom solref="-80000 -20"/></default><worldbody>
        <geom type="plane" size="9 9 .1"/><body name="bell" pos="0 0 .35" euler="0 25 10">
        <freejoint/><geom type="capsule" fromto="-.15 0 0 .15 0 0" size=".015" mass=".8"/>
        <geom type="sphere" size=".06" pos="-.15 0 0" mass="4"/>
        <geom type="sphere" size=".06" pos=".15 0 0" mass="4"/></body>
        <body pos="1 0 .5"><joint name="fan" axis="0 0 1" damping=".01"/><geom type="box"
        size=".1 .02 .005" mass=".05"/></body></worldbody><actuator>
        <velocity joint="fan" kv=".01"/></actuator>""",
        {"h": (0.006, 0.0005)},
        gained(8.8 * 9.81 * 0.29),
        0.1,
        3.0,
    ),
    case(
        "loss",
        "a bull whip that cracks of itself",
        f"""<option timestep="<<h>>"/><default>
        <geom contype="0" conaffinity="0"/></default>
        <worldbody><body pos="0 0 2"><joint type="ball"/><geom type="capsule"
        fromto="0 0 0 0 0 -.25" size=".015" mass=".4"/>{_WHIP * 2}{"</body>" * 2}</body></worldbody>
        <keyframe><key qpos=".8 .1 .58 .1 .9 .3 .3 0 1 0 0 0" qvel="0 2 3 2 0 0 0 0 0"/>
        </keyframe>""",
        {"h": (0.005, 0.0001)},
        unbalanced(1.2 * 9.81 * 0.375),
        0.1,
        3.0,
    ),
    case(
        "loss",
        "a thrown hammer that its shackle speeds up",
        """<option timestep="<<h>>" gravity="0 0 0"/><worldbody><site name="hand" pos="0 0 1"/>
        <body name="hammer" pos="1 0 1"><freejoint/><geom type="sphere" size=".06" mass="7"
        contype="0" conaffinity="0"/><geom type="capsule" fromto="-.9 0 0 -.06 0 0" size=".01"
        mass=".3" contype="0" conaffinity="0"/><site name="grip" pos="-1 0 0"/></body></worldbody>
        <equality><connect site1="hand" site2="grip" solref=".0004 1" solimp=".99 .999 .001"/>
        </equality><keyframe><key qpos="1 0 1 1 0 0 0" qvel="0 14 0 0 0 14"/></keyframe>""",
        {"h": (0.005, 0.0002)},
        unbalanced(0.5 * 7 * 14**2),
        0.2,
        3.0,
    ),
    case(
        "loss",
        "a sheet that shivers as it settles in water",
        """<option timestep="<<h>>" density="1000" viscosity=".001"/><default>
        <geom contype="0" conaffinity="0"/></default><worldbody>
        <body name="sheet" pos="0 0 1"><joint name="sink" type="slide" axis="0 0 1"/>
        <joint name="drift" type="slide" axis="1 0 0"/><geom type="box" size=".15 .1 .001"
        mass=".02"/></body></worldbody>""",
        {"h": (0.01, 0.001)},
        trembles(0.05, "sink"),
        0.1,
    ),
    case(
        "loss",
        "an acrobat whose somersault runs down in the air",
        """<option timestep="<<h>>" gravity="0 0 0" integrator="implicit"/><default>
        <geom contype="0" conaffinity="0"/></default>
        <worldbody><body name="trunk"><freejoint/><geom type="capsule" fromto="0 0 -.25 0 0 .25"
        size=".14" mass="35"/><geom type="sphere" size=".11" pos="0 0 .5" mass="5"/>
        <body pos="0 .2 .25"><joint name="arm_l" axis="1 0 0" stiffness="40"/><geom type="capsule"
        fromto="0 0 0 0 .5 .1" size=".04" mass="4"/></body>
        <body pos="0 -.2 .25"><joint name="arm_r" axis="1 0 0" stiffness="40"/><geom type="capsule"
        fromto="0 0 0 0 -.5 .1" size=".04" mass="4"/></body>
        <body pos="0 0 -.4"><joint name="legs" axis="0 1 0" stiffness="90" springref="60"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.8" size=".09" mass="24"/></body></body></worldbody>
        <keyframe><key qvel="0 0 0 1 9 2 0 0 0"/></keyframe>""",
        {"h": (0.005, 0.0002)},
        unbalanced(0.5 * 10 * 9**2),
        0.1,
        3.0,
    ),
]

_HOUSE = "".join(
    f"""<body name="card{k}" pos="{x} {0.0004 * (-1) ** k} {z}"><freejoint/><geom type="box"
    size="{size}" mass=".05"/></body>"""
    for k, (x, z, size) in enumerate(
        (
            (-0.0503, 0.1, ".004 .06 .1"),
            (0.05, 0.1, ".004 .06 .1"),
            (0, 0.204, ".08 .06 .004"),
            (-0.05, 0.308, ".004 .06 .1"),
            (0.05, 0.308, ".004 .06 .1"),
            (0, 0.412, ".08 .06 .004"),
            (-0.05, 0.516, ".004 .06 .1"),
            (0.05, 0.516, ".004 .06 .1"),
            (0, 0.62, ".08 .06 .004"),
        )
    )
)

SUPPORT = [
    case(
        "support",
        "a vacuum robot whose wheels run above the floor",
        """<option timestep=".004"/><default><geom margin="<<m>>"/></default><worldbody>
        <geom type="plane" size="4 4 .1"/><body name="robot" pos="0 0 .035"><freejoint/>
        <geom type="cylinder" size=".17 .03" pos="0 0 .02" mass="3" contype="0" conaffinity="0"/>
        <geom type="sphere" size=".035" pos=".12 0 0" mass=".1" friction=".01" priority="1"/>
        <body pos="-.02 .12 0"><joint name="left" axis="0 1 0" damping=".01"/>
        <geom type="cylinder" size=".035 .01" euler="90 0 0" mass=".15"/></body>
        <body pos="-.02 -.12 0"><joint name="right" axis="0 1 0" damping=".01"/>
        <geom type="cylinder" size=".035 .01" euler="90 0 0" mass=".15"/></body></body></worldbody>
        <actuator><velocity joint="left" kv=".02"/><velocity joint="right" kv=".02"/></actuator>
        <keyframe><key qpos="0 0 .035 1 0 0 0 0 0" ctrl="4 4"/></keyframe>""",
        {"m": (0.012, 0)},
        lambda motion: rests_off("robot", 0.035)(motion) / 0.035,
        0.1,
    ),
    case(
        "support",
        "a hanging sign that falls asleep at the end of its swing",
        """<option timestep=".002" sleep_tolerance="<<tol>>"><flag sleep="enable"/></option>
        <worldbody><geom type="plane" size="4 4 .1"/><body name="sign" pos="0 0 2">
        <joint name="hook" axis="0 1 0" damping=".05"/><geom type="capsule" fromto="0 0 0 0 0 -.4"
        size=".01" mass=".2"/><geom type="box" size=".2 .01 .12" pos="0 0 -.5" mass="1.5"/></body>
        </worldbody><keyframe><key qpos=".7"/></keyframe>""",
        {"tol": (0.4, 0.0005)},
        lambda motion: float(np.abs(motion.joint("hook")[motion.end]).min() / 0.7),
        0.5,
        3.0,
    ),
    case(
        "support",
        "a house of cards that its step blows down",
        f"""<option timestep="<<h>>" cone="elliptic" impratio="10"/><default>
        <geom friction="1" solref=".01 1"/></default><worldbody>
        <geom type="plane" size="2 2 .1"/>{_HOUSE}</worldbody>""",
        {"h": (0.02, 0.002)},
        rests_off("card8", 0.62),
        0.1,
        3.0,
    ),
    case(
        "support",
        "a light shackle that its load draws into the hook",
        """<option timestep=".002"/><default><geom solimp="<<d>>"/></default>
        <worldbody><geom name="hook" type="capsule"
        fromto="0 -.15 2 0 .15 2" size=".015"/><body name="shackle" pos="0 0 1.85">
        <joint name="slack" type="slide" axis="0 0 1"/>
        <joint name="sway" type="slide" axis="1 0 0" stiffness="400" damping="9"/>
        <geom type="capsule" fromto="-.08 0 .18 .08 0 .18" size=".012" mass=".4"/>
        <geom type="capsule" fromto="-.08 0 0 .08 0 0" size=".012" mass=".4"/></body>
        <body name="load" pos="0 0 1.4"><joint name="load" type="slide" axis="0 0 1"/>
        <geom type="capsule" fromto="0 -.08 .475 0 .08 .475" size=".012" mass="2"/>
        <geom type="box" size=".25 .25 .15" mass="180"/></body></worldbody>""",
        {"d": (".9 .95 .001", ".9995 .9999 .001")},
        lambda motion: float((1.4 - motion.body("load")[motion.end, 2]).max() / 0.024),
        0.5,
    ),
    case(
        "support",
        "a cast block that rocks for ever on its one point of contact",
        """<option timestep=".004"><flag multiccd="<<many>>"/></option><asset><mesh name="block"
        vertex="-.1 -.08 -.05 .1 -.08 -.05 .1 .08 -.05 -.1 .08 -.05 -.1 -.08 .05 .1 -.08 .05
        .1 .08 .05 -.1 .08 .05"/><mesh name="bed" vertex="-.5 -.5 -.1 .5 -.5 -.1 .5 .5 -.1
        -.5 .5 -.1 -.5 -.5 0 .5 -.5 0 .5 .5 0 -.5 .5 0"/></asset><worldbody>
        <geom type="mesh" mesh="bed"/><body name="block" pos="0 0 .05"><freejoint/>
        <geom type="mesh" mesh="block" mass="12"/></body></worldbody>""",
        {"many": ("disable", "enable")},
        restless,
        0.02,
        3.0,
    ),
    case(
        "support",
        "a plank that falls asleep as it tips over an edge",
        """<option timestep=".002" sleep_tolerance="<<tol>>"><flag sleep="enable"/></option>
        <worldbody><geom type="plane" size="4 4 .1"/><geom type="box" size=".6 .3 .35"
        pos="-.6 0 .35"/><body name="plank" pos=".04 0 .72"><freejoint/><geom type="box"
        size=".6 .1 .02" mass="6"/></body></worldbody>""",
        {"tol": (0.2, 0.0005)},
        lambda motion: float(max(motion.body("plank")[-1, 2] - 0.62, 0) / 0.1),
        0.5,
        3.0,
    ),
]

_CHAIN = "".join(
    f"""<body name="link{k}" pos="0 0 {1.95 - 0.1 * k:.2f}"><freejoint/><geom type="capsule"
    fromto="0 0 .04 0 0 -.04" size=".012" mass=".8"/><site name="a{k}" pos="0 0 .05"/>
    <site name="b{k}" pos="0 0 -.05"/></body>"""
    for k in range(10)
)
_CHAIN_PINS = "".join(f"""<connect site1="b{k}" site2="a{k + 1}"/>""" for k in range(9))
_PEARLS = "".join(
    f"""<body name="pearl{k}" pos="0 0 {1.9 - 0.1 * k:.1f}"><freejoint/><geom type="sphere"
    size=".02" mass=".15"/><site name="p{k}"/></body>"""
    for k in range(9)
)
_STRINGS = "".join(
    f"""<spatial limited="true" range="0 .1"><site site="p{k}"/><site site="p{k + 1}"/></spatial>"""
    for k in range(9)
)
_BALLS = "".join(
    f"""<body pos="0 0 {0.02 + 0.04 * k:.2f}"><joint type="slide" axis="0 0 1"/>
    <geom type="sphere" size=".02" mass=".3"/></body>"""
    for k in range(8)
)
_BEAM = "".join(
    f"""<body name="bay{k}" pos="{0.1 + 0.2 * k:.1f} 0 1"><freejoint/><geom type="box"
    size=".1 .04 .05" mass="1" contype="0" conaffinity="0"/><site name="f{k}" pos="-.1 0 0"/>
    <site name="r{k}" pos=".1 0 0"/></body>"""
    for k in range(10)
)
_BOLTS = "".join(f"""<weld site1="r{k}" site2="f{k + 1}"/>""" for k in range(9))


SOLVER = [
    case(
        "solver",
        "an anchor chain whose links part while the solver stops short",
        f"""<option timestep=".004" solver="PGS" iterations="<<n>>">
        <flag warmstart="disable"/></option><default><equality solimp=".99 .99 .001"/>
        <geom contype="0" conaffinity="0"/></default><worldbody><site name="hawse" pos="0 0 2"/>
        {_CHAIN}<body name="anchor" pos="0 0 .95"><freejoint/><geom type="box" size=".05 .08 .08"
        mass="12"/><site name="ring" pos="0 0 .05"/></body></worldbody><equality>
        <connect site1="hawse" site2="a0"/>{_CHAIN_PINS}<connect site1="b9" site2="ring"/>
        </equality>""",
        {"n": (4, 100)},
        lambda motion: max(opened(f"b{k}", f"a{k + 1}")(motion) for k in range(9)) / 0.1,
        0.3,
    ),
    case(
        "solver",
        "a two finger grasp that a starved solver lets go of",
        """<option timestep=".002" solver="PGS" iterations="<<n>>" cone="elliptic" impratio="10"/>
        <default><geom solref=".004 1" solimp=".99 .999 .001"/></default>
        <worldbody><geom type="plane" size="1 1 .1"/><body name="hand" pos="0 0 .5">
        <joint name="lift" type="slide" axis="0 0 1" damping="20"/>
        <geom type="box" size=".05 .06 .02" pos="0 0 .1" mass=".7"/>
        <body pos="-.05 0 0"><joint name="left" type="slide" axis="1 0 0" damping="5"/>
        <geom type="box" size=".008 .02 .04" mass=".08" friction="1"/></body>
        <body pos=".05 0 0"><joint name="right" type="slide" axis="-1 0 0" damping="5"/>
        <geom type="box" size=".008 .02 .04" mass=".08" friction="1"/></body></body>
        <body name="block" pos="0 0 .49"><freejoint/><geom type="box" size=".04 .03 .04" mass=".8"
        friction="1"/></body></worldbody><actuator><position joint="lift" kp="3000" kv="60"/>
        <motor joint="left"/><motor joint="right"/></actuator>
        <keyframe><key qpos="0 .002 .002 0 0 .49 1 0 0 0" ctrl="0 25 25"/></keyframe>""",
        {"n": (1, 100)},
        lambda motion: float(np.ptp((motion.body("block") - motion.body("hand"))[100:, 2]) / 0.08),
        0.1,
    ),
    case(
        "solver",
        "a motion platform whose legs are given one iteration",
        """<option timestep=".004" solver="PGS" iterations="<<n>>"/><default>
        <geom contype="0" conaffinity="0"/></default><worldbody>
        <body name="deck" pos="0 0 1"><freejoint/><geom type="cylinder" size=".5 .03" mass="40"/>
        <geom type="box" size=".3 .3 .4" pos=".1 0 .45" mass="180"/>
        <site name="d0" pos=".45 0 0"/><site name="d1" pos="-.225 .39 0"/>
        <site name="d2" pos="-.225 -.39 0"/></body>
        <body pos=".7 0 0"><joint axis="0 1 0" damping="3"/><geom type="capsule" size=".03"
        fromto="0 0 0 -.25 0 1" mass="5"/><site name="l0" pos="-.25 0 1"/></body>
        <body pos="-.35 .606 0" euler="0 0 120"><joint axis="0 1 0" damping="3"/><geom
        type="capsule" size=".03" fromto="0 0 0 -.25 0 1" mass="5"/>
        <site name="l1" pos="-.25 0 1"/></body>
        <body pos="-.35 -.606 0" euler="0 0 240"><joint axis="0 1 0" damping="3"/><geom
        type="capsule" size=".03" fromto="0 0 0 -.25 0 1" mass="5"/>
        <site name="l2" pos="-.25 0 1"/></body></worldbody><equality>
        <connect site1="d0" site2="l0"/><connect site1="d1" site2="l1"/>
        <connect site1="d2" site2="l2"/></equality>""",
        {"n": (1, 100)},
        lambda motion: max(opened(f"d{k}", f"l{k}")(motion) for k in range(3)) / 0.5,
        0.03,
    ),
    case(
        "solver",
        "a string of pearls that one sweep of a solver cannot hold",
        f"""<option timestep=".004" solver="PGS" iterations="<<n>>">
        <flag warmstart="disable"/></option><default><tendon solreflimit=".01 1"
        solimplimit=".98 .99 .001"/></default><worldbody><site name="clasp" pos="0 0 2"/>{_PEARLS}
        <body name="pendant" pos="0 0 1"><freejoint/><geom type="ellipsoid" size=".04 .02 .05"
        mass="2"/><site name="p9"/></body></worldbody><tendon>
        <spatial limited="true" range="0 .1"><site site="clasp"/>
        <site site="p0"/></spatial>{_STRINGS}</tendon>""",
        {"n": (1, 100)},
        lambda motion: float(motion.length[motion.end].max() / 0.1 - 1),
        0.3,
    ),
    case(
        "solver",
        "bearing balls in a tube that a load drives into one another",
        f"""<option timestep=".004" solver="PGS" iterations="<<n>>" cone="elliptic">
        <flag warmstart="disable"/></option><default><geom solref=".01 1"
        solimp=".99 .999 .001"/></default><worldbody><geom type="plane" size="1 1 .1"/>{_BALLS}
        <body name="load" pos="0 0 .42">
        <joint type="slide" axis="0 0 1"/><geom type="box" size=".15 .15 .1" mass="10"/></body>
        </worldbody>""",
        {"n": (2, 200)},
        lambda motion: rests_off("load", 0.42)(motion) / 0.04,
        0.2,
    ),
    case(
        "solver",
        "a boom of bolted bays that a loose tolerance keeps shaking",
        f"""<option timestep=".004" solver="CG" tolerance="<<t>>"/><default>
        <equality solref=".01 1" solimp=".999 .9999 .001"/></default><worldbody>
        <site name="wall" pos="0 0 1"/>{_BEAM}</worldbody><equality>
        <weld site1="wall" site2="f0"/>{_BOLTS}</equality>""",
        {"t": (0.1, 1e-8)},
        restless,
        0.1,
    ),
]

_TEETH = "".join(
    f"""<geom type="box" size=".012 .01 .008" pos="{0.105 * np.cos(angle):.4f} 0
    {0.105 * np.sin(angle):.4f}" euler="0 {-np.degrees(angle):.1f} 0" mass=".02"/>"""
    for angle in np.arange(12) * np.pi / 6
)
_DOMINOES = "".join(
    f"""<body name="domino{k}" pos="{0.04 * k:.2f} 0 .05"><freejoint/><geom type="box"
    size=".006 .025 .05" mass=".05"/></body>"""
    for k in range(8)
)
_BOWL = " ".join(
    f"{((row - 7) ** 2 + (column - 7) ** 2) / 98:.4f}" for row in range(15) for column in range(15)
)


SOUND = [
    case(
        "sound",
        "a gel fingertip that spreads over a key",
        """<option timestep="<<h>>" cone="elliptic"/><worldbody>
        <body name="key" pos="0 0 .1"><joint name="key" type="slide" axis="0 0 1" stiffness="400"
        damping="6" range="-.006 .002"/><geom type="box" size=".012 .012 .01" pos="0 0 -.006"
        mass=".01"/></body>
        <body name="finger" pos="0 0 .113"><joint name="finger" type="slide" axis="0 0 1"
        damping="4"/><geom type="capsule" fromto="0 0 .06 0 0 0" size=".009" mass=".06"
        solref=".03 1" solimp="<<soft>> .95 .004 .5 2" priority="1"/></body></worldbody><actuator>
        <motor joint="finger"/></actuator><keyframe><key ctrl="-.3"/></keyframe>""",
        {"h": (0.001,), "soft": (0.3,)},
        lambda motion: float(-motion.joint("finger").min() / 0.018),
        0.8,
    ),
    case(
        "sound",
        "a crossbow that its winder holds drawn",
        """<option timestep="<<h>>" integrator="implicitfast"/><worldbody>
        <body name="bolt" pos="0 0 1"><joint name="draw" type="slide" axis="1 0 0"
        stiffness="2500" damping="20" range="-.4 .05"/><geom type="capsule" fromto="0 0 0 .4 0 0"
        size=".006" mass=".08"/></body></worldbody><actuator>
        <motor joint="draw" ctrlrange="-900 0"/></actuator>
        <keyframe><key qpos="-.25" ctrl="-700"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(np.abs(motion.joint("draw")[motion.end] / (-700 / 2500) - 1).max()),
        0.02,
    ),
    case(
        "sound",
        "three arms on one hub that turn over without a pattern",
        """<option timestep="<<h>>" integrator="RK4"/><default><geom contype="0"/></default>
        <worldbody><body pos="0 0 2"><joint name="hub" axis="0 1 0"/>
        <geom type="cylinder" size=".2 .02" euler="90 0 0" mass="2"/>
        <body pos=".2 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0"
        size=".015" mass=".5"/></body><body pos="-.1 0 .173"><joint axis="0 1 0"/><geom
        type="capsule" fromto="0 0 0 .3 0 0" size=".015" mass=".5"/></body>
        <body pos="-.1 0 -.173"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0"
        size=".015" mass=".5"/></body></body></worldbody>
        <keyframe><key qpos="0 .4 1.2 -2" qvel="6 0 0 0"/></keyframe>""",
        {"h": (0.001,)},
        unbalanced(0.5 * 9.81 * 0.35),
        0.02,
        3.0,
    ),
    case(
        "sound",
        "a curling stone that slides to where friction says",
        """<option timestep="<<h>>" cone="elliptic" impratio="10"/><worldbody>
        <geom type="plane" size="30 3 .1" friction=".02"/><body name="stone" pos="0 0 .0575">
        <freejoint/><geom type="cylinder" size=".145 .0575" mass="19" friction=".02"/></body>
        </worldbody><keyframe><key qvel=".5 0 0 0 0 0"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(
            np.abs(motion.body("stone")[-1, 0] / (0.5**2 / (2 * 0.02 * 9.81)) - 1)
        ),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a table tennis ball that loses a seventh of its height each time",
        """<option timestep="<<h>>"/><worldbody><geom type="box" size=".7 .7 .02" pos="0 0 .76"
        solref="-600000 -40" solimp=".99 .99 .001"/><body name="ball" pos="0 0 1.1"><freejoint/>
        <geom type="sphere" size=".02" mass=".0027" friction=".3" solref="-600000 -40"
        solimp=".99 .99 .001"/></body></worldbody>
        <keyframe><key qvel=".1 0 0 0 20 0"/></keyframe>""",
        {"h": (0.0002,)},
        gained(0.0027 * 9.81 * 0.3),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a gripper that holds an egg with three newtons",
        """<option timestep="<<h>>" cone="elliptic" impratio="20"/><default>
        <geom solref=".01 1"/></default><worldbody><geom type="plane" size="1 1 .1"/>
        <body name="palm" pos="0 0 .4"><joint name="lift" type="slide" axis="0 0 1" damping="30"/>
        <geom type="box" size=".03 .07 .015" pos="0 0 .08" mass=".5"/>
        <body pos="0 -.035 0"><joint name="left" type="slide" axis="0 1 0" damping="10"/>
        <geom type="box" size=".015 .005 .03" mass=".05" friction="1.2" condim="4"/></body>
        <body pos="0 .035 0"><joint name="right" type="slide" axis="0 -1 0" damping="10"/>
        <geom type="box" size=".015 .005 .03" mass=".05" friction="1.2" condim="4"/></body></body>
        <body name="egg" pos="0 0 .4"><freejoint/><geom type="ellipsoid" size=".022 .022 .028"
        mass=".06" friction="1.2" condim="4"/></body></worldbody><actuator>
        <position joint="lift" kp="2000" kv="80"/>
        <position joint="left" kp="400" forcerange="-3 3"/>
        <position joint="right" kp="400" forcerange="-3 3"/></actuator>
        <keyframe><key qpos="0 .008 .008 0 0 .4 1 0 0 0" ctrl=".1 .03 .03"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(np.ptp((motion.body("egg") - motion.body("palm"))[200:, 2]) / 0.056),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a lamp head that a mocap hand holds by a spring of a weld",
        """<option timestep="<<h>>"/><worldbody><body name="hand" mocap="true" pos=".02 0 1">
        <geom type="sphere" size=".02" contype="0" conaffinity="0"/></body>
        <body name="head" pos="0 0 1"><freejoint/><geom type="cylinder" size=".06 .04" mass=".7"
        contype="0" conaffinity="0"/></body></worldbody><equality>
        <weld body1="hand" body2="head" relpose="0 0 0 1 0 0 0" solref=".15 1"/></equality>""",
        {"h": (0.004,)},
        strays(lambda motion: motion.body("head"), 0.1),
        0.1,
    ),
    case(
        "sound",
        "a light curtain that sees a carton through its gap",
        """<option timestep="<<h>>"/><worldbody><geom type="plane" size="3 3 .1" friction=".3"/>
        <geom type="box" size=".02 .02 .3" pos="0 .25 .3" gap=".4"/>
        <geom type="box" size=".02 .02 .3" pos="0 -.25 .3" gap=".4"/>
        <body name="carton" pos="-.3 0 .1"><freejoint/><geom type="box" size=".12 .1 .1" mass="2"
        friction=".3"/></body></worldbody><keyframe><key qvel=".25 0 0 0 0 0"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: rests_off("carton", 0.1)(motion) / 0.1,
        0.05,
    ),
    case(
        "sound",
        "an energy store whose flywheel coasts at six thousand turns",
        """<option timestep="<<h>>"/><worldbody><body pos="0 0 1"><joint name="rotor" axis="0 0 1"
        damping="8"/><geom type="cylinder" size=".5 .15" mass="400"/></body></worldbody>
        <keyframe><key qvel="628"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(
            np.abs(motion.speed("rotor") / (628 * np.exp(-8 / 50 * motion.time)) - 1).max()
        ),
        0.01,
        3.0,
    ),
    case(
        "sound",
        "a silk curtain that settles beside its window",
        """<option timestep="<<h>>" solver="CG" tolerance="1e-8"/><worldbody>
        <flexcomp name="curtain" type="grid" dim="2" count="6 6 1" spacing=".1 .1 .1"
        pos="0 0 1.5" euler="70 0 0" mass=".1" radius=".005"><edge equality="true" solref=".004 1"
        damping=".001"/><contact selfcollide="none"/><pin gridrange="0 5 5 5"/></flexcomp>
        </worldbody>""",
        {"h": (0.002,)},
        lambda motion: float(
            np.linalg.norm(motion.vertex[:, 0] - motion.vertex[:, 5], axis=1).max() / 0.5 - 1
        ),
        0.1,
    ),
    case(
        "sound",
        "pallets that sleep on their rack from the first step",
        """<option timestep="<<h>>"><flag sleep="enable"/></option><worldbody>
        <geom type="plane" size="4 4 .1"/><geom type="box" size=".7 .5 .02" pos="0 0 1"/>
        <body name="pallet" pos="0 0 1.07" sleep="init"><freejoint/><geom type="box"
        size=".6 .4 .05" mass="20"/></body><body pos="2 0 .2"><freejoint/>
        <geom type="sphere" size=".1" mass="1"/></body></worldbody>""",
        {"h": (0.004,)},
        lambda motion: rests_off("pallet", 1.07)(motion) / 0.1,
        0.05,
    ),
    case(
        "sound",
        "a hook block that an active damper calms",
        """<option timestep="<<h>>"/><default><geom contype="0"/></default><worldbody>
        <body name="trolley" pos="0 0 5"><joint name="trolley" type="slide" axis="1 0 0"
        damping="40"/><geom type="box" size=".3 .2 .1" mass="60"/><body name="hook">
        <joint name="sway" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -2" size=".02"
        mass="5"/><geom type="sphere" size=".15" pos="0 0 -2" mass="80"/></body></body></worldbody>
        <actuator><damper joint="sway" kv="220" ctrlrange="0 1"/>
        <position joint="trolley" kp="900" kv="300"/></actuator>
        <keyframe><key qpos="0 .4" ctrl="1 0"/></keyframe>""",
        {"h": (0.002,)},
        strays(lambda motion: motion.qpos, 0.4),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a valve that rides on an eccentric cam",
        """<option timestep="<<h>>"/><default><geom solref=".004 1" condim="1"
        solimp=".99 .999 .001"/></default><worldbody><body pos="0 0 .3">
        <joint name="cam" axis="0 1 0" armature=".01"/><geom type="sphere" size=".04"
        pos=".012 0 0" mass=".5"/></body><body name="valve" pos="0 0 .36">
        <joint name="valve" type="slide" axis="0 0 1" damping="4" stiffness="600"
        springref="-.06"/><geom type="box" size=".05 .02 .02" mass=".15"/></body></worldbody>
        <actuator><velocity joint="cam" kv="2"/></actuator>
        <keyframe><key qvel="10 0" ctrl="10"/></keyframe>""",
        {"h": (0.001,)},
        departs(
            lambda motion: (motion.joint("valve") + 0.012 * np.sin(motion.joint("cam"))) / 0.024,
            lambda _: 0,
        ),
        0.1,
    ),
    case(
        "sound",
        "a ratchet whose pawl holds the load",
        f"""<option timestep="<<h>>"/><default><geom solref=".004 1" friction=".2"/></default>
        <worldbody><body name="wheel" pos="0 0 .5"><joint name="wheel" axis="0 1 0" damping=".02"
        armature=".02"/><geom type="cylinder" size=".1 .01" euler="90 0 0" mass="1" contype="0"
        conaffinity="0"/>{_TEETH}</body><body name="pawl" pos=".25 0 .54">
        <joint name="pawl" axis="0 1 0" damping=".01" stiffness=".5" range="-60 0"
        solreflimit=".004 1" solimplimit=".999 .9999 .001"/>
        <geom type="capsule" fromto="-.02 0 0 -.133 0 -.018" size=".006" mass=".05"/></body>
        </worldbody><actuator><motor joint="wheel"/></actuator><keyframe><key ctrl="<<pull>>"/>
        </keyframe>""",
        {"h": (0.001,), "pull": (-0.8,)},
        lambda motion: float(np.abs(motion.joint("wheel")).max() / (np.pi / 6)),
        2.0,
    ),
    case(
        "sound",
        "a luggage carousel that carries its cases round",
        """<option timestep="<<h>>" cone="elliptic" impratio="10"/><worldbody>
        <body pos="0 0 .4"><joint name="table" axis="0 0 1"/><geom type="cylinder" size="1.5 .03"
        mass="120" friction=".8"/></body><body name="case" pos="1 0 .63"><freejoint name="case"/>
        <geom type="box" size=".2 .3 .2" mass="15"/></body><body pos="-1 .2 .58"><freejoint/>
        <geom type="box" size=".25 .2 .15" mass="9"/></body></worldbody><actuator>
        <velocity joint="table" kv="4000"/></actuator><keyframe><key ctrl=".6"/></keyframe>""",
        {"h": (0.003,)},
        lambda motion: float(
            np.abs(np.linalg.norm(motion.qvel[motion.end, 1:3], axis=1) / 0.6 - 1).max()
        ),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a dog that pulls its lead straight",
        """<option timestep="<<h>>"/><worldbody><geom type="plane" size="9 9 .1"/>
        <site name="post" pos="0 0 .3"/><body name="dog" pos=".5 0 .15">
        <joint name="walk" type="slide" axis="1 0 0" damping="20"/><geom type="capsule"
        fromto="-.2 0 0 .2 0 0" size=".1" mass="12"/><site name="collar" pos="0 0 .15"/></body>
        </worldbody><tendon><spatial name="lead" limited="true" range="0 1.2"><site site="post"/>
        <site site="collar"/></spatial></tendon><actuator><motor joint="walk"/></actuator>
        <keyframe><key ctrl="25"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(max(motion.length.max() / 1.2 - 1, 0)),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a cart whose wheels spin on ice",
        """<option timestep="<<h>>" cone="elliptic"/><default><default class="wheel"><geom
        type="cylinder" size=".1 .03" euler="90 0 0" mass="1" friction=".05"/></default></default>
        <worldbody><geom type="plane" size="30 9 .1" friction=".05"/>
        <body name="cart" pos="0 0 .1"><freejoint/><geom type="box" size=".3 .15 .05" mass="20"/>
        <body pos=".25 .2 0"><joint name="fl" axis="0 1 0"/><geom class="wheel"/></body>
        <body pos=".25 -.2 0"><joint name="fr" axis="0 1 0"/><geom class="wheel"/></body>
        <body pos="-.25 .2 0"><joint name="rl" axis="0 1 0"/><geom class="wheel"/></body>
        <body pos="-.25 -.2 0"><joint name="rr" axis="0 1 0"/><geom class="wheel"/></body></body>
        </worldbody><actuator><velocity joint="fl" kv="1"/><velocity joint="fr" kv="1"/>
        <velocity joint="rl" kv="1"/><velocity joint="rr" kv="1"/></actuator><keyframe>
        <key qpos="0 0 .1 1 0 0 0 0 0 0 0" ctrl="15 15 15 15"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(np.abs(motion.qvel[-1, 0] / (0.05 * 9.81 * motion.time[-1]) - 1)),
        0.1,
    ),
    case(
        "sound",
        "a two wheeled robot that drives in a circle",
        """<option timestep="<<h>>" cone="elliptic" impratio="10"/><worldbody>
        <geom type="plane" size="9 9 .1"/><body name="robot" pos="0 0 .06"><freejoint/>
        <geom type="cylinder" size=".14 .03" pos="0 0 .03" mass="3" contype="0" conaffinity="0"/>
        <geom type="sphere" size=".02" pos="-.11 0 -.04" mass=".1" friction=".01" priority="1"/>
        <body pos="0.02 .12 0"><joint name="left" axis="0 1 0" armature=".005"/>
        <geom type="ellipsoid" size=".06 .06 .02" euler="90 0 0" mass=".3"/></body>
        <body pos="0.02 -.12 0"><joint name="right" axis="0 1 0" armature=".005"/>
        <geom type="ellipsoid" size=".06 .06 .02" euler="90 0 0" mass=".3"/></body></body>
        </worldbody><actuator><velocity joint="left" kv=".3"/><velocity joint="right" kv=".3"/>
        </actuator><keyframe><key qpos="0 0 .06 1 0 0 0 0 0" ctrl="4 6"/></keyframe>""",
        {"h": (0.002,)},
        strays(lambda motion: motion.body("robot"), 0.3),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a quadrotor that hangs on its four motors",
        """<option timestep="<<h>>" density="1.2" viscosity="2e-5"/><worldbody>
        <geom type="plane" size="5 5 .1"/><body name="drone" pos="0 0 1"><freejoint/>
        <geom type="box" size=".06 .06 .03" mass=".8"/><geom type="capsule"
        fromto="-.15 -.15 0 .15 .15 0" size=".01" mass=".1"/><geom type="capsule"
        fromto="-.15 .15 0 .15 -.15 0" size=".01" mass=".1"/><site name="m0" pos=".15 .15 0"/>
        <site name="m1" pos="-.15 .15 0"/><site name="m2" pos="-.15 -.15 0"/>
        <site name="m3" pos=".15 -.15 0"/></body></worldbody><actuator>
        <motor site="m0" gear="0 0 1 0 0 .02"/><motor site="m1" gear="0 0 1 0 0 -.02"/>
        <motor site="m2" gear="0 0 1 0 0 .02"/><motor site="m3" gear="0 0 1 0 0 -.02"/></actuator>
        <keyframe><key ctrl="2.4525 2.4525 2.4525 2.4525" qpos="0 0 1 1 0 0 0"/></keyframe>""",
        {"h": (0.005,)},
        rests_off("drone", 1),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a fire door that its closer lays against the frame",
        """<option timestep="<<h>>" integrator="implicitfast"/><worldbody>
        <geom name="frame" type="box" size=".03 .02 1" pos=".93 .045 1"/>
        <body name="door" pos="0 0 1"><joint name="hinge" axis="0 0 1" stiffness="25"
        springref="30" damping="30"/><geom type="box" size=".45 .02 .98" pos=".46 0 0" mass="35"/>
        </body></worldbody><keyframe><key qpos="-.6"/></keyframe>""",
        {"h": (0.004,)},
        strays(lambda motion: motion.joint("hinge"), 0.6),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a folded ruler whose leaves lie in one another",
        """<option timestep="<<h>>"/><default><joint axis="0 1 0" damping=".01" stiffness="5"/>
        <geom type="box" size=".1 .012 .003" mass=".03"/></default><worldbody>
        <geom type="plane" size="2 2 .1"/><body name="a" pos="0 0 .8">
        <geom pos=".1 0 0"/><body name="b" pos=".2 0 0"><joint name="ab"/><geom pos="-.1 0 0"/>
        <body name="c" pos="-.2 0 0"><joint name="bc"/><geom pos=".1 0 0"/></body></body></body>
        </worldbody><contact><exclude body1="a" body2="b"/><exclude body1="b" body2="c"/>
        <exclude body1="a" body2="c"/></contact>""",
        {"h": (0.002,)},
        lambda motion: float(np.abs(motion.qpos).max()),
        0.05,
    ),
    case(
        "sound",
        "a car jack whose screw lifts a corner",
        """<option timestep="<<h>>"/><default><geom contype="0"/></default><worldbody>
        <body pos="0 0 .2"><joint name="screw" axis="0 0 1" armature=".02" damping=".05"/>
        <geom type="cylinder" size=".012 .15" mass=".8"/></body><body pos="0 0 .4">
        <joint name="lift" type="slide" axis="0 0 1"/><geom type="box" size=".1 .1 .05"
        mass="350"/></body></worldbody><equality><joint joint1="lift" joint2="screw"
        polycoef="0 .0008 0 0 0" solref=".004 1" solimp=".9999 .99999 .001"/></equality><actuator>
        <velocity joint="screw" kv="1.5"/></actuator><keyframe><key ctrl="12"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: slipped(0.0008, "screw", "lift")(motion) / 0.02,
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a marble that rolls about in a wide bowl",
        f"""<option timestep="<<h>>"/><asset><hfield name="bowl" nrow="15" ncol="15"
        size=".5 .5 .15 .05" elevation="{_BOWL}"/></asset><worldbody><geom type="hfield"
        hfield="bowl" solref=".006 1"/><body name="marble" pos=".3 .05 .075"><freejoint/>
        <geom type="sphere" size=".03" mass=".1" solref=".006 1"/></body></worldbody>""",
        {"h": (0.002,)},
        gained(0.1 * 9.81 * 0.1),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a balloon that strains at its string",
        """<option timestep="<<h>>" density="1.2" viscosity="2e-5"/><worldbody>
        <geom type="plane" size="3 3 .1"/><site name="peg" pos="0 0 0"/>
        <body name="balloon" pos="0 0 .7" gravcomp="1.8"><freejoint/><geom type="ellipsoid"
        size=".18 .18 .22" mass=".02" fluidshape="ellipsoid"/><site name="knot" pos="0 0 -.22"/>
        </body></worldbody><tendon><spatial name="string" limited="true" range="0 1">
        <site site="peg"/><site site="knot"/></spatial></tendon>""",
        {"h": (0.002,)},
        lambda motion: float(np.abs(motion.length[motion.end] - 1).max()),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a sheet of glass that suction pads carry under them",
        """<option timestep="<<h>>" cone="elliptic" impratio="10"/><worldbody>
        <body name="frame" pos="0 0 1"><joint name="lift" type="slide" axis="0 0 1" damping="60"/>
        <geom type="box" size=".3 .3 .02" pos="0 0 .06" mass="8" contype="0" conaffinity="0"/>
        <body name="cups"><geom type="cylinder" size=".04 .01" pos=".2 .2 0" mass=".2"/>
        <geom type="cylinder" size=".04 .01" pos="-.2 .2 0" mass=".2"/>
        <geom type="cylinder" size=".04 .01" pos="-.2 -.2 0" mass=".2"/>
        <geom type="cylinder" size=".04 .01" pos=".2 -.2 0" mass=".2"/></body></body>
        <body name="pane" pos="0 0 .984"><freejoint/><geom type="box" size=".4 .4 .006" mass="5"
        gap=".002"/></body></worldbody><actuator><position joint="lift" kp="6000" kv="500"/>
        <adhesion body="cups" gain="300" ctrlrange="0 1"/></actuator>
        <keyframe><key qpos="0 0 0 .984 1 0 0 0" ctrl=".05 1"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(
            np.abs((motion.body("frame") - motion.body("pane"))[250:, 2] - 0.016).max() / 0.012
        ),
        0.2,
    ),
    case(
        "sound",
        "a rubber buffer that a press squeezes on purpose",
        """<option timestep="<<h>>"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body name="buffer" pos="0 0 .05"><joint name="buffer" type="slide" axis="0 0 1"/>
        <geom type="sphere" size=".05" mass=".4" solref=".03 1" solimp=".5 .9 .03 .5 2"
        priority="1"/></body><body name="ram" pos="0 0 .125"><joint name="ram" type="slide"
        axis="0 0 1" damping="60"/><geom type="box" size=".1 .1 .02" mass="1"/></body></worldbody>
        <actuator><motor joint="ram"/></actuator><keyframe><key ctrl="-12"/></keyframe>""",
        {"h": (0.001,)},
        strays(lambda motion: motion.qpos, 0.1),
        0.05,
    ),
    case(
        "sound",
        "a croquet ball that slides until it rolls",
        """<option timestep="<<h>>"/><worldbody>
        <geom type="plane" size="30 3 .1" friction=".2"/><body name="ball" pos="0 0 .046">
        <freejoint/><geom type="sphere" size=".046" mass=".45" friction=".2"/></body></worldbody>
        <keyframe><key qvel=".4 0 0 0 0 0"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(np.abs(motion.qvel[motion.end, 0] / (0.4 * 5 / 7) - 1).max()),
        0.05,
    ),
    case(
        "sound",
        "a row of dominoes that one push brings down",
        f"""<option timestep="<<h>>" cone="elliptic" impratio="5"/><default>
        <geom solref=".004 1"/></default><worldbody><geom type="plane" size="2 2 .1"/>
        {_DOMINOES}</worldbody>
        <keyframe><key qvel=".2 0 0 0 4 0{" 0 0 0 0 0 0" * 7}"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(
            max(motion.body(f"domino{k}")[motion.end, 2].max() for k in range(8)) / 0.05 > 0.9
        ),
        0.5,
    ),
    case(
        "sound",
        "a fan motor that its own voltage holds to its speed",
        """<option timestep="<<h>>"/><worldbody><body pos="0 0 1"><joint name="fan" axis="1 0 0"/>
        <geom type="cylinder" size=".02 .03" euler="0 90 0" mass=".2"/>
        <geom type="box" size=".003 .15 .02" mass=".05"/></body></worldbody><actuator>
        <dcmotor joint="fan" motorconst=".05 .05" resistance="2" ctrlrange="-24 24"/></actuator>
        <keyframe><key ctrl="6"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(np.abs(motion.speed("fan")[motion.end] / (6 / 0.05) - 1).max()),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a windscreen wiper whose crank turns its linkage",
        """<option timestep="<<h>>"/><default><geom contype="0" conaffinity="0"/></default>
        <worldbody><body><joint name="crank" axis="0 1 0" armature=".005"/><geom type="capsule"
        fromto="0 0 0 0 0 .05" size=".006" mass=".05"/><body pos="0 0 .05">
        <joint axis="0 1 0" damping=".001"/><geom type="capsule" fromto="0 0 0 .3 0 .07"
        size=".005" mass=".1"/><site name="rod" pos=".3 0 .07"/></body></body>
        <body pos=".3 0 0"><joint name="wiper" axis="0 1 0" damping=".02"/><geom type="capsule"
        fromto="0 0 0 0 0 .12" size=".006" mass=".05"/><geom type="capsule" fromto="0 0 0 0 0 .4"
        size=".006" mass=".2"/><site name="pin" pos="0 0 .12"/></body></worldbody><equality>
        <connect site1="rod" site2="pin" solref=".004 1" solimp=".99 .999 .001"/></equality>
        <actuator><velocity joint="crank" kv="2"/></actuator><keyframe><key ctrl="6"/>
        </keyframe>""",
        {"h": (0.001,)},
        lambda motion: float(motion.gap("rod", "pin").max() / 0.05),
        0.05,
        3.0,
    ),
]

HELD_BACK_3 = [
    *ACTUATORS,
    *CONSTRAINTS,
    *PASSING,
    *ENERGY,
    *SUPPORT,
    *SOLVER,
    *SOUND,
]
