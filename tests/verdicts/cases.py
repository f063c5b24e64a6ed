"""The cases of the corpus that rules may be written by."""

import numpy as np
from tests.verdicts.corpus import (
    Case,
    Motion,
    below,
    beyond,
    case,
    opened,
    restless,
    rests_off,
    slipped,
)

_ARM = """
<option timestep="<<h>>"/>
<worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" damping=".05"/>
    <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass=".6"/>
    <body name="fore" pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping=".05"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .25 0 0" mass=".3"/></body></body>
</worldbody>
<actuator><<actuators>></actuator>
<keyframe><key qpos=".2 .3" ctrl="<<ctrl>>"/></keyframe>"""


def _servos(gain: float, damping: float, force: float) -> str:
    return "".join(
        f'<position joint="{joint}" kp="{gain}" kv="{damping}" forcerange="-{force} {force}"/>'
        for joint in ("shoulder", "elbow")
    )


ACTUATORS = [
    case(
        "actuator",
        "servos too stiff for the step",
        _ARM,
        {
            "h": (0.004, 0.004),
            "actuators": (_servos(9000, 0, 40), _servos(20, 0.4, 40)),
            "ctrl": (".2 .3", ".2 .3"),
        },
        restless,
        0.5,
    ),
    case(
        "actuator",
        "velocity loops too strong for the step",
        _ARM,
        {
            "h": (0.005, 0.005),
            "actuators": tuple(
                "".join(
                    f'<velocity joint="{joint}" kv="{gain}" forcerange="-30 30"/>'
                    for joint in ("shoulder", "elbow")
                )
                for gain in (60, 0.6)
            ),
            "ctrl": ("0 0", "0 0"),
        },
        restless,
        3.0,
    ),
    case(
        "actuator",
        "a servo behind a slow filter",
        """<option timestep=".002"/><worldbody>
        <body><joint name="axle" axis="0 0 1"/><geom type="box" size=".2 .02 .02" mass="1"/></body>
        </worldbody><actuator><general joint="axle" dyntype="filter" dynprm="<<lag>>" gainprm="50"
        biastype="affine" biasprm="0 0 -<<kv>>" forcerange="-20 20"/><general name="spring"
        joint="axle" gainprm="0" biastype="affine" biasprm="0 <<kp>> -.02" forcerange="-20 20"/>
        </actuator><keyframe><key qpos=".3" ctrl="0 0"/></keyframe>""",
        {"lag": (0.02, 0.02), "kv": (60, 1), "kp": (-60, -60)},
        restless,
        1.0,
    ),
    case(
        "actuator",
        "a stiff slide within its force limit",
        """<option timestep="<<h>>"/><worldbody>
        <body><joint name="lift" type="slide" axis="0 0 1"/><geom size=".05" mass="2"/></body>
        </worldbody><actuator><position joint="lift" kp="<<kp>>" kv="<<kv>>"
        forcerange="-200 200"/></actuator>""",
        {"h": (0.002, 0.002), "kp": (4e6, 2000), "kv": (0, 120)},
        restless,
        0.05,
    ),
    case(
        "actuator",
        "a motor that pulls a cable of two pulleys",
        """<option timestep="<<h>>"/><worldbody>
        <body pos="0 0 0"><joint name="a" axis="0 1 0" damping=".002"/>
        <geom type="cylinder" size=".05 .01" euler="90 0 0" mass=".2"/></body>
        <body pos=".3 0 0"><joint name="b" axis="0 1 0" damping=".002"/>
        <geom type="cylinder" size=".05 .01" euler="90 0 0" mass=".2"/></body></worldbody>
        <tendon><fixed name="cable"><joint joint="a" coef=".05"/><joint joint="b" coef=".05"/>
        </fixed></tendon><actuator><position tendon="cable" kp="<<kp>>" kv="<<kv>>"
        forcerange="-50 50"/></actuator><keyframe><key qpos=".1 .1" ctrl=".02"/></keyframe>""",
        {"h": (0.005, 0.005), "kp": (9e4, 200), "kv": (0, 8)},
        restless,
        2.0,
    ),
    case(
        "actuator",
        "a finger that hammers on a block",
        """<option timestep="<<h>>"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body name="finger" pos="-.1 0 .05"><joint name="push" type="slide" axis="1 0 0"/>
        <geom type="capsule" size=".015" fromto="0 0 0 .03 0 0" mass=".05" solref="<<r>>"
        priority="1"/></body><body name="block" pos="0 0 .04"><freejoint/>
        <geom type="box" size=".04 .04 .04" mass="2" friction="1.5"/></body></worldbody>
        <actuator><position joint="push" kp="<<kp>>" kv="<<kv>>" forcerange="-<<f>> <<f>>"/>
        </actuator><keyframe><key qpos="0 0 0 .04 1 0 0 0" ctrl=".03"/></keyframe>""",
        {
            "h": (0.004, 0.001),
            "kp": (200000, 200),
            "kv": (0, 10),
            "f": (40, 12),
            "r": ("-1000000 -10", "-40000 -400"),
        },
        restless,
        0.2,
    ),
    case(
        "actuator",
        "rate feedback on a spinning wheel",
        """<option timestep="<<h>>" gravity="0 0 0"/><worldbody><body><freejoint/>
        <geom type="box" size=".1 .1 .02" mass="1"/><body><joint name="wheel" axis="0 0 1"/>
        <geom type="cylinder" size=".06 .01" mass=".1"/></body></body></worldbody>
        <actuator><velocity joint="wheel" kv="<<kv>>" forcerange="-5 5"/></actuator>
        <keyframe><key qpos="0 0 0 1 0 0 0 0" qvel="0 0 0 .1 0 0 0" ctrl="10"/></keyframe>""",
        {"h": (0.01, 0.01), "kv": (0.2, 0.004)},
        lambda motion: float(np.abs(np.diff(motion.qvel[motion.end, 6])).max()),
        1.0,
    ),
    case(
        "actuator",
        "a leg whose ankle buzzes on the ground",
        """<option timestep="<<h>>"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body pos="0 0 .33"><joint name="z" type="slide" axis="0 0 1"/>
        <geom type="box" size=".08 .08 .03" mass="4"/>
        <body pos="0 0 -.3"><joint name="ankle" axis="0 1 0" range="-40 40" damping=".1"/>
        <geom type="box" size=".08 .03 .015" pos=".02 0 0" mass=".15" friction="1"/></body></body>
        </worldbody><actuator><position joint="ankle" kp="<<kp>>" kv="<<kv>>"
        forcerange="-60 60"/></actuator><keyframe><key qpos="0 .05" ctrl=".05"/></keyframe>""",
        {"h": (0.005, 0.005), "kp": (5000, 2), "kv": (0, 0)},
        restless,
        0.3,
    ),
]

_BOUNCE = """<option timestep="<<h>>" <<wind>>/><worldbody><geom name="floor" type="plane"
size="2 2 .1" solref="<<solref>>"/><body name="ball" pos="0 0 .6" <<ball>>><freejoint/>
<geom size=".05" mass=".5" solref="<<solref>>" priority="1"/></body><<more>></worldbody><<rest>>"""
_IDLE = """<body pos="1 0 .5"><joint name="idle" axis="0 0 1" damping=".1"/>
<geom type="box" size=".1 .02 .02" mass=".1" contype="0" conaffinity="0"/></body>"""


def rises(motion: Motion) -> float:
    """Return how far the ball gets above where it was dropped [m]."""
    return float(motion.body("ball")[:, 2].max() - 0.6)


def _bounce(name: str, wind: str = "", ball: str = "", more: str = "", rest: str = "") -> Case:
    """Return a bounce that is stiff and underdamped for its step, or resolved by it."""
    xml = _BOUNCE
    for key, text in {"wind": wind, "ball": ball, "more": more, "rest": rest}.items():
        xml = xml.replace(f"<<{key}>>", text)
    numbers = {
        "h": (0.004, 0.0005),
        "solref": ("0.0138 0.1809", "0.0138 0.1809"),
    }
    return case("contact", name, xml, numbers, rises, 0.05)


CONTACTS = [
    _bounce(
        "a bounce that gains beside an idle motor",
        more=_IDLE,
        rest='<actuator><motor joint="idle"/></actuator>',
    ),
    _bounce("a bounce that gains with half its weight", ball='gravcomp=".3"'),
    _bounce("a bounce that gains in a breeze", wind='density="1.2" wind=".2 0 0"'),
    case(
        "contact",
        "a stiff box that rattles on its table",
        """<option timestep="<<h>>"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .05" mass="1"
        solref="<<solref>>" priority="1"/></body></worldbody>""",
        {"h": (0.01, 0.002), "solref": ("-40000 -20", "-40000 -400")},
        restless,
        0.05,
    ),
    case(
        "contact",
        "a pinched block that chatters",
        """<option timestep="<<h>>" cone="elliptic"/><worldbody>
        <body pos="-.06 0 0"><joint name="left" type="slide" axis="1 0 0"/>
        <geom type="box" size=".01 .03 .03" mass=".1" friction="1" solref="<<solref>>"/></body>
        <body pos=".06 0 0"><joint name="right" type="slide" axis="-1 0 0"/>
        <geom type="box" size=".01 .03 .03" mass=".1" friction="1" solref="<<solref>>"/></body>
        <body name="block"><freejoint/><geom type="box" size=".045 .03 .03" mass=".3" friction="1"
        solref="<<solref>>"/></body></worldbody><actuator><motor joint="left"/>
        <motor joint="right"/></actuator><keyframe><key ctrl="15 15" qpos="0 0 0 0 0 1 0 0 0"/>
        </keyframe>""",
        {"h": (0.005, 0.002), "solref": ("-250000 -15", "-25000 -300")},
        restless,
        0.05,
    ),
]

_LOOP = """<option timestep=".002" <<solver>>/><worldbody>
<body name="left"><joint name="l" axis="0 1 0" damping=".02"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".2" contype="0" conaffinity="0"/>
<body pos="0 0 -.2"><joint axis="0 1 0" damping=".02"/>
<geom type="capsule" size=".01" fromto="0 0 0 .2 0 0" mass="<<load>>" contype="0" conaffinity="0"/>
<site name="tip" pos=".2 0 0"/></body></body>
<body name="right" pos=".2 0 0"><joint name="r" axis="0 1 0" damping=".02"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".2" contype="0" conaffinity="0"/>
<site name="eye" pos="0 0 -.2"/></body></worldbody>
<equality><connect site1="tip" site2="eye" solref="<<solref>>"/></equality>
<keyframe><key qvel=".5 0 0"/></keyframe>"""

CONSTRAINTS = [
    case(
        "constraint",
        "a four-bar loop that opens under its load",
        _LOOP,
        {"solver": ("", ""), "load": (40, 1), "solref": (".12 1", ".02 1")},
        opened("tip", "eye"),
        0.02,
    ),
    case(
        "constraint",
        "a loop whose solver stops after one iteration",
        """<option timestep=".004" solver="PGS" iterations="<<n>>" tolerance="0"/><worldbody>
        <body name="b1"><joint axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 .1 0 0"
        mass=".1"/><body pos=".1 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".01"
        fromto="0 0 0 .1 0 0" mass=".1"/><body pos=".1 0 0"><joint axis="0 1 0"/><geom
        type="capsule" size=".01" fromto="0 0 0 .1 0 0" mass="5"/><site name="end" pos=".1 0 0"/>
        <body pos=".1 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".01"
        fromto="0 0 0 .1 0 0" mass=".1"/><site name="far" pos=".1 0 0"/></body></body></body></body>
        <site name="wall" pos=".38 0 0"/></worldbody>
        <equality><connect site1="far" site2="wall"/></equality>
        <keyframe><key qpos=".3176 0 -.6351 0"/></keyframe>""",
        {"n": (1, 200)},
        opened("far", "wall"),
        0.012,
    ),
    case(
        "constraint",
        "a shelf whose weld sags",
        """<option timestep=".002"/><worldbody><body name="wall" pos="0 0 .5"><geom type="box"
        size=".02 .2 .2" contype="0" conaffinity="0"/><site name="mount" pos=".4 0 0"/></body>
        <body name="shelf" pos=".2 0 .5"><freejoint/><geom type="box" size=".2 .1 .01" mass="<<m>>"
        contype="0" conaffinity="0"/><site name="edge" pos=".2 0 0"/></body></worldbody>
        <equality><weld body1="wall" body2="shelf" solref="<<solref>>"/></equality>""",
        {"m": (8, 8), "solref": (".4 1", ".01 1")},
        opened("edge", "mount"),
        0.03,
    ),
    case(
        "constraint",
        "gears that slip under torque",
        """<option timestep=".002"/><worldbody><body><joint name="motor" axis="0 1 0"
        damping=".05"/><geom type="cylinder" size=".03 .01" mass=".1" euler="90 0 0"/></body>
        <body pos=".2 0 0"><joint name="drum" axis="0 1 0" damping="1"/><geom type="cylinder"
        size=".1 .02" mass="2" euler="90 0 0"/><geom size=".03" pos=".1 0 0" mass="4"/></body>
        </worldbody><equality><joint joint1="drum" joint2="motor" polycoef="0 .25 0 0 0"
        solref="<<solref>>" solimp="<<solimp>>"/></equality>""",
        {"solref": (".3 1", ".01 1"), "solimp": (".5 .5 .001", ".9 .95 .001")},
        slipped(0.25, "motor", "drum"),
        0.05,
    ),
    case(
        "constraint",
        "a rack that runs over its pinion",
        """<option timestep=".002"/><worldbody><body><joint name="rack" type="slide" axis="0 0 1"/>
        <geom type="box" size=".02 .02 .2" mass="6" contype="0" conaffinity="0"/></body>
        <body pos=".1 0 0"><joint name="pinion" axis="0 1 0" armature=".05"/><geom type="cylinder"
        size=".05 .01" euler="90 0 0" mass=".3" contype="0" conaffinity="0"/></body></worldbody>
        <equality><joint joint1="rack" joint2="pinion" polycoef="0 .05 0 0 0" solref="<<solref>>"/>
        </equality>""",
        {"solref": (".6 1", ".01 1")},
        slipped(0.05, "pinion", "rack"),
        0.03,
    ),
    case(
        "constraint",
        "a knee that is pushed through its stop",
        """<option timestep=".002"/><worldbody><body><joint name="knee" axis="0 1 0" limited="true"
        range="-60 60" damping=".1" solreflimit="<<solref>>"/><geom type="capsule" size=".03"
        fromto="0 0 0 .4 0 0" mass="2"/></body></worldbody><actuator><motor joint="knee" gear="30"/>
        </actuator><keyframe><key ctrl="1"/></keyframe>""",
        {"solref": (".2 1", ".01 1")},
        beyond("knee", -np.pi / 3, np.pi / 3),
        0.1,
    ),
    case(
        "constraint",
        "a drawer that is torn out of its rails",
        """<option timestep=".002"/><worldbody><body><joint name="drawer" type="slide" axis="1 0 0"
        limited="true" range="0 .3" damping="30" solreflimit="<<solref>>"/><geom type="box"
        size=".2 .2 .05" mass="3"/></body></worldbody><actuator><motor joint="drawer"/></actuator>
        <keyframe><key ctrl="80"/></keyframe>""",
        {"solref": (".4 1", ".01 1")},
        beyond("drawer", 0, 0.3),
        0.1,
    ),
    case(
        "constraint",
        "a rope that stretches under its load",
        """<option timestep=".002"/><worldbody><site name="top" pos="0 0 1"/><body name="load"
        pos="0 0 .4"><freejoint/><geom size=".06" mass="20"/><site name="hook" pos="0 0 .06"/>
        </body></worldbody><tendon><spatial name="rope" limited="true" range="0 .6"
        solreflimit="<<solref>>"><site site="top"/><site site="hook"/></spatial></tendon>""",
        {"solref": (".6 1", ".02 1")},
        lambda motion: float((motion.length[motion.end, 0].max() - 0.6) / 0.6),
        0.1,
    ),
    case(
        "constraint",
        "a shoulder that leaves its socket's cone",
        """<option timestep=".002"/><worldbody><body pos="0 0 1"><joint name="shoulder" type="ball"
        limited="true" range="0 45" damping=".05" solreflimit="<<solref>>"/><geom type="capsule"
        size=".03" fromto="0 0 0 0 0 .4" mass="3"/></body></worldbody>
        <keyframe><key qvel="0 .5 0"/></keyframe>""",
        {"solref": (".4 1", ".01 1")},
        lambda motion: float(
            (2 * np.arccos(np.clip(np.abs(motion.qpos[:, 0]), 0, 1)).max() - np.pi / 4)
            / (np.pi / 4)
        ),
        0.2,
    ),
    case(
        "constraint",
        "two arms that share a starved weld",
        """<option timestep=".005" solver="CG" iterations="<<n>>" ls_iterations="<<ls>>"
        tolerance="0"/><default><geom contype="0" conaffinity="0"/>
        </default><worldbody>
        <body pos="-.4 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".02"
        fromto="0 0 0 .2 0 0" mass=".1"/><body pos=".2 0 0"><joint axis="0 1 0"/><geom
        type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass="6"/><site name="a" pos=".2 0 0"/>
        </body></body><body pos=".4 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".02"
        fromto="0 0 0 -.2 0 0" mass=".1"/><body pos="-.2 0 0"><joint axis="0 1 0"/><geom
        type="capsule" size=".02" fromto="0 0 0 -.2 0 0" mass=".05"/><site name="b" pos="-.2 0 0"/>
        </body></body></worldbody><equality><connect site1="a" site2="b"/></equality>
        <keyframe><key qvel="4 0 -4 0"/></keyframe>""",
        {"n": (1, 100), "ls": (1, 50)},
        opened("a", "b"),
        0.06,
    ),
]

_WALL = """<option timestep="<<h>>" gravity="0 0 0"/>"""

PASSING = [
    case(
        "passing",
        "a slide through a plate",
        f"""{_WALL}<worldbody><geom name="plate" type="box" size=".1 .1 .002"
        solref=".003 1" priority="1"/>
        <body name="ram" pos="0 0 .2"><joint name="z" type="slide" axis="0 0 1"/>
        <geom type="box" size=".02 .02 .01" mass=".5"/></body></worldbody>
        <keyframe><key qvel="-<<v>>"/></keyframe>""",
        {"h": (0.005, 0.0005), "v": (12, 0.5)},
        below("ram", 0.0),
        0.02,
        0.6,
    ),
    case(
        "passing",
        "a rod that swings through a peg",
        f"""{_WALL}<worldbody><geom name="peg" type="capsule" size=".01" fromto=".3 0 -.2 .3 0 .2"/>
        <body name="rod"><joint name="swing" axis="0 0 1"/><geom type="capsule" size=".01"
        fromto="0 .05 0 0 .4 0" mass=".4"/><body name="tip" pos="0 .4 0"/></body></worldbody>
        <keyframe><key qvel="-<<v>>"/></keyframe>""",
        {"h": (0.004, 0.0005), "v": (50, 2)},
        below("tip", -0.02, axis=1),
        0.05,
        0.9,
    ),
    case(
        "passing",
        "a piston that passes a resting ball",
        f"""{_WALL}<worldbody><body name="piston" pos="0 0 -.3"><joint name="z" type="slide"
        axis="0 0 1"/><geom type="cylinder" size=".1 .002" mass="50"
        solref=".004 1" priority="1"/></body>
        <body name="ball" pos="0 0 .02"><freejoint/><geom size=".02" mass=".05"/></body>
        </worldbody><keyframe><key qpos="0 0 0 .02 1 0 0 0"
        qvel="<<v>> 0 0 0 0 0 0"/></keyframe>""",
        {"h": (0.005, 0.001), "v": (11, 0.4)},
        lambda motion: float((motion.body("piston")[:, 2] - motion.body("ball")[:, 2]).max()),
        0.02,
        0.9,
    ),
    case(
        "passing",
        "an egg shot through a plate",
        f"""{_WALL}<worldbody><geom name="plate" type="box" size=".2 .2 .002"/>
        <body name="egg" pos="0 0 .3"><freejoint/><geom type="ellipsoid" size=".02 .02 .03"
        mass=".1"/></body></worldbody><keyframe><key qpos="0 0 .3 1 0 0 0"
        qvel="0 0 -<<v>> 0 0 0"/></keyframe>""",
        {"h": (0.004, 0.0005), "v": (25, 0.6)},
        below("egg", 0.0),
        0.05,
        0.9,
    ),
    case(
        "passing",
        "a dart so fast that no step touches",
        f"""{_WALL}<worldbody><geom name="plate" type="box" size=".2 .2 .005"/>
        <body name="dart" pos="0 0 .5"><freejoint/><geom type="capsule" size=".004"
        fromto="0 0 -.02 0 0 .02" mass=".02"/></body></worldbody><keyframe>
        <key qpos="0 0 .51 1 0 0 0" qvel="0 0 -<<v>> 0 0 0"/></keyframe>""",
        {"h": (0.002, 0.0005), "v": (83, 0.8)},
        below("dart", 0.0),
        0.05,
        0.9,
    ),
    case(
        "passing",
        "a block through a wall of triangles",
        f"""{_WALL}<asset><mesh name="panel" vertex="-.2 -.2 -.002 .2 -.2 -.002 .2 .2 -.002
        -.2 .2 -.002 -.2 -.2 .002 .2 -.2 .002 .2 .2 .002 -.2 .2 .002"/></asset><worldbody>
        <geom name="panel" type="mesh" mesh="panel"
        solref=".003 1" priority="1"/><body name="block" pos="0 0 .25"><freejoint/>
        <geom type="box" size=".02 .02 .02" mass=".2"/></body></worldbody>
        <keyframe><key qpos="0 0 .25 1 0 0 0" qvel="0 0 -<<v>> 0 0 0"/></keyframe>""",
        {"h": (0.005, 0.0005), "v": (18, 0.5)},
        below("block", 0.0),
        0.05,
        0.9,
    ),
    case(
        "passing",
        "a stone through a height field",
        f"""{_WALL}<asset><hfield name="hills" nrow="5" ncol="5" size=".5 .5 .02 .01"
        elevation="0 0 0 0 0 0 1 1 1 0 0 1 1 1 0 0 1 1 1 0 0 0 0 0 0"/></asset><worldbody>
        <geom name="hills" type="hfield" hfield="hills"/><body name="stone" pos="0 0 .4">
        <freejoint/><geom size=".02" mass=".2"/></body></worldbody><keyframe>
        <key qpos="0 0 .4 1 0 0 0" qvel="0 0 -<<v>> 0 0 0"/></keyframe>""",
        {"h": (0.005, 0.0005), "v": (30, 0.6)},
        below("stone", -0.03),
        0.05,
        0.9,
    ),
    case(
        "passing",
        "two discs that change places",
        f"""{_WALL}<worldbody><body name="a" pos="-.2 0 0"><freejoint/><geom type="cylinder"
        size=".05 .005" euler="0 90 0" mass=".1"/></body><body name="b" pos=".2 0 0"><freejoint/>
        <geom type="cylinder" size=".05 .005" euler="0 90 0" mass=".1"/></body></worldbody>
        <keyframe><key qpos="-.2 0 0 1 0 0 0 .2 0 0 1 0 0 0"
        qvel="<<v>> 0 0 0 0 0 -<<v>> 0 0 0 0 0"/></keyframe>""",
        {"h": (0.005, 0.0005), "v": (9, 0.3)},
        lambda motion: float((motion.body("a")[:, 0] - motion.body("b")[:, 0]).max()),
        0.05,
        0.9,
    ),
    case(
        "passing",
        "a bead pressed through a soft membrane plate",
        """<option timestep=".001"/><worldbody><geom name="plate" type="box" size=".2 .2 .003"
        pos="0 0 .2" solref="<<solref>>" priority="1"/><body name="bead" pos="0 0 .25"><freejoint/>
        <geom size=".012" mass="<<m>>"/></body></worldbody>""",
        {"solref": (".5 1", ".01 1"), "m": (1, 1)},
        below("bead", 0.19),
        0.05,
        0.6,
    ),
]

LOSSES = [
    case(
        "loss",
        "a flywheel that an implicit integrator brakes",
        """<option timestep="<<h>>" integrator="implicitfast" gravity="0 0 0"/><worldbody>
        <body><joint name="x" type="slide" axis="1 0 0" stiffness="4000"/><geom size=".05"
        mass="1" contype="0" conaffinity="0"/></body></worldbody>
        <keyframe><key qpos=".1"/></keyframe><custom><numeric name="nothing" data="0"/></custom>""",
        {"h": (0.04, 0.001)},
        lambda motion: abs(
            float(motion.energy[motion.end].max() / motion.energy[: len(motion.energy) // 4].max())
            - 1
        ),
        0.2,
    ),
    case(
        "loss",
        "a spinning plate whose energy grows with the step",
        """<option timestep="<<h>>" integrator="Euler" gravity="0 0 0"/><worldbody>
        <body><freejoint/><geom type="box" size=".2 .1 .01" mass="1"/></body></worldbody>
        <keyframe><key qpos="0 0 0 1 0 0 0" qvel="0 0 0 2 12 1"/></keyframe>""",
        {"h": (0.01, 0.0001)},
        lambda motion: float(abs(motion.energy[-1] / motion.energy[0] - 1)),
        0.2,
        4.0,
    ),
    case(
        "loss",
        "a double pendulum that gains by its step",
        """<option timestep="<<h>>"/><worldbody><body><joint axis="0 1 0"/><geom type="capsule"
        size=".02" fromto="0 0 0 .3 0 0" mass="1" contype="0" conaffinity="0"/><body pos=".3 0 0">
        <joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"
        contype="0" conaffinity="0"/></body></body></worldbody>""",
        {"h": (0.02, 0.0001)},
        lambda motion: float(np.ptp(motion.energy) / 5.886),
        0.1,
        4.0,
    ),
]

SUPPORT = [
    case(
        "support",
        "a box that rests on its margin",
        """<option timestep=".002"/><worldbody><geom type="plane" size="1 1 .1"
        margin="<<margin>>"/><body name="box" pos="0 0 .12"><freejoint/><geom type="box"
        size=".03 .03 .03" mass=".4" solref="<<solref>>"/></body></worldbody>""",
        {"margin": (0.03, 0), "solref": (".02 1", ".02 1")},
        rests_off("box", 0.03),
        0.003,
    ),
    case(
        "support",
        "a ball that sinks to its middle",
        """<option timestep=".002"/><worldbody><geom type="plane" size="1 1 .1"/><body name="ball"
        pos="0 0 .012"><freejoint/><geom size=".01" mass=".01" solref="<<solref>>"
        priority="1"/></body></worldbody>""",
        {"solref": (".12 1", ".01 1")},
        rests_off("ball", 0.01),
        0.002,
    ),
    case(
        "support",
        "a light crate under a heavy one",
        """<option timestep=".002"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body name="light" pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/>
        </body><body name="heavy" pos=".0003 .0002 .15"><freejoint/><geom type="box"
        size=".05 .05 .05" mass="<<m>>"/></body></worldbody>""",
        {"m": (1000, 3)},
        rests_off("heavy", 0.15),
        0.02,
        4.0,
    ),
    case(
        "support",
        "a tower that collapses at its step",
        "<option timestep='<<h>>'/><worldbody><geom type='plane' size='1 1 .1'/>"
        + "".join(
            f"<body name='b{k}' pos='{0.0007 * (-1) ** k} {0.0005 * (k % 3 - 1)} {0.05 + 0.1 * k}'>"
            "<freejoint/><geom type='box' size='.05 .05 .05' mass='1'/></body>"
            for k in range(10)
        )
        + "</worldbody>",
        {"h": (0.02, 0.002)},
        rests_off("b9", 0.95),
        0.1,
        4.0,
    ),
    case(
        "support",
        "a lid that falls asleep in mid-air",
        """<option timestep=".002" sleep_tolerance="<<tolerance>>"><flag sleep="enable"/></option>
        <worldbody><geom type="plane" size="1 1 .1"/><body name="lid" pos="0 0 .5" gravcomp="<<g>>">
        <joint name="z" type="slide" axis="0 0 1" damping="<<d>>"/><geom type="box"
        size=".1 .1 .01" mass="1"/></body></worldbody>""",
        {"tolerance": (2.0, 1e-4), "d": (20, 20), "g": (0, 0)},
        rests_off("lid", 0.01),
        0.05,
        4.0,
    ),
    case(
        "support",
        "a pile of beads on a bed as soft as they are small",
        "<option timestep='.001'/><worldbody><geom type='plane' size='1 1 .1'/>"
        + "".join(
            f"<body name='p{k}' pos='{0.0002 * (k % 2)} 0 {0.006 + 0.0105 * k}'>"
            "<joint type='slide' axis='0 0 1'/><geom size='.005' mass='.02' solref='<<solref>>'"
            "/></body>"
            for k in range(5)
        )
        + "</worldbody>",
        {"solref": (".03 1", ".005 1")},
        rests_off("p4", 0.045),
        0.003,
    ),
]

CASES = [*ACTUATORS, *CONTACTS, *CONSTRAINTS, *PASSING, *LOSSES, *SUPPORT]
