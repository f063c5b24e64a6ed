"""A third part, whose author had read no rule; held back at first, open to the rules since.

What is wrong with these models was decided before anything labelled them: by a finer step, by a law
of conservation, by a closed form, or by geometry, against a share of the scene's own size, speed,
weight or energy.
"""

from itertools import pairwise

import numpy as np
from tests.verdicts.corpus import (
    Motion,
    Truth,
    case,
    gained,
    opened,
    rests_off,
    strays,
    trembles,
    unbalanced,
)

ACTUATORS = [
    case(
        "actuator",
        "a bin picking arm whose wrist is driven by too tight a speed loop",
        """<option timestep=".0005"/><default>
        <geom contype="0" conaffinity="0"/></default><worldbody>
        <geom type="plane" size="2 2 .1"/><body name="base" pos="0 0 .3">
        <geom type="cylinder" size=".08 .3" mass="20"/><body name="upper" pos="0 0 .3">
        <joint name="shoulder" axis="0 1 0" damping="2" armature=".3" range="-2 2"/>
        <geom type="capsule" fromto="0 0 0 .4 0 0" size=".05" mass="4"/>
        <body name="fore" pos=".4 0 0"><joint name="elbow" axis="0 1 0" damping="1" armature=".15"
        range="-2.5 2.5"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".04" mass="2.2"/>
        <body name="hand" pos=".3 0 0"><joint name="wrist" axis="1 0 0" armature="<<rotor>>"/>
        <geom type="cylinder" size=".03 .02" euler="0 90 0" mass=".3"/>
        <geom type="box" size=".03 .005 .01" pos=".04 .02 0" mass=".04"/>
        <geom type="box" size=".03 .005 .01" pos=".04 -.02 0" mass=".04"/></body></body></body>
        </body></worldbody><actuator>
        <position joint="shoulder" kp="2500" kv="160" forcerange="-180 180"/>
        <position joint="elbow" kp="1200" kv="70" forcerange="-90 90"/>
        <velocity joint="wrist" kv="<<kv>>" forcerange="-1.5 1.5"/></actuator>
        <keyframe><key qpos="-.6 .9 0" ctrl="-.6 .9 .8"/></keyframe>""",
        {"kv": (6, 0.3), "rotor": (0.0008, 0.0008)},
        trembles(0.8, "wrist"),
        0.1,
    ),
    case(
        "actuator",
        "a finger whose muscles fight faster than its step",
        """<option timestep=".0025" gravity="0 0 0"/><default>
        <geom contype="0" conaffinity="0"/></default><worldbody>
        <geom type="capsule" fromto="-.08 0 0 -.01 0 0" size=".009" mass=".1"/>
        <body name="proximal"><joint name="mcp" axis="0 1 0" damping=".002" armature="<<flesh>>"
        range="-40 80"/><geom type="capsule" fromto="0 0 0 .045 0 0" size=".008" mass=".03"/>
        <body name="middle" pos=".045 0 0"><joint name="pip" axis="0 1 0" damping=".002"
        armature="<<flesh>>" range="-5 100" stiffness=".3"/>
        <geom type="capsule" fromto="0 0 0 .03 0 0" size=".007" mass=".016"/></body></body>
        </worldbody><tendon><fixed name="flexor"><joint joint="mcp" coef="-.011"/>
        <joint joint="pip" coef="-.008"/></fixed><fixed name="extensor">
        <joint joint="mcp" coef=".011"/><joint joint="pip" coef=".006"/></fixed></tendon><actuator>
        <muscle tendon="flexor" force="<<force>>" lengthrange="-.014 .012"/>
        <muscle tendon="extensor" force="<<force>>" lengthrange="-.012 .014"/></actuator>
        <keyframe><key qpos=".1 .15" act=".5 .5" ctrl=".5 .5"/></keyframe>""",
        {"force": (40, 6), "flesh": ("2e-5", "2e-5")},
        trembles(1.0, "mcp", "pip"),
        0.5,
    ),
    case(
        "actuator",
        "a window robot that creeps down under suckers that hold",
        """<option timestep=".004" cone="elliptic" impratio="5"/><default><default class="foot">
        <geom type="cylinder" size=".035 .006" euler="0 90 0" mass=".2" friction="1.1"
        solref="<<pad>>"/></default></default>
        <worldbody><geom name="pane" type="box" size=".01 1 1" pos="-.01 0 1" solref="<<pad>>"/>
        <body name="robot" pos="<<x>> 0 1"><freejoint name="robot"/>
        <geom type="box" size=".025 .12 .12" pos=".04 0 0" mass="6"/>
        <geom class="foot" pos="-.006 .08 .08"/><geom class="foot" pos="-.006 -.08 .08"/>
        <geom class="foot" pos="-.006 .08 -.08"/><geom class="foot" pos="-.006 -.08 -.08"/></body>
        </worldbody><actuator><adhesion body="robot" gain="<<suck>>" ctrlrange="0 1"/></actuator>
        <keyframe><key qpos="<<x>> 0 1 1 0 0 0" ctrl="1"/></keyframe>""",
        {"pad": ("-6000 -4", ".02 1"), "suck": (1500, 1500), "x": (0.0116, 0.0116)},
        lambda motion: float(1 - motion.body("robot")[:, 2].min()) / 0.035,
        0.05,
        3.0,
    ),
    case(
        "actuator",
        "a rudder behind a valve that is quicker than its step",
        """<option timestep=".008" integrator="implicitfast"/><worldbody><body name="blade">
        <joint name="rudder" axis="0 0 1" stiffness="300" damping="45" range="-40 40"/>
        <geom type="box" size=".35 .03 .6" pos="-.25 0 -.6" density="900"/>
        <geom type="cylinder" size=".05 .3" pos="0 0 .3" mass="20"/></body></worldbody>
        <actuator><general joint="rudder" dyntype="filter" dynprm="<<tau>>" gainprm="400"
        ctrlrange="-1 1" actrange="-1 1"/></actuator>
        <keyframe><key act=".05" ctrl=".3"/></keyframe>""",
        {"tau": (0.0032, 0.04)},
        strays(lambda motion: motion.joint("rudder"), 0.4),
        0.1,
        4.0,
    ),
    case(
        "actuator",
        "a standing biped whose ankles throw it over",
        """<option timestep=".005"/><default><joint axis="0 1 0" damping=".5"/>
        <position kp="900" kv="<<kv>>" forcerange="-60 60"/></default><worldbody>
        <geom type="plane" size="5 5 .1"/><body name="pelvis" pos="0 0 .88"><freejoint/>
        <geom type="box" size=".09 .14 .08" mass="9"/>
        <geom type="box" size=".1 .17 .22" pos="0 0 .3" mass="16"/>
        <body name="thigh_l" pos="0 .1 -.05"><joint name="hip_l"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.38" size=".055" mass="5"/>
        <body name="shin_l" pos="0 0 -.38"><joint name="knee_l"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.36" size=".04" mass="3"/>
        <body name="foot_l" pos="0 0 -.39"><joint name="ankle_l"/>
        <geom type="box" size=".11 .045 .02" pos=".02 0 -.04" mass=".9"/></body></body></body>
        <body name="thigh_r" pos="0 -.1 -.05"><joint name="hip_r"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.38" size=".055" mass="5"/>
        <body name="shin_r" pos="0 0 -.38"><joint name="knee_r"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.36" size=".04" mass="3"/>
        <body name="foot_r" pos="0 0 -.39"><joint name="ankle_r"/>
        <geom type="box" size=".11 .045 .02" pos=".02 0 -.04" mass=".9"/></body></body></body>
        </body></worldbody><actuator><position joint="hip_l"/><position joint="knee_l"/>
        <position joint="ankle_l" kv="<<akv>>"/><position joint="hip_r"/>
        <position joint="knee_r"/><position joint="ankle_r" kv="<<akv>>"/></actuator>
        <keyframe><key qpos="0 0 .88 1 0 0 0 0 0 0 0 0 0" ctrl="0 0 0 0 0 0"/></keyframe>""",
        {"kv": (20, 20), "akv": (32, 1.5)},
        lambda motion: float(1 - motion.body("pelvis")[:, 2].min() / 0.88),
        0.2,
        3.0,
    ),
    case(
        "actuator",
        "an excavator whose bucket is damped to and fro",
        """<option timestep=".004"/><default>
        <geom contype="0" conaffinity="0"/></default><worldbody><body name="cab" pos="0 0 1">
        <geom type="box" size="1 .8 .6" mass="4000"/><site name="b0" pos="1.2 0 -.5"/>
        <body name="boom" pos="1 0 0"><joint name="boom" axis="0 -1 0" damping="4000"/>
        <geom type="box" size="1.2 .12 .15" pos="1.2 0 0" mass="420"/>
        <site name="b1" pos="1.1 0 0"/><site name="s0" pos="1.2 0 .3"/>
        <body name="stick" pos="2.4 0 0"><joint name="stick" axis="0 -1 0" damping="900"/>
        <geom type="box" size=".7 .09 .1" pos=".6 0 0" mass="150"/>
        <site name="s1" pos="-.2 0 .25"/><site name="k0" pos=".4 0 .25"/>
        <body name="bucket" pos="1.3 0 0"><joint name="bucket" axis="0 -1 0"/>
        <geom type="box" size=".05 .25 .25" pos="0 0 -.2" mass="35"/>
        <geom type="box" size=".2 .25 .03" pos=".15 0 -.4" mass="25"/>
        <site name="k1" pos="0 0 .22"/></body></body></body></body></worldbody>
        <tendon><spatial name="boom_ram"><site site="b0"/><site site="b1"/></spatial>
        <spatial name="stick_ram"><site site="s0"/><site site="s1"/></spatial>
        <spatial name="bucket_ram"><site site="k0"/><site site="k1"/></spatial></tendon><actuator>
        <position tendon="boom_ram" kp="900000" forcerange="-80000 80000"/>
        <position tendon="stick_ram" kp="500000" forcerange="-50000 50000"/>
        <position tendon="bucket_ram" kp="40000" forcerange="-8000 8000"/>
        <damper tendon="bucket_ram" kv="<<kv>>" ctrlrange="0 1" forcerange="-6000 6000"/></actuator>
        <keyframe><key qpos=".3 -.5 -.2" ctrl="1.25 1.03 .94 1"/></keyframe>""",
        {"kv": (260000, 9000)},
        trembles(1.0, "bucket"),
        0.15,
        3.0,
    ),
]

_BALL = """<body pos="{}"><freejoint/><geom type="sphere" size=".05" mass=".06"/></body>"""
_DRUM_BALLS = "".join(
    _BALL.format(place) for place in ("0 0 .7", ".12 0 .72", "-.12 0 .72", "0 .1 .85", ".1 0 .9")
)
_STAVES = "".join(
    f"""<geom type="box" size=".2 .3 .05" pos="{0.42 * np.sin(angle):.4f} 0
    {-0.42 * np.cos(angle):.4f}" euler="0 {-np.degrees(angle):.1f} 0"/>"""
    for angle in np.arange(8) * np.pi / 4
)
_BILLIARD_BALLS = "".join(
    f"""<body pos="{place} .0286"><freejoint/><geom type="sphere" size=".0286" mass=".17"/>
    </body>"""
    for place in ("-.4 .01", ".2 0", ".26 .032", ".26 -.032", ".32 .07", ".32 0", ".32 -.07")
)
_BREAK = " ".join(["1.3 0 0 0 45 0", *["0 0 0 0 0 0"] * 6])

CONTACTS = [
    case(
        "contact",
        "a floating camera drone that bounces ever faster about its cabin",
        """<option timestep=".005" integrator="implicitfast"/><default><geom solref="<<k>>"/>
        </default><worldbody><geom type="box" size=".05 1 1" pos="-1 0 0"/>
        <geom type="box" size=".05 1 1" pos="1 0 0"/><geom type="box" size="1 .05 1" pos="0 -1 0"/>
        <geom type="box" size="1 .05 1" pos="0 1 0"/><geom type="box" size="1 1 .05" pos="0 0 -1"/>
        <geom type="box" size="1 1 .05" pos="0 0 1"/><body name="drone" gravcomp="1">
        <freejoint name="drone"/><geom type="sphere" size=".15" mass="2" friction=".05"/>
        <body pos="0 0 .1" gravcomp="1"><joint name="gimbal" axis="0 0 1" damping=".01"/>
        <geom type="box" size=".05 .02 .02" mass=".1"/></body></body></worldbody>
        <actuator><position joint="gimbal" kp=".2" kv=".02"/></actuator>
        <keyframe><key qpos="0 0 0 1 0 0 0 0" qvel="1.5 .7 .9 0 0 0 0"/></keyframe>""",
        {"k": ("-110000 0", "-6000 -12")},
        lambda motion: float(np.linalg.norm(motion.qvel[:, :3], axis=1).max() / 1.88 - 1),
        0.2,
        5.0,
    ),
    case(
        "contact",
        "a bingo drum that shoots its balls about",
        f"""<option timestep=".004"/><default><geom solref="<<k>>" friction=".4"/></default>
        <worldbody><body name="drum" pos="0 0 .8"><joint name="drum" axis="0 1 0" damping="1"/>
        {_STAVES}<geom type="box" size=".45 .01 .45" pos="0 .31 0"/>
        <geom type="box" size=".45 .01 .45" pos="0 -.31 0"/>
        <geom type="box" size=".06 .3 .01" pos=".35 0 0"/></body>{_DRUM_BALLS}</worldbody>
        <actuator><velocity joint="drum" kv="40" forcerange="-60 60"/></actuator>
        <keyframe><key ctrl="2" qvel="2"/></keyframe>""",
        {"k": ("-140000 -5", "-15000 -80")},
        lambda motion: float(np.abs(motion.qvel[:, 1:]).reshape(-1, 5, 6)[..., :3].max()) / 5.0,
        1.5,
        4.0,
    ),
    case(
        "contact",
        "a beach ball that outruns the wind between two walls",
        """<option timestep=".01" density="1.2" wind="4 0 0" viscosity="2e-5"/><default>
        <geom solref="<<k>>"/></default><worldbody><geom type="plane" size="9 9 .1"/>
        <geom type="box" size=".2 4 2" pos="3 0 2"/><geom type="box" size=".2 4 2" pos="-3 0 2"/>
        <body name="ball" pos="0 0 1"><freejoint/><geom type="ellipsoid" size=".22 .22 .22"
        mass=".11" friction=".3"/></body></worldbody>""",
        {"k": ("-38000 -2", "-2500 -20")},
        lambda motion: float(
            np.maximum(np.abs(motion.qvel[:, 0]) / 4, np.abs(motion.qvel[:, 2]) / 3.95).max() - 1
        ),
        0.1,
        5.0,
    ),
    case(
        "contact",
        "a parked buggy that hops on its tyres",
        """<option timestep=".004" cone="elliptic"/><default><default class="tyre"><geom
        type="cylinder" size=".11 .035" euler="90 0 0" mass=".9" friction="1" solref="<<tyre>>"/>
        </default><default class="spring"><joint type="slide" axis="0 0 1" stiffness="1800"
        damping="60" range="-.06 .06"/></default></default><worldbody>
        <geom type="plane" size="9 9 .1" solref="<<tyre>>"/><body name="chassis" pos="0 0 .17">
        <freejoint/><geom type="box" size=".32 .14 .05" mass="14"/>
        <geom type="box" size=".12 .1 .06" pos="-.08 0 .1" mass="3"/>
        <body pos=".24 .19 -.06"><joint class="spring"/><body><joint name="fl" axis="0 1 0"
        damping=".05"/><geom class="tyre"/></body><geom type="sphere" size=".02" mass=".3"
        contype="0" conaffinity="0"/></body>
        <body pos=".24 -.19 -.06"><joint class="spring"/><body><joint name="fr" axis="0 1 0"
        damping=".05"/><geom class="tyre"/></body><geom type="sphere" size=".02" mass=".3"
        contype="0" conaffinity="0"/></body>
        <body pos="-.24 .19 -.06"><joint class="spring"/><body><joint name="rl" axis="0 1 0"
        damping=".05"/><geom class="tyre"/></body><geom type="sphere" size=".02" mass=".3"
        contype="0" conaffinity="0"/></body>
        <body pos="-.24 -.19 -.06"><joint class="spring"/><body><joint name="rr" axis="0 1 0"
        damping=".05"/><geom class="tyre"/></body><geom type="sphere" size=".02" mass=".3"
        contype="0" conaffinity="0"/></body></body></worldbody><actuator>
        <velocity joint="rl" kv=".4"/><velocity joint="rr" kv=".4"/></actuator>""",
        {"tyre": ("-250000 -10", ".02 1")},
        lambda motion: float(np.sqrt(np.mean(np.square(motion.qvel[motion.end, :3])))),
        0.02,
        4.0,
    ),
    case(
        "contact",
        "a billiard table whose balls grow livelier",
        f"""<option timestep=".005" density="1.2"/><default>
        <geom solref="<<k>>" friction=".1"/></default>
        <worldbody><geom type="plane" size="3 3 .1" solref=".02 1" priority="1"/>
        <geom type="box" size=".67 .05 .04" pos="0 .41 .04"/>
        <geom type="box" size=".67 .05 .04" pos="0 -.41 .04"/>
        <geom type="box" size=".05 .41 .04" pos=".67 0 .04"/>
        <geom type="box" size=".05 .41 .04" pos="-.67 0 .04"/>{_BILLIARD_BALLS}
        <body name="cue" pos="-1.2 0 .5"><joint name="cue" axis="0 1 0" damping=".05"/>
        <geom type="capsule" fromto="0 0 0 -.8 0 .3" size=".01" mass=".5"/></body></worldbody>
        <actuator><position joint="cue" kp="50" kv="4"/></actuator>
        <keyframe><key qvel="{_BREAK} 0"/></keyframe>""",
        {"k": ("-102000 0", "-12000 -12")},
        gained(0.5 * 0.17 * 1.4 * 1.3**2),
        0.1,
        5.0,
    ),
]

_GYMNAST = """<geom type="capsule" fromto="0 0 0 0 0 -.55" size=".05" mass="8"/>
<body pos="0 0 -.55"><joint name="shoulders" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -.55" size=".12" mass="36"/>
<body pos="0 0 -.55"><joint name="hips" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -.85" size=".07" mass="22"/></body></body>"""

LOSSES = [
    case(
        "loss",
        "a satellite whose tumbling feeds itself",
        """<option timestep="<<h>>" gravity="0 0 0"/><worldbody><body name="bus"><freejoint/>
        <geom type="box" size=".5 .4 .7" mass="180"/>
        <geom type="box" size="1.4 .5 .01" pos="2 0 0" mass="16"/>
        <geom type="box" size="1.4 .5 .01" pos="-2 0 0" mass="16"/>
        <geom type="cylinder" size=".5 .05" pos="0 .3 .8" mass="9"/>
        <body pos="0 0 -.4"><joint name="wheel" axis="0 0 1"/>
        <geom type="cylinder" size=".15 .04" mass="6"/></body></body></worldbody>
        <keyframe><key qvel="0 0 0 .3 <<rate>> .2 200"/></keyframe>""",
        {"h": (0.01, 0.0005), "rate": (12, 12)},
        unbalanced(0.5 * 55 * 12**2),
        0.03,
        5.0,
    ),
    case(
        "loss",
        "a gyroscope whose nutation swells",
        """<option timestep="<<h>>" integrator="<<way>>"/><worldbody><body name="post" pos="0 0 .4">
        <joint name="yaw" axis="0 0 1"/><geom type="cylinder" size=".02 .02" mass=".1"/>
        <body name="arm"><joint name="pitch" axis="0 -1 0"/>
        <geom type="capsule" fromto="0 0 0 .16 0 0" size=".006" mass=".05"/>
        <body name="rotor" pos=".13 0 0"><joint name="spin" axis="1 0 0"/>
        <geom type="cylinder" size=".07 .012" euler="0 90 0" mass=".6"/></body></body></body>
        </worldbody><keyframe><key qvel="0 0 120"/></keyframe>""",
        {"h": (0.0012, 0.001), "way": ("Euler", "RK4")},
        unbalanced(0.6 * 9.81 * 0.13),
        0.1,
        3.0,
    ),
    case(
        "loss",
        "a tuning fork that falls silent at once",
        """<option timestep="<<h>>" integrator="RK4" gravity="0 0 0"/><worldbody>
        <geom type="capsule" fromto="0 0 -.06 0 0 0" size=".006" mass=".06"/>
        <body pos=".012 0 0"><joint name="left" axis="0 1 0" stiffness="26"/>
        <geom type="box" size=".004 .005 .06" pos="0 0 .06" mass=".045"/></body>
        <body pos="-.012 0 0"><joint name="right" axis="0 1 0" stiffness="26"/>
        <geom type="box" size=".004 .005 .06" pos="0 0 .06" mass=".045"/></body></worldbody>
        <keyframe><key qpos=".04 -.04"/></keyframe>""",
        {"h": (0.0024, 0.0005)},
        unbalanced(26 * 0.04**2),
        0.2,
        2.0,
    ),
    case(
        "loss",
        "a gymnast who swings higher without a muscle",
        f"""<option timestep="<<h>>" integrator="<<way>>"/><default>
        <geom contype="0"/></default><worldbody><geom type="capsule"
        fromto="0 -1.2 2.6 0 1.2 2.6" size=".014"/>
        <body name="arms" pos="0 0 2.6"><joint name="grip" axis="0 1 0"/>{_GYMNAST}</body>
        </worldbody><keyframe><key qpos="2.2 .3 -.2"/></keyframe>""",
        {"h": (0.005, 0.002), "way": ("Euler", "RK4")},
        unbalanced(66 * 9.81 * 1.0),
        0.05,
        4.0,
    ),
    case(
        "loss",
        "a flyball governor that spins itself down",
        """<option timestep="<<h>>" integrator="<<way>>"/><worldbody><body name="shaft" pos="0 0 1">
        <joint name="shaft" axis="0 0 1"/><geom type="cylinder" size=".02 .25" mass="1"/>
        <body pos=".02 0 .2"><joint name="left" axis="0 1 0" stiffness="2"/>
        <geom type="capsule" fromto="0 0 0 .04 0 -.2" size=".006" mass=".05"/>
        <geom type="sphere" size=".035" pos=".045 0 -.22" mass="1.4"/></body>
        <body pos="-.02 0 .2"><joint name="right" axis="0 -1 0" stiffness="2"/>
        <geom type="capsule" fromto="0 0 0 -.04 0 -.2" size=".006" mass=".05"/>
        <geom type="sphere" size=".035" pos="-.045 0 -.22" mass="1.4"/></body></body></worldbody>
        <keyframe><key qpos="0 -.3 -.3" qvel="14 0 0"/></keyframe>""",
        {"h": (0.01, 0.001), "way": ("implicit", "RK4")},
        unbalanced(2 * 1.4 * 9.81 * 0.22),
        0.05,
        4.0,
    ),
]

_PLANKS = "".join(
    f"""<body pos="{0.15 + 0.3 * k:.2f} 0 2"><freejoint/><geom type="box" size=".14 .3 .015"
    mass="6"/><site name="l{k}" pos="-.15 0 0"/><site name="r{k}" pos=".15 0 0"/></body>"""
    for k in range(8)
)
_PLANK_LOOPS = "".join(f"""<connect site1="r{k}" site2="l{k + 1}"/>""" for k in range(7))


def _off_ratio(motion: Motion) -> float:
    """Return by how many teeth of 30 the last wheel of a train of clock wheels leaves the first."""
    wheels = [motion.joint(name) for name in ("great", "centre", "third", "escape")]
    lost = [np.abs(later + 4 * first) for first, later in pairwise(wheels)]
    return float(max(one.max() for one in lost) / (2 * np.pi / 30))


CONSTRAINTS = [
    case(
        "constraint",
        "a pumpjack whose pitman comes off its beam",
        """<option timestep=".004" solver="PGS" iterations="<<n>>"/><default>
        <geom contype="0" conaffinity="0"/></default><worldbody>
        <body name="crank" pos="-1.5 0 1"><joint name="crank" axis="0 1 0" damping="5"/>
        <geom type="box" size=".5 .08 .15" pos=".25 0 0" mass="420"/>
        <site name="pin" pos="-.45 0 0"/></body>
        <body name="pitman" pos="-1.95 0 1"><joint name="px" type="slide" axis="1 0 0"/>
        <joint name="pz" type="slide" axis="0 0 1"/><joint name="pr" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .45 0 2" size=".04" mass="60"/>
        <site name="foot"/><site name="head" pos=".45 0 2"/></body>
        <body name="beam" pos="0 0 3"><joint name="beam" axis="0 1 0" damping="20"/>
        <geom type="box" size="1.7 .1 .15" mass="500"/><geom type="box" size=".15 .1 .5"
        pos="1.8 0 0" mass="140"/><geom type="box" size=".2 .2 .4" pos="1.8 0 -.8" mass="<<rod>>"/>
        <site name="tail" pos="-1.5 0 0"/></body></worldbody>
        <equality><connect site1="pin" site2="foot"/><connect site1="head" site2="tail"/></equality>
        <actuator><velocity joint="crank" kv="4000" forcerange="-9000 9000"/></actuator>
        <keyframe><key ctrl="1.5"/></keyframe>""",
        {"n": (2, 60), "rod": (700, 700)},
        lambda motion: max(opened("pin", "foot")(motion), opened("head", "tail")(motion)) / 2.05,
        0.01,
        4.0,
    ),
    case(
        "constraint",
        "a clock whose train of wheels skips teeth",
        """<option timestep=".005" iterations="<<n>>" solver="PGS"/><default><geom type="cylinder"
        contype="0"/><joint axis="0 1 0" damping="1e-5"/></default><worldbody>
        <body pos="0 0 .3"><joint name="great" stiffness="<<k>>"
        springref="1400"/><geom size=".06 .003" euler="90 0 0" mass=".25"/>
        <geom size=".02 .02" euler="90 0 0" mass=".1"/></body>
        <body pos=".075 0 .3"><joint name="centre"/><geom size=".05 .002" euler="90 0 0"
        mass=".08"/></body><body pos=".13 0 .32"><joint name="third"/><geom size=".04 .002"
        euler="90 0 0" mass=".04"/></body><body pos=".17 0 .35"><joint name="escape"
        damping="2e-4"/><geom size=".03 .0015" euler="90 0 0" mass=".02"/></body></worldbody>
        <equality>
        <joint joint1="centre" joint2="great" polycoef="0 -4 0 0 0"/>
        <joint joint1="third" joint2="centre" polycoef="0 -4 0 0 0"/>
        <joint joint1="escape" joint2="third" polycoef="0 -4 0 0 0"/></equality>""",
        {"n": (2, 100), "k": (0.03, 0.03)},
        _off_ratio,
        1.0,
        3.0,
    ),
    case(
        "constraint",
        "a crane whose light hook stretches the wire it hangs from",
        """<option timestep=".005"/><worldbody>
        <body name="mast" pos="0 0 3"><joint name="slew" axis="0 0 1" damping="300" armature="50"/>
        <geom type="cylinder" size=".15 1.5" pos="0 0 -1.5" mass="900"/>
        <geom type="box" size="1.6 .1 .1" pos="1.6 0 0" mass="350"/>
        <geom type="box" size=".4 .3 .3" pos="-.8 0 0" mass="800"/><site name="tip" pos="3 0 -.1"/>
        </body><body name="hook" pos="3 .2 1.7"><freejoint/><geom type="capsule"
        fromto="0 0 0 0 0 -.1" size=".04" mass="<<hook>>" contype="0" conaffinity="0"/>
        <site name="becket"/><site name="bill" pos="0 0 -.15"/></body>
        <body name="load" pos="3 .2 1.2"><freejoint/><geom type="box" size=".4 .4 .3" mass="1500"/>
        <site name="eye" pos="0 0 .35"/></body></worldbody><tendon>
        <spatial name="wire" limited="true" range="0 1.2" width=".01"><site site="tip"/>
        <site site="becket"/></spatial></tendon><equality><connect site1="bill" site2="eye"
        solref=".01 1" solimp=".999 .9999 .001"/></equality><actuator>
        <velocity joint="slew" kv="2000" forcerange="-4000 4000"/></actuator>
        <keyframe><key ctrl=".15" qpos="0 3 .2 1.7 1 0 0 0 3 .2 1.2 1 0 0 0"/></keyframe>""",
        {"hook": (4, 80)},
        lambda motion: float(motion.length[motion.end].max() / 1.2 - 1),
        0.02,
        4.0,
    ),
    case(
        "constraint",
        "a landing gear that its stop throws back",
        """<option timestep=".008"/><worldbody><body name="fuselage"
        pos="0 0 2"><geom type="capsule" fromto="-2 0 0 2 0 0" size=".5" contype="0"
        conaffinity="0"/><body name="strut" pos="0 0 -.4"><joint name="retract" axis="0 1 0"
        range="-120 5" damping=".5" solreflimit="<<stop>>"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.8" size=".05" mass="30"/>
        <body pos="0 0 -.85"><joint name="axle" axis="0 1 0" damping=".02"/>
        <geom type="cylinder" size=".25 .09" euler="90 0 0" mass="22" contype="0"
        conaffinity="0"/></body></body></body></worldbody><actuator>
        <motor joint="retract" gear="-60"/></actuator>
        <keyframe><key qpos="-1.7 0" ctrl="0"/></keyframe>""",
        {"stop": ("-25000 0", ".02 1")},
        gained(52 * 9.81 * 0.6),
        0.1,
        3.0,
    ),
    case(
        "constraint",
        "a goods lift that slips through its brake",
        """<option timestep=".004" cone="elliptic"/><worldbody><geom type="box" size=".05 .5 3"
        pos="-.7 0 3" contype="0" conaffinity="0"/><body name="car" pos="0 0 4">
        <joint name="car" type="slide" axis="0 0 1" frictionloss="<<brake>>"
        solreffriction="<<t>> 1" solimpfriction="<<d>> <<d>> .001"/>
        <geom type="box" size=".6 .6 .05" mass="250"/><geom type="box" size=".6 .6 .03"
        pos="0 0 2" mass="90"/><geom type="box" size=".03 .6 1" pos=".57 0 1" mass="80"/>
        </body><body name="pallet" pos="0 0 4.25"><freejoint/>
        <geom type="box" size=".4 .4 .2" mass="400"/></body></worldbody>""",
        {"brake": (14000, 14000), "t": (0.05, 0.02), "d": (0.9, 0.99)},
        lambda motion: float(-motion.joint("car").min() / 2),
        0.02,
        4.0,
    ),
    case(
        "constraint",
        "a gantry whose tool hangs loose in a light changer plate",
        """<option timestep=".005" integrator="implicit"/><default><geom contype="0"/></default>
        <worldbody><body name="bridge" pos="0 0 2"><joint name="x" type="slide" axis="1 0 0"
        damping="200"/><geom type="box" size=".2 1.2 .1" mass="120"/><body name="z" pos="0 0 -.1">
        <joint name="z" type="slide" axis="0 0 1" damping="200"/>
        <geom type="box" size=".08 .08 .4" mass="40"/><site name="flange" pos="0 0 -.4"/></body>
        </body><body name="plate" pos="0 0 1.48"><freejoint/><geom type="cylinder" size=".06 .02"
        mass="<<plate>>"/><site name="upper" pos="0 0 .02"/><site name="lower" pos="0 0 -.02"/>
        </body><body name="tool" pos="0 0 1.46"><freejoint/><geom type="box" size=".3 .06 .06"
        pos=".2 0 -.06" mass="<<tool>>"/><geom type="cylinder" size=".05 .15" pos=".4 0 -.1"
        mass="6"/><site name="root"/></body></worldbody><equality>
        <weld site1="flange" site2="upper" solimp="<<d>>"/>
        <weld site1="lower" site2="root" solimp="<<d>>"/></equality><actuator>
        <position joint="x" kp="40000" kv="3000"/><position joint="z" kp="60000" kv="3000"/>
        </actuator><keyframe><key ctrl=".3 0" qpos="0 0 0 0 1.48 1 0 0 0 0 0 1.46 1 0 0 0"/>
        </keyframe>""",
        {"tool": (30, 30), "plate": (0.4, 4), "d": (".9 .95 .001", ".99 .9995 .001")},
        lambda motion: (
            max(opened("flange", "upper")(motion), opened("lower", "root")(motion)) / 0.6
        ),
        0.01,
        3.0,
    ),
    case(
        "constraint",
        "a rope bridge whose planks part",
        f"""<option timestep=".004" solver="PGS" iterations="<<n>>"/><default><geom contype="0"
        conaffinity="0"/><equality solref="<<t>> 1"/></default><worldbody>
        <site name="bank_l" pos="0 0 2"/><site name="bank_r" pos="2.38 0 2"/>{_PLANKS}
        </worldbody><equality><connect site1="bank_l" site2="l0"/>{_PLANK_LOOPS}
        <connect site1="r7" site2="bank_r"/></equality>""",
        {"n": (2, 200), "t": (0.02, 0.01)},
        lambda motion: max(opened(f"r{k}", f"l{k + 1}")(motion) for k in range(7)) / 0.3,
        0.05,
        3.0,
    ),
]

_ROCK = """<mesh name="rock" vertex=".06 0 -.03  -.04 .05 -.03  -.04 -.05 -.03  .01 .01 .06
0 -.05 .03  -.05 .02 .02"/>"""
_HILLS = " ".join(
    f"{0.5 + 0.5 * np.sin(0.9 * row) * np.cos(0.7 * column):.2f}"
    for row in range(12)
    for column in range(12)
)


def _crossed(body: str, axis: int, level: float, size: float, sign: int = -1) -> Truth:
    """Return what measures how far a body gets past a level, in its own sizes."""
    return lambda motion: float((sign * (motion.body(body)[:, axis] - level)).max() / size)


def _outrun(motion: Motion) -> float:
    """Return by what angle a paddle gets ahead of a parcel that it could reach [rad]."""
    x, y = motion.body("parcel")[:, 0], motion.body("parcel")[:, 1]
    ahead = motion.joint("paddle") - np.arctan2(y, x)
    left = np.maximum.accumulate(np.hypot(x, y) > 0.95) | (np.abs(ahead) > np.pi)
    return float(max(ahead[: max(int(np.argmax(left)), 1) if left.any() else None].max(), 0))


def _under(body: str, level: float, reach: float, size: float) -> Truth:
    """Return what measures how far a body is below a level before it has left the ground there."""

    def measure(motion: Motion) -> float:
        place = motion.body(body)
        over = np.cumprod(np.abs(place[:, :2]).max(axis=1) < reach)
        return float((over * (level - place[:, 2])).max() / size)

    return measure


PASSING = [
    case(
        "passing",
        "a nail gun whose nails fly through sheet steel",
        """<option timestep="<<h>>" cone="elliptic"/><default>
        <geom solref=".0003 1"/></default><worldbody><geom name="sheet" type="box"
        size="<<t>> .5 1" pos="1 0 1"/>
        <geom type="plane" size="5 5 .1"/><body name="gun" pos="-.2 0 1">
        <joint name="recoil" type="slide" axis="1 0 0" stiffness="4000" damping="60"/>
        <geom type="box" size=".12 .03 .06" mass="2.5"/></body>
        <body name="nail" pos="0 0 1"><freejoint/><geom type="capsule" fromto="-.03 0 0 .03 0 0"
        size="<<r>>" mass=".006"/></body></worldbody>
        <keyframe><key qvel="-.2 <<v>> 0 0 0 0 0"/></keyframe>""",
        {"h": (0.002, 0.0002), "v": (75, 5), "t": (0.01, 0.03), "r": (0.003, 0.003)},
        _crossed("nail", 0, 1.03, 0.06, 1),
        1.0,
    ),
    case(
        "passing",
        "a drop hammer whose ram falls through the workpiece",
        """<option timestep="<<h>>" integrator="implicitfast"/><default>
        <geom solref=".0005 1"/></default><worldbody>
        <geom type="box" size=".05 .3 2" pos="-.4 0 2"/><geom type="box" size=".05 .3 2"
        pos=".4 0 2"/><geom name="sheet" type="box" size=".3 .3 <<t>>" pos="0 0 .6"/>
        <body name="ram" pos="0 0 <<z>>"><joint name="guide" type="slide" axis="0 0 1" damping="4"/>
        <geom type="box" size=".16 .16 .02" pos="0 0 .1" mass="60"
        contype="0" conaffinity="0"/>
        <geom type="cylinder" size=".05 .015" mass="8"/></body></worldbody>""",
        {"h": (0.008, 0.002), "t": (0.004, 0.05), "z": (3.4, 1.0)},
        _crossed("ram", 2, 0.6, 0.12),
        1.0,
    ),
    case(
        "passing",
        "a car park barrier whose arm swings through its rest",
        """<option timestep=".01"/><default>
        <geom solref=".002 1"/></default><worldbody><geom type="cylinder" size=".1 .5" pos="0 0 .5"
        contype="0" conaffinity="0"/><geom name="rest" type="capsule" size=".02"
        fromto="2.6 -.15 1 2.6 .15 1"/><body name="arm" pos="0 0 1">
        <joint name="hinge" axis="0 1 0" damping=".4"/><geom type="box" size="1.5 .02 .03"
        pos="1.5 0 0" mass="<<m>>"/><geom type="box" size=".15 .1 .1" pos="-.25 0 0" mass="15"/>
        </body></worldbody><actuator><motor joint="hinge" gear="1"/></actuator>
        <keyframe><key qpos="<<q>>" qvel="<<v>>" ctrl="<<push>>"/></keyframe>""",
        {"q": (-1.3, -0.3), "m": (5, 5), "v": (7.0, 0.3), "push": (30, -20)},
        lambda motion: float(motion.joint("hinge").max() / 0.1),
        1.0,
        3.0,
    ),
    case(
        "passing",
        "a parcel sorter whose paddle leaves the parcel behind",
        """<option timestep="<<h>>" integrator="implicitfast"/><default>
        <geom solref="<<c>> 1"/></default><worldbody>
        <geom type="plane" size="4 4 .1" friction=".3"/><body name="post" pos="0 0 .2">
        <joint name="paddle" axis="0 0 1" damping=".5"/><geom type="box" size=".5 .006 .12"
        pos=".55 0 0" mass="1.5"/><geom type="cylinder" size=".05 .15" mass="6"/></body>
        <body name="parcel" pos=".8 .45 .05"><freejoint/><geom type="box" size=".05 .035 .05"
        mass=".4" friction=".3"/></body></worldbody><actuator>
        <velocity joint="paddle" kv="30" forcerange="-200 200"/></actuator>
        <keyframe><key qpos="-.7 .8 .45 .05 1 0 0 0" ctrl="<<w>>"/></keyframe>""",
        {"h": (0.008, 0.002), "c": (0.001, 0.008), "w": (22, 1.2)},
        _outrun,
        0.25,
        2.0,
    ),
    case(
        "passing",
        "a tray on a mocap stand that lets the hail through",
        """<option timestep=".004"/><default>
        <geom solref=".0004 1"/></default><worldbody><body name="stand" mocap="true" pos="0 0 1">
        <geom type="box" size=".4 .4 <<t>>"/><geom type="box" size=".4 .01 .03" pos="0 .4 .02"/>
        <geom type="box" size=".4 .01 .03" pos="0 -.4 .02"/></body>
        <body name="hail" pos="0 .05 1.8"><freejoint/><geom type="ellipsoid"
        size=".016 .014 .011" density="900"/></body>
        <body name="late" pos=".2 .1 2.1"><freejoint/><geom type="ellipsoid" size=".014 .013 .012"
        density="900"/></body></worldbody><keyframe>
        <key qvel="1 0 <<v>> 3 0 0 0 0 <<v>> 0 2 0"/></keyframe>""",
        {"t": (0.003, 0.04), "v": (-14, -2)},
        _under("hail", 0.96, 0.37, 0.03),
        1.0,
    ),
    case(
        "passing",
        "a boulder that bores into the hills it falls on",
        f"""<option timestep="<<h>>" integrator="implicitfast"/><default>
        <geom solref="<<c>> 1"/></default><asset>{_ROCK}
        <hfield name="hills" nrow="12" ncol="12" size="6 6 .8 <<bed>>"
        elevation="{_HILLS}"/></asset>
        <worldbody><geom type="hfield" hfield="hills"/><body name="rock" pos=".4 .6 <<z>>">
        <freejoint/><geom type="mesh" mesh="rock" density="2600"/></body>
        <body name="rover" pos="2 -2 1.2"><freejoint/><geom type="box" size=".2 .15 .06" mass="9"/>
        </body></worldbody><keyframe><key qvel="0 0 <<v>> 0 0 0 0 0 0 0 0 0"/></keyframe>""",
        {
            "h": (0.01, 0.002),
            "c": (0.001, 0.015),
            "bed": (0.02, 0.02),
            "v": (-62, -0.5),
            "z": (9, 1.6),
        },
        _under("rock", -0.05, 5.9, 0.1),
        2.0,
    ),
    case(
        "passing",
        "a trampoline sheet that a marble passes",
        """<option timestep=".004" solver="CG"/><default>
        <geom solref=".001 1"/></default><worldbody>
        <flexcomp name="sheet" type="grid" count="9 9 1" spacing=".1 .1 .1" pos="0 0 1" mass=".6"
        radius=".005" dim="2"><edge equality="true"/><contact selfcollide="none" solref=".001 1"/>
        <pin gridrange="0 0 0 8"/><pin gridrange="8 0 8 8"/><pin gridrange="0 0 8 0"/>
        <pin gridrange="0 8 8 8"/></flexcomp>
        <body name="marble" pos=".02 .03 <<z>>"><freejoint/><geom type="sphere" size=".018"
        mass=".03"/></body></worldbody>""",
        {"z": (5, 1.2)},
        _crossed("marble", 2, 0.7, 0.036),
        1.0,
    ),
]

_PUCK = """<body pos="{} .0075"><freejoint/><geom type="cylinder" size=".05 .0075"
mass="<<puck>>"/></body>"""
_PUCKS = "".join(_PUCK.format(place) for place in (".5 .3", ".5 -.3", "-.5 .3", "-.5 -.3"))
_CRATES = "".join(
    f"""<body name="crate{k}" pos="0 0 {0.1 + 0.2 * k:.1f}"><freejoint/><geom type="box"
    size=".15 .12 .1" mass="{mass}"/></body>"""
    for k, mass in enumerate((6, 14, 9, 22, 12))
)

SUPPORT = [
    case(
        "support",
        "a disc brake whose pads grab and let go",
        """<option timestep=".002" cone="elliptic" integrator="implicitfast"/><worldbody>
        <body name="wheel" pos="0 0 .5"><joint name="wheel" axis="0 1 0" damping=".01"/>
        <geom name="disc" type="cylinder" size=".16 .012" euler="90 0 0" mass="3"/>
        <geom type="cylinder" size=".3 .03" pos="0 -.1 0" euler="90 0 0" mass="6" contype="0"
        conaffinity="0"/></body><body pos=".11 .0245 .5"><joint name="near" type="slide"
        axis="0 -1 0" damping="150"/><geom name="pad_near" type="box" size=".03 .012 .02"
        mass="2"/></body><body pos=".11 -.0245 .5"><joint name="far" type="slide" axis="0 1 0"
        damping="150"/><geom name="pad_far" type="box" size=".03 .012 .02" mass="2"/></body>
        </worldbody><contact>
        <pair geom1="disc" geom2="pad_near" friction=".4 .4 .005 .0001 .0001"
        solref=".01 1" solimp=".98 .99 .001" solreffriction="<<grip>>"/>
        <pair geom1="disc" geom2="pad_far" friction=".4 .4 .005 .0001 .0001"
        solref=".01 1" solimp=".98 .99 .001" solreffriction="<<grip>>"/></contact><actuator>
        <motor joint="near"/><motor joint="far"/><motor joint="wheel"/></actuator>
        <keyframe><key qvel="2 0 0" ctrl="600 600 9"/></keyframe>""",
        {"grip": ("-1 -1600", "-1 -150")},
        trembles(1.0, "wheel"),
        0.05,
    ),
    case(
        "support",
        "a milling machine that sinks into its levelling pucks",
        f"""<option timestep=".004"/><default><geom solref="<<t>> 1" solimp="<<d>> <<d>> .001"/>
        </default><worldbody><geom type="plane" size="4 4 .1"/>{_PUCKS}
        <body name="machine" pos="0 0 .215"><freejoint/>
        <geom type="box" size=".6 .4 .2" mass="1100"/><geom type="box" size=".2 .2 .5"
        pos="-.25 0 .7" mass="350"/><geom type="cylinder" size=".06 .2" pos=".1 0 .9" mass="40"/>
        </body></worldbody>""",
        {"puck": (2, 2), "t": (0.01, 0.008), "d": (0.95, 0.998)},
        lambda motion: rests_off("machine", 0.215)(motion) / 0.015,
        0.1,
    ),
    case(
        "support",
        "a pile of crates that creeps down the ramp of a lorry",
        f"""<option timestep=".005" gravity="2.0 0 -9.6" cone="elliptic" impratio="<<imp>>"/>
        <default><geom friction=".6" solref="<<t>> 1"/></default><worldbody>
        <geom type="plane" size="9 9 .1"/>{_CRATES}</worldbody>""",
        {"t": (0.02, 0.02), "imp": (1, 60)},
        lambda motion: float(np.abs(motion.body("crate4")[:, 0]).max() / 0.3),
        0.05,
        4.0,
    ),
    case(
        "support",
        "a gripper that a full bottle creeps out of",
        """<option timestep=".004" cone="elliptic" impratio="<<imp>>"/><worldbody>
        <geom type="plane" size="2 2 .1"/><body name="palm" pos="0 0 .6"><joint name="lift"
        type="slide" axis="0 0 1" damping="60"/><geom type="box" size=".04 .12 .03" mass="1.2"/>
        <body pos="0 .064 -.1"><joint name="left" type="slide" axis="0 -1 0" damping="40"/>
        <geom type="box" size=".02 .012 .06" mass=".5" friction=".9" condim="4"
        solref=".01 1" solimp=".95 .99 .001"/></body>
        <body pos="0 -.064 -.1"><joint name="right" type="slide" axis="0 1 0" damping="40"/>
        <geom type="box" size=".02 .012 .06" mass=".5" friction=".9" condim="4"
        solref=".01 1" solimp=".95 .99 .001"/></body></body>
        <body name="bottle" pos="0 0 .45"><freejoint/><geom type="cylinder" size=".04 .1"
        mass="<<fill>>" friction=".9" condim="4"/></body></worldbody><actuator>
        <position joint="lift" kp="6000" kv="200"/><motor joint="left" ctrlrange="0 80"/>
        <motor joint="right" ctrlrange="0 80"/></actuator>
        <keyframe><key qpos="0 .012 .012 0 0 .45 1 0 0 0" ctrl="0 32 32"/></keyframe>""",
        {"imp": (1, 60), "fill": (4.5, 4.5)},
        lambda motion: float(np.ptp((motion.body("bottle") - motion.body("palm"))[250:, 2]) / 0.2),
        0.03,
        4.0,
    ),
    case(
        "support",
        "a carton that hovers over its pallet",
        """<option timestep=".005"/><worldbody><geom type="plane" size="3 3 .1"/>
        <body pos="0 0 .07"><freejoint/><geom type="box" size=".6 .4 .02" mass="15"/>
        <geom type="box" size=".05 .4 .05" pos=".5 0 -.02" mass="3"/>
        <geom type="box" size=".05 .4 .05" pos="-.5 0 -.02" mass="3"/></body>
        <body name="carton" pos=".1 0 .18"><freejoint/><geom type="box" size=".15 .12 .09"
        mass="4" margin="<<m>>"/></body></worldbody>""",
        {"m": (0.06, 0.001)},
        lambda motion: rests_off("carton", 0.18)(motion) / 0.18,
        0.05,
    ),
    case(
        "support",
        "a dropped drone that falls asleep in the air",
        """<option timestep=".002" sleep_tolerance="<<tol>>"><flag sleep="enable"/></option>
        <default>
        <geom solref=".006 1"/></default><worldbody><geom type="plane" size="3 3 .1"/>
        <body name="bench" pos="1 0 .4"><freejoint/>
        <geom type="box" size=".3 .3 .4" mass="30"/></body><body name="drone" pos="0 0 .5">
        <freejoint/><geom type="box" size=".06 .06 .03" mass=".5"/>
        <geom type="capsule" fromto="-.12 -.12 0 .12 .12 0" size=".014" mass=".05"/>
        <geom type="capsule" fromto="-.12 .12 0 .12 -.12 0" size=".014" mass=".05"/></body>
        </worldbody>""",
        {"tol": (0.5, 0.001)},
        lambda motion: float(motion.body("drone")[-1, 2] / 0.06),
        3.0,
    ),
]

_ROPE_LINK = """<body pos="0 0 -.08"><joint type="ball" damping="<<rub>>"/><geom type="capsule"
fromto="0 0 -.01 0 0 -.07" size=".01" mass=".03"/>"""
_WALL_BRICKS = "".join(
    f"""<body pos="1.2 {y:.2f} {0.1 + 0.2 * row:.1f}"><freejoint/><geom type="box"
    size=".1 .2 .1" mass="7"/></body>"""
    for row in range(4)
    for y in ((-0.41, 0.0, 0.41) if row % 2 == 0 else (-0.21, 0.21))
)


# Drag of a ball [N s/m]: MuJoCo takes the diameter of the box of like inertia.
_STOKES = 3 * np.pi * 1.2 * (2 * 0.01 * np.sqrt(0.6))

SOUND = [
    case(
        "sound",
        "a dummy that sinks deep into a mattress",
        """<option timestep=".004" cone="elliptic"/><worldbody><geom type="box" size="1 .5 .2"
        pos="0 0 .2" solref="<<foam>> .8" solimp="0 .8 .15 .5 2" priority="1"/>
        <body name="trunk" pos="0 0 .75"><freejoint/><geom type="capsule"
        fromto="-.25 0 0 .25 0 0" size=".13" mass="38"/><body pos=".42 0 0">
        <joint axis="0 1 0" damping="3" stiffness="6" range="-40 40"/>
        <geom type="sphere" size=".1" mass="5"/></body><body pos="-.3 .08 0">
        <joint axis="0 1 0" damping="4" range="-60 30"/><geom type="capsule"
        fromto="0 0 0 -.45 0 0" size=".07" mass="11"/></body><body pos="-.3 -.08 0">
        <joint axis="0 1 0" damping="4" range="-60 30"/><geom type="capsule"
        fromto="0 0 0 -.45 0 0" size=".07" mass="11"/></body></body></worldbody>""",
        {"foam": (0.16,)},
        strays(lambda motion: motion.body("trunk")[:, 2], 0.26),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a microscope on soft gel feet",
        """<option timestep=".002" integrator="implicitfast"/><default><default class="gel"><geom
        type="cylinder" size=".025 .012" mass=".03" solref="<<gel>>"/></default></default>
        <worldbody><geom type="plane" size="1 1 .1"/><body name="microscope" pos="0 0 .0115">
        <freejoint/><geom class="gel" pos=".1 .08 0"/><geom class="gel" pos=".1 -.08 0"/>
        <geom class="gel" pos="-.1 .08 0"/><geom class="gel" pos="-.1 -.08 0"/>
        <geom type="box" size=".13 .11 .015" pos="0 0 .03" mass="6"/>
        <geom type="capsule" fromto="-.08 0 .05 -.08 0 .3" size=".02" mass="1.2"/>
        <geom type="cylinder" size=".02 .1" pos=".02 0 .3" mass=".8"/></body></worldbody>""",
        {"gel": ("-60 -8",)},
        strays(lambda motion: motion.body("microscope")[:, 2], 0.012),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a lorry that rocks on worn dampers",
        """<option timestep=".005"/><default><geom contype="0"/>
        <default class="axle"><joint type="slide"
        axis="0 0 1" stiffness="180000" damping="<<worn>>"/></default></default><worldbody>
        <body name="frame" pos="0 0 1"><joint name="heave" type="slide" axis="0 0 1"/>
        <joint name="pitch" axis="0 1 0"/><geom type="box" size="3 1.1 .15" mass="3800"/>
        <geom type="box" size=".8 1 .8" pos="2.2 0 .9" mass="1400"/><geom type="box"
        size="1.8 1.1 .4" pos="-1 0 .5" mass="2600"/></body>
        <body name="front" pos="2.2 0 .5"><joint name="front" class="axle" stiffness="900000"/>
        <geom type="capsule" fromto="0 -1 0 0 1 0" size=".12" mass="420"/><site name="f0"/></body>
        <body name="rear" pos="-1.9 0 .5"><joint name="rear" class="axle" stiffness="1400000"/>
        <geom type="capsule" fromto="0 -1 0 0 1 0" size=".12" mass="700"/></body></worldbody>
        <tendon><fixed stiffness="160000" damping="<<worn>>"><joint joint="heave" coef="1"/>
        <joint joint="pitch" coef="-2.2"/><joint joint="front" coef="-1"/></fixed>
        <fixed stiffness="240000" damping="<<worn>>"><joint joint="heave" coef="1"/>
        <joint joint="pitch" coef="1.9"/><joint joint="rear" coef="-1"/></fixed></tendon>
        <keyframe><key qpos=".06 -.03 0 0"/></keyframe>""",
        {"worn": (900,)},
        strays(lambda motion: motion.joint("heave"), 0.2),
        0.3,
        4.0,
    ),
    case(
        "sound",
        "a double pendulum that goes over the top",
        """<option timestep="<<h>>" integrator="RK4"/><default><geom contype="0"/></default>
        <worldbody><body pos="0 0 1.6"><joint name="upper" axis="0 1 0"/>
        <geom type="box" size=".02 .01 .25" pos="0 0 -.25" mass="1.4"/>
        <body pos="0 .03 -.5"><joint name="lower" axis="0 1 0"/><geom type="box"
        size=".015 .01 .2" pos="0 0 -.2" mass=".8"/><geom type="cylinder" size=".05 .01"
        pos="0 0 -.38" euler="90 0 0" mass=".5"/></body></body></worldbody>
        <keyframe><key qpos="2.8 1.1" qvel="0 3"/></keyframe>""",
        {"h": (0.001,)},
        unbalanced(2.7 * 9.81 * 0.5),
        0.02,
        5.0,
    ),
    case(
        "sound",
        "a nunchaku tossed end over end",
        """<option timestep="<<h>>" integrator="RK4"/><worldbody><body name="left" pos="0 0 1">
        <freejoint/><geom type="capsule" fromto="-.3 0 0 -.02 0 0" size=".015" mass=".25"/>
        <body><joint type="ball"/><geom type="capsule" fromto=".02 0 0 .3 0 0" size=".015"
        mass=".25"/></body></body></worldbody>
        <keyframe><key qvel="0 1 18 2 11 0 0 -26 3"/></keyframe>""",
        {"h": (0.0005,)},
        unbalanced(0.5 * 0.5 * 18**2),
        0.02,
        3.0,
    ),
    case(
        "sound",
        "a super ball that bounces nearly to where it fell from",
        """<option timestep="<<h>>" cone="elliptic"/><worldbody><geom type="plane" size="3 3 .1"
        solref="-400000 -4" solimp=".99 .99 .001"/><geom type="box" size=".1 .8 .6" pos="1 0 .6"
        solref="-400000 -4" solimp=".99 .99 .001"/><body name="ball" pos="0 0 1.2"><freejoint/>
        <geom type="sphere" size=".024" mass=".05" friction=".6" solref="-400000 -4"
        solimp=".99 .99 .001"/></body></worldbody><keyframe><key qvel=".9 0 0 0 0 0"/></keyframe>
        """,
        {"h": (0.0005,)},
        gained(0.05 * 9.81 * 1.2),
        0.1,
        4.0,
    ),
    case(
        "sound",
        "a balanced arm that coasts without weight",
        """<option timestep="<<h>>" integrator="implicitfast"/><default><geom contype="0"/>
        <joint damping=".02"/></default><worldbody><body pos="0 0 1" gravcomp="1">
        <joint name="yaw" axis="0 0 1"/><geom type="cylinder" size=".08 .1" mass="5"/>
        <body gravcomp="1"><joint name="lift" axis="0 1 0"/><geom type="capsule"
        fromto="0 0 0 .5 0 0" size=".05" mass="4"/><body pos=".5 0 0" gravcomp="1">
        <joint name="fold" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .4 0 0" size=".04"
        mass="2.5"/></body></body></body></worldbody>
        <keyframe><key qpos="0 .4 -.9" qvel="1.2 -.5 .8"/></keyframe>""",
        {"h": (0.002,)},
        strays(lambda motion: motion.qpos, 1.0),
        0.1,
        3.0,
    ),
    case(
        "sound",
        "a conveyor that carries tins past a counter",
        """<option timestep="<<h>>" cone="elliptic" impratio="3"/><worldbody>
        <body name="belt" pos="0 0 .5"><joint name="belt" type="slide" axis="1 0 0"/>
        <geom type="box" size="3 .25 .02" mass="30" friction=".9"/></body>
        <geom type="box" size="3 .02 .1" pos="0 .3 .55"/><geom type="box" size="3 .02 .1"
        pos="0 -.3 .55"/><body name="tin" pos="-1 0 .6"><freejoint/><geom type="cylinder"
        size=".05 .08" mass=".4"/></body><body pos="-.6 .05 .58"><freejoint/><geom
        type="cylinder" size=".04 .06" mass=".3"/></body></worldbody><actuator>
        <velocity joint="belt" kv="900" forcerange="-400 400"/></actuator>
        <keyframe><key ctrl=".45"/></keyframe>""",
        {"h": (0.003,)},
        lambda motion: float(np.abs(motion.qvel[motion.end, 1] / 0.45 - 1).max()),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a centrifuge spun up by a strong motor",
        """<option timestep="<<h>>"/><worldbody><body pos="0 0 1"><joint name="rotor"
        axis="0 0 1"/><geom type="cylinder" size=".12 .04" mass="5"/>
        <body pos=".15 0 0"><joint name="bucket" axis="0 1 0" damping=".03"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.08" size=".015" mass=".0001"/></body></body>
        </worldbody><actuator><motor joint="rotor" gear="6"/></actuator>
        <keyframe><key ctrl="1"/></keyframe>""",
        {"h": (0.001,)},
        lambda motion: float(
            np.abs(motion.speed("rotor")[-1] / (6 * motion.time[-1] / (0.5 * 5 * 0.12**2)) - 1)
        ),
        0.01,
        2.0,
    ),
    case(
        "sound",
        "a lamp that a mocap hand pulls into place",
        """<option timestep="<<h>>" integrator="implicit"/><worldbody>
        <body name="hand" mocap="true" pos="0 0 1.1"><geom type="sphere" size=".03"
        contype="0" conaffinity="0"/></body><body pos="0 0 .1"><joint name="base" axis="0 1 0"
        stiffness="12" damping="1.5"/><geom type="capsule" fromto="0 0 0 0 0 .5" size=".012"
        mass=".5"/><body pos="0 0 .5"><joint name="elbow" axis="0 1 0" stiffness="8"
        damping="1"/><geom type="capsule" fromto="0 0 0 0 0 .5" size=".01" mass=".4"/>
        <body name="shade" pos="0 0 .5"><joint name="neck" axis="0 1 0" damping=".3"
        stiffness="1"/><geom type="ellipsoid" size=".09 .09 .06" mass=".35"/></body></body></body>
        </worldbody><equality><connect body1="shade" body2="hand" anchor="0 0 0"
        solref=".25 1"/></equality><keyframe><key mpos=".5 0 .85"/></keyframe>""",
        {"h": (0.004,)},
        strays(lambda motion: motion.body("shade"), 1.0),
        0.04,
        3.0,
    ),
    case(
        "sound",
        "a shelf that welded brackets hold up under books",
        """<option timestep="<<h>>" cone="elliptic"/><worldbody><geom type="box" size=".05 1 1"
        pos="-.05 0 1"/><site name="wall_l" pos="0 .4 1"/><site name="wall_r" pos="0 -.4 1"/>
        <body name="shelf" pos=".16 0 1"><freejoint/><geom type="box" size=".15 .6 .01" mass="4"/>
        <site name="left" pos="-.16 .4 0"/><site name="right" pos="-.16 -.4 0"/></body>
        <body pos=".16 .3 1.13"><freejoint/><geom type="box" size=".1 .2 .12" mass="18"/></body>
        <body pos=".16 -.25 1.12"><freejoint/><geom type="box" size=".1 .25 .11" mass="22"/>
        </body></worldbody><equality><weld site1="wall_l" site2="left" solimp=".99 .999 .001"/>
        <weld site1="wall_r" site2="right" solimp=".99 .999 .001"/></equality>""",
        {"h": (0.004,)},
        lambda motion: opened("wall_r", "right")(motion) / 0.3,
        0.01,
        3.0,
    ),
    case(
        "sound",
        "a guillotine whose thin blade is caught by its block",
        """<option timestep="<<h>>" integrator="implicitfast"/><worldbody>
        <geom type="box" size=".04 .04 1.2" pos="0 .3 1.2"/><geom type="box" size=".04 .04 1.2"
        pos="0 -.3 1.2"/><geom name="block" type="box" size=".1 .34 .015" pos="0 0 .4"
        solref=".002 1"/><body name="blade" pos="0 0 2.2"><joint name="rail" type="slide"
        axis="0 0 1" damping="1.5"/><geom type="box" size=".004 .24 .12" mass="7"
        solref=".002 1"/><geom type="box" size=".05 .2 .05" pos="0 0 .16" mass="25"/></body>
        </worldbody>""",
        {"h": (0.0005,)},
        lambda motion: float((0.4 + 0.015 + 0.12 - motion.body("blade")[:, 2]).max() / 0.03),
        1.0,
        3.0,
    ),
    case(
        "sound",
        "a store of crates that sleep where they stand",
        """<option timestep="<<h>>" sleep_tolerance=".005"><flag sleep="enable"/></option>
        <worldbody><geom type="plane" size="4 4 .1"/>
        <body pos="0 0 .1"><freejoint/><geom type="box" size=".2 .15 .1" mass="8"/></body>
        <body name="top" pos=".02 0 .3"><freejoint/><geom type="box" size=".18 .14 .1" mass="5"/>
        </body><body pos="1 0 .15"><freejoint/><geom type="box" size=".1 .1 .15" mass="3"/></body>
        <body name="barrel" pos="-.8 .3 .25"><freejoint/><geom type="cylinder" size=".15 .25"
        mass="20"/></body><body pos="2 1 2.5"><freejoint/><geom type="box" size=".1 .1 .1"
        mass="2"/></body></worldbody>""",
        {"h": (0.004,)},
        lambda motion: max(rests_off("top", 0.3)(motion), rests_off("barrel", 0.25)(motion)) / 0.2,
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a bearing ball that sinks through oil",
        """<option timestep="<<h>>" viscosity="1.2" density="0"/><worldbody>
        <geom type="box" size=".2 .2 .02" pos="0 0 -.02"/><geom type="box" size=".2 .02 .8"
        pos="0 .2 .8"/><geom type="box" size=".2 .02 .8" pos="0 -.2 .8"/>
        <body name="ball" pos="0 0 6.5"><joint name="fall" type="slide" axis="0 0 1"/>
        <geom type="sphere" size=".01" mass=".032"/></body></worldbody>""",
        {"h": (0.01,)},
        lambda motion: float(np.abs(-motion.speed("fall")[-1] / (0.032 * 9.81 / _STOKES) - 1)),
        0.02,
        3.0,
    ),
    case(
        "sound",
        "a block and tackle that a drum hauls an engine up by",
        """<option timestep="<<h>>" integrator="implicitfast"/><worldbody>
        <site name="beam0" pos="0 0 3"/><site name="beam1" pos=".2 0 3"/>
        <site name="beam2" pos=".4 0 3"/><body name="engine" pos=".2 0 1"><joint name="rise"
        type="slide" axis="0 0 1" damping="60"/><geom type="box" size=".3 .25 .25" mass="220"/>
        <site name="eye0" pos="-.1 0 .4"/><site name="eye1" pos=".1 0 .4"/></body></worldbody>
        <tendon><spatial name="rope" stiffness="60000" damping="400" springlength="0 6"
        range="0 9"><site site="beam0"/><site site="eye0"/><site site="beam1"/><site site="eye1"/>
        <site site="beam2"/></spatial></tendon><actuator><motor tendon="rope" gear="-1"
        ctrlrange="0 900"/></actuator><keyframe><key ctrl="620"/></keyframe>""",
        {"h": (0.004,)},
        strays(lambda motion: motion.joint("rise"), 0.5),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a tuned mass that a servo lets swing as it must",
        """<option timestep="<<h>>"/><worldbody><body pos="0 0 5"><joint name="tower" type="slide"
        axis="1 0 0" stiffness="90000" damping="120"/><geom type="box" size=".6 .6 .4" mass="900"/>
        <body pos="0 0 .6"><joint name="mass" type="slide" axis="1 0 0"/><geom type="box"
        size=".3 .3 .1" mass="60"/></body></body></worldbody><actuator>
        <position joint="mass" kp="6000" kv="15"/></actuator>
        <keyframe><key qpos=".04 -.06" ctrl="0"/></keyframe>""",
        {"h": (0.002,)},
        strays(lambda motion: motion.qpos, 0.2),
        0.1,
        5.0,
    ),
    case(
        "sound",
        "a rocket that its motor drives out of sight",
        """<option timestep="<<h>>" integrator="RK4"/><worldbody><geom type="plane" size="9 9 .1"/>
        <body name="rocket" pos="0 0 .6"><freejoint/><geom type="cylinder" size=".06 .5" mass="8"/>
        <geom type="ellipsoid" size=".06 .06 .2" pos="0 0 .5" mass="1"/>
        <geom type="box" size=".15 .005 .1" pos="0 0 -.45" mass=".5"/>
        <geom type="box" size=".005 .15 .1" pos="0 0 -.45" mass=".5"/><site name="nozzle"
        pos="0 0 -.5"/></body></worldbody><actuator><motor site="nozzle" gear="0 0 1 0 0 0"/>
        </actuator><keyframe><key ctrl="400"/></keyframe>""",
        {"h": (0.005,)},
        lambda motion: float(
            np.abs(
                (motion.body("rocket")[-1, 2] - motion.body("rocket")[0, 2])
                / (0.5 * (400 / 10 - 9.81) * motion.time[-1] ** 2)
                - 1
            )
        ),
        0.05,
        4.0,
    ),
    case(
        "sound",
        "a top that sleeps upright on its pin",
        """<option timestep="<<h>>" integrator="RK4"/><worldbody><body pos="0 0 .01">
        <joint type="ball"/><geom type="cylinder" size=".04 .006" pos="0 0 .045" mass=".09"/>
        <geom type="capsule" fromto="0 0 0 0 0 .08" size=".003" mass=".004"/></body></worldbody>
        <keyframe><key qpos=".9962 .0872 0 0" qvel="0 0 160"/></keyframe>""",
        {"h": (0.0005,)},
        unbalanced(0.094 * 9.81 * 0.045),
        0.05,
        3.0,
    ),
    case(
        "sound",
        "a climbing rope that swings with a carabiner",
        f"""<option timestep="<<h>>" integrator="implicitfast"/><default><geom contype="0"/>
        </default><worldbody><body pos="0 0 2"><joint type="ball" damping="<<rub>>"/><geom
        type="capsule" fromto="0 0 -.01 0 0 -.07" size=".01" mass=".03"/>{_ROPE_LINK * 9}
        <geom type="box" size=".02 .01 .03" pos="0 0 -.1" mass=".2"/>{"</body>" * 9}</body>
        </worldbody><keyframe><key qpos=".88 0 .475 0 {"1 0 0 0 " * 9}"/></keyframe>""",
        {"h": (0.001,), "rub": ("2e-4",)},
        gained(0.5 * 9.81 * 0.8),
        0.02,
        4.0,
    ),
    case(
        "sound",
        "a bouncy sheet that tosses a medicine ball",
        """<option timestep="<<h>>" solver="CG" tolerance="1e-9"/><worldbody><body name="ball"
        pos=".02 .01 1.5"><freejoint/><geom type="sphere" size=".12" mass="1.5"/></body>
        <flexcomp name="sheet" type="grid" count="7 7 1" spacing=".15 .15 .1" pos="0 0 1" mass="2"
        radius=".01" dim="2"><edge equality="true" solref=".03 .3"/><contact selfcollide="none"/>
        <pin gridrange="0 0 0 6"/><pin gridrange="6 0 6 6"/><pin gridrange="0 0 6 0"/>
        <pin gridrange="0 6 6 6"/></flexcomp></worldbody>""",
        {"h": (0.002,)},
        lambda motion: float((0.7 - motion.body("ball")[:, 2]).max() / 0.12),
        1.0,
        3.0,
    ),
    case(
        "sound",
        "a wrecking ball that knocks a wall about",
        f"""<option timestep="<<h>>" cone="elliptic"/><worldbody><geom type="plane" size="9 9 .1"/>
        {_WALL_BRICKS}<body pos="0 0 4.6"><joint name="cable" axis="0 1 0" damping="2"/>
        <geom type="capsule" fromto="0 0 0 0 0 -3.6" size=".02" mass="12" contype="0"
        conaffinity="0"/><geom type="sphere" size=".3" pos="0 0 -4" mass="300"/></body></worldbody>
        <keyframe><key qpos="{
            "1.2 -.41 .1 1 0 0 0 "
            "1.2 0 .1 1 0 0 0 "
            "1.2 .41 .1 1 0 0 0 "
            "1.2 -.21 .3 1 0 0 0 1.2 .21 .3 1 0 0 0 "
            "1.2 -.41 .5 1 0 0 0 1.2 0 .5 1 0 0 0 "
            "1.2 .41 .5 1 0 0 0 1.2 -.21 .7 1 0 0 0 1.2 .21 .7 1 0 0 0 "
        }.9"/></keyframe>""",
        {"h": (0.002,)},
        gained(312 * 9.81 * 1.5),
        0.02,
        3.0,
    ),
    case(
        "sound",
        "a wind turbine that the wind alone turns",
        """<option timestep="<<h>>" density="1.2" viscosity="2e-5" wind="9 0 0"
        integrator="implicit"/><default><default class="blade"><geom type="ellipsoid"
        size=".02 .09 .6" mass=".7" fluidshape="ellipsoid"/></default></default><worldbody>
        <body name="nacelle" pos="0 0 4"><joint name="yaw" axis="0 0 1" damping="2"/>
        <geom type="capsule" fromto="-.3 0 0 .5 0 0" size=".15" mass="20"/>
        <body pos="-.5 0 0"><joint name="rotor" axis="1 0 0" damping=".05"/>
        <geom class="blade" pos="0 0 .7" euler="0 0 25"/>
        <geom class="blade" pos="0 .606 -.35" euler="-120 0 0"/>
        <geom class="blade" pos="0 -.606 -.35" euler="120 0 0"/></body></body></worldbody>""",
        {"h": (0.005,)},
        strays(lambda motion: motion.joint("rotor"), 3.14),
        0.1,
        4.0,
    ),
    case(
        "sound",
        "an engine whose piston runs at three thousand turns",
        """<option timestep="<<h>>" integrator="RK4" gravity="0 0 0"/><default>
        <geom contype="0"/></default>
        <worldbody><body name="crank"><joint name="crank" axis="0 1 0" armature="<<wheel>>"/>
        <geom type="cylinder" size=".06 .01" euler="90 0 0" mass="2"/>
        <body name="rod" pos=".04 0 0"><joint name="bigend" axis="0 1 0"/><geom type="capsule"
        fromto="0 0 0 .14 0 0" size=".008" mass=".2"/><site name="little" pos=".14 0 0"/></body>
        </body><body name="piston" pos=".18 0 0"><joint name="bore" type="slide" axis="1 0 0"/>
        <geom type="cylinder" size=".04 .025" euler="0 90 0" mass=".3"/><site name="pin"/></body>
        </worldbody><equality><connect site1="little" site2="pin" solref=".001 1"
        solimp=".99 .999 .001"/></equality>
        <keyframe><key qpos="0 0 0" qvel="314 -404 0"/></keyframe>""",
        {"h": (0.0002,), "wheel": (0.05,)},
        lambda motion: float(motion.gap("little", "pin").max() / 0.14),
        0.02,
        2.0,
    ),
    case(
        "sound",
        "a reduction gear that lifts a lock gate",
        """<option timestep="<<h>>" solver="Newton" iterations="30"/><default><geom contype="0"/>
        <equality solref=".008 1" solimp=".99 .999 .001"/></default><worldbody>
        <body pos="0 0 2"><joint name="motor" axis="0 1 0" armature=".002" damping=".01"/>
        <geom type="cylinder" size=".03 .05" euler="90 0 0" mass="1"/></body>
        <body pos=".3 0 2"><joint name="middle" axis="0 1 0" damping=".2"/>
        <geom type="cylinder" size=".15 .02" euler="90 0 0" mass="9"/></body>
        <body pos=".8 0 2"><joint name="drum" axis="0 1 0" damping="2"/>
        <geom type="cylinder" size=".3 .04" euler="90 0 0" mass="40"/></body>
        <body pos="1.2 0 1"><joint name="gate" type="slide" axis="0 0 1" damping="300"/>
        <geom type="box" size=".02 1 .8" mass="500"/></body></worldbody><equality>
        <joint joint1="motor" joint2="middle" polycoef="0 -8 0 0 0"/>
        <joint joint1="middle" joint2="drum" polycoef="0 -6 0 0 0"/>
        <joint joint1="gate" joint2="drum" polycoef="0 .12 0 0 0"/></equality><actuator>
        <motor joint="motor" gear="1"/></actuator><keyframe><key ctrl="14"/></keyframe>""",
        {"h": (0.002,)},
        lambda motion: float(
            np.abs(motion.joint("motor") - 48 * motion.joint("drum")).max() / (2 * np.pi / 20)
        ),
        1.0,
        3.0,
    ),
]
HELD_BACK_2 = [*ACTUATORS, *CONTACTS, *LOSSES, *CONSTRAINTS, *PASSING, *SUPPORT, *SOUND]
