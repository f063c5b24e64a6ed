"""What only looks like a failure is stable, and what fails beside it is still found."""

from typing import Any

import pytest

pytestmark = pytest.mark.long

WORLD = (
    '<mujoco>{option}<worldbody><geom name="floor" type="{floor}"/>{bodies}</worldbody></mujoco>'
)
PLANE = 'plane" size="2 2 .1'


def world(bodies: str, floor: str = PLANE, option: str = "") -> str:
    return WORLD.format(bodies=bodies, floor=floor, option=option)


def standing(solref: float, height: float) -> str:
    """A box whose frame is in the middle of its lower face."""
    return world(
        f'<body pos="0 0 {height}"><freejoint/><geom type="box" size=".05 .05 .05" pos="0 0 .05" '
        f'solref="{solref} 1" priority="1" mass="1"/></body>'
    )


def deep(depth: float, radius: float, solref: str) -> str:
    return world(
        f'<body pos="0 0 {radius - depth}"><freejoint/><geom size="{radius}" mass="1" '
        f'solref="{solref}" priority="1"/></body>'
    )


def spring(stiffness: float, timestep: float, more: str = "") -> str:
    option = f'<option timestep="{timestep}" gravity="0 0 0">{more}</option>'
    return (
        f'<mujoco>{option}<worldbody><body><joint type="slide" stiffness="{stiffness}"/>'
        '<geom size=".05" mass="1"/></body></worldbody><keyframe><key qpos=".1"/></keyframe>'
        "</mujoco>"
    )


FIELD = """<mujoco><asset><hfield name="hills" nrow="20" ncol="20" size="1 1 .2 .1"/></asset>
<worldbody><geom type="hfield" hfield="hills"/><body pos="0 0 .06"><freejoint/>
<geom type="box" size=".3 .3 .05" mass="1"/></body></worldbody>
<keyframe><key qvel="0 0 {speed} 0 0 0"/></keyframe></mujoco>"""
FREE = '<body pos="1 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>'
STATIC = '<body mocap="true" pos="0 0 {height}"><geom size=".1"/></body>' + FREE
FLOATING = (
    '<body pos="0 0 .048"><freejoint/><geom type="box" size=".05 .05 .05" margin="{}"/></body>'
)
OFF = '<option gravity="0 0 0"><flag contact="{}"/></option>'
SKIRT = (
    '<body pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05" mass="1" margin="{}"/>'
    '<geom name="skirt" pos="0 0 -.03" size=".05" mass=".01" contype="0" conaffinity="0"/></body>'
)
SINKING = standing(2.0, 0.0)
MARGIN = (
    '<body pos="0 0 .08"><freejoint/><geom type="box" size=".03 .03 .03" mass="1" margin="{}"/>'
    "</body>"
)
LID = (
    '<body pos="0 0 .01"><joint type="slide" axis="0 0 1" damping="20"/>'
    '<geom type="box" size=".1 .1 .01" mass="1"/></body>'
)
ASLEEP = '<option sleep_tolerance="{}"><flag sleep="enable"/></option>'
SLOPE = (
    '<geom type="box" size="1 1 .1" pos="0 0 .7" euler="0 20 0"/><body pos="0 0 .8595" '
    'euler="0 20 0"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>'
)
GLIDE = (
    '<body pos="0 0 .5"><joint type="slide" axis="1 0 0" damping="1"/><geom size=".05" mass="1"/>'
    '</body></worldbody><keyframe><key qvel=".02"/></keyframe><worldbody>'
)
DROP = (
    '<body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".03" mass="1" '
    'solref="{solref} 1" priority="1"/></body></worldbody><keyframe><key qvel="-{speed}"/>'
    "</keyframe><worldbody>"
)
MAT = (
    '<geom name="mat" type="box" size=".2 .2 .03" pos="0 0 .03" solref="{solref} 1" '
    'solimp="{solimp}" priority="1"/><body pos="0 0 .16"><freejoint/>'
    '<geom type="box" size=".1 .1 .1" mass="8"/></body>'
)
STOP = (
    '<body pos="0 0 1"><joint type="slide" axis="0 0 1" range="0 .5" limited="true" '
    'damping="1"/><geom size=".05" mass="1"/></body>{}</worldbody><keyframe><key qpos="-.1{}"/>'
    "</keyframe><worldbody>"
)
DROPPED = deep(0.03, 0.05, ".01 .1").split("<body")[1].split("</world")[0]
TOOL = """<mujoco><worldbody><body name="link" pos="0 0 1"><joint axis="0 1 0" stiffness="4000"
damping="50"/><geom type="box" size=".2 .02 .02" pos=".2 0 0" mass="1"/></body><body name="tool"
pos=".5 0 1"><freejoint/><geom type="box" size=".1 .02 .02" mass="2"/></body></worldbody>
<contact><exclude body1="link" body2="tool"/></contact>
<equality><weld body1="link" body2="tool" solref="{} 1"/></equality></mujoco>"""
BRAKE = """<mujoco><worldbody><body><joint axis="0 1 0" frictionloss="4" solreffriction="{} 1"/>
<geom size=".02" pos=".1 0 0" mass="2"/></body></worldbody></mujoco>"""
WEDGED = (
    '<geom type="box" size=".2 .2 .02" pos="0 0 {height}"/><body pos="0 0 .05"><freejoint/>'
    '<geom type="box" size=".1 .05 .05" mass="1" solref=".004 1" priority="1"/></body>{press}'
)
PRESS = """<body pos="0 0 .12"><joint name="ram" type="slide" axis="0 0 -1"/><geom type="box"
size=".04 .04 .02" mass="1"/></body></worldbody><actuator><motor joint="ram"/></actuator>
<keyframe><key qpos="0 0 .05 1 0 0 0 0" ctrl="200"/></keyframe><worldbody>"""
PALLET = (
    '<body pos="0 0 .02"><freejoint/><geom type="box" size=".3 .3 .02" mass="20"/></body>'
    '<body pos="0 0 .13"><freejoint/><geom type="box" size=".1 .1 .09" mass="4" '
    'margin="{}"/></body>'
)
BLADE = (
    '<geom name="block" type="box" size=".1 .3 .015" pos="0 0 .4" solref=".002 1"/>'
    '<body pos="0 0 .7"><joint type="slide" axis="0 0 1"/><geom type="box" size=".004 .2 .12" '
    'mass="30" solref="{solref} 1"/></body></worldbody><keyframe><key qvel="-{speed}"/></keyframe>'
    "<worldbody>"
)
PLATE = (
    '<geom type="box" size=".2 .2 .002" pos="0 0 .5"/><body pos="0 0 .55">'
    '<joint type="slide" axis="0 0 1"/><geom size=".02" mass=".05" solref="{solref} 1" '
    'priority="1"/></body></worldbody><keyframe><key qvel="-3"/></keyframe><worldbody>'
)
HUB = (
    '<geom type="box" size=".05 .05 .05" pos="0 0 1"/><body pos="0 0 {height}">'
    '<joint type="hinge" axis="0 1 0" damping=".1"/><geom type="capsule" size=".02" '
    'fromto="{fromto}" mass="1"/></body>'
)
WEIGHTLESS = '<option gravity="0 0 0"/>'

# Healthy, failing, and the label of the failing one.
LOOKALIKES = {
    "a frame on the surface": (standing(0.02, 0.0), SINKING, "tunneling"),
    "contacts with a height field": (
        FIELD.format(speed=0),
        FIELD.format(speed=-100),
        "tunneling",
    ),
    "contact that is switched off": (
        world(FLOATING.format(0), option=OFF.format("disable")),
        world(FLOATING.format(-0.005), option=OFF.format("enable")),
        "missed_contact",
    ),
    "a mocap body in the floor": (
        world(STATIC.format(height=0.02)),
        world(FLOATING.format(-0.005), option=WEIGHTLESS),
        "missed_contact",
    ),
    "an undamped spring": (spring(1000, 0.005), spring(410000, 0.005), "energy_injection"),
    "a small margin": (
        world(MARGIN.format(0.004)),
        world(MARGIN.format(0.03)),
        "contact_at_distance",
    ),
    "a sleeper on the floor": (
        world(LID, option=ASLEEP.format(1e-3)),
        world(LID.replace("0 0 .01", "0 0 .5"), option=ASLEEP.format(2)),
        "asleep_unsupported",
    ),
    "a sleeper on a slope": (
        world(SLOPE, option=ASLEEP.format(1e-2)),
        world(GLIDE, option=ASLEEP.format(5e-2)),
        "asleep_unsupported",
    ),
    "a mat as soft as its solimp is wide": (
        world(MAT.format(solref=0.04, solimp=".3 .6 .02")),
        world(MAT.format(solref=0.15, solimp=".59 .6 .001")),
        "deep_penetration",
    ),
    "a start outside of a limit": (
        world(STOP.format("", "")),
        world(STOP.format(f"<body{DROPPED}", " 0 0 .02 1 0 0 0")),
        "energy_injection",
    ),
    "a hard landing": (
        world(DROP.format(speed=6, solref=0.02)),
        world(DROP.format(speed=6, solref=0.4)),
        "tunneling",
    ),
    "a start within a margin": (
        world(PALLET.format(0.001)),
        world(PALLET.format(0.06)),
        "contact_at_distance",
    ),
    "a blade that meets a block with its edge": (
        world(BLADE.format(speed=6, solref=0.0032), option='<option timestep=".0005"/>'),
        world(BLADE.format(speed=400, solref=0.0032), option='<option timestep=".0005"/>'),
        "tunneling",
    ),
    "a plate that a ball dents and leaves": (
        world(PLATE.format(solref=0.005), option='<option timestep=".0005"/>'),
        world(PLATE.format(solref=0.05), option='<option timestep=".0005"/>'),
        "tunneling",
    ),
    "a weld that turns a little": (TOOL.format(0.02), TOOL.format(0.2), "constraint_violated"),
    "a brake that holds": (BRAKE.format(0.005), BRAKE.format(1), "constraint_violated"),
    "a press that a motor drives": (
        world(WEDGED.format(height=2, press=PRESS)),
        world(WEDGED.format(height=0.114, press="")),
        "squeezed",
    ),
    "a rod on a hub that it lies in": (
        world(HUB.format(height=1, fromto="0 0 0 0 0 -.3")),
        world(WEDGED.format(height=0.1, press="")),
        "deep_penetration",
    ),
    "a start a hair deep": (
        deep(0.002, 0.05, ".02 1"),
        deep(0.03, 0.05, ".01 .1"),
        "energy_injection",
    ),
}
SWEEP = "version: 1\nscene: model.xml\nduration: 1\ndrive: none\ntrace: none\nchecks: all\n"


@pytest.mark.parametrize("name", LOOKALIKES)
def test_only_what_fails_is_flagged(sweeper: Any, name: str) -> None:
    healthy, failing, label = LOOKALIKES[name]
    for model, expected in ((healthy, "stable"), (failing, label)):
        (sweeper.folder / "model.xml").write_text(model)
        sweeper.run(SWEEP, expected)
        (row,) = sweeper.rows(expected)
        assert expected in row["labels"], (row["labels"], row["label_reason"])
