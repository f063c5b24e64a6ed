"""Each rule finds its planted defect, at its line, and nothing in the clean twin.

What a rule proposes ends its finding: the lines of a remedy are written, and linted again.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import mujoco
import pytest
from tests.studies.lint.conftest import Linted, only, rules_of

from contactlab.scene.scene_source import find_scene
from contactlab.schema.advisory import Advisory, AffectedReleases, Witness, Workaround
from contactlab.schema.lint_report import LintReport
from contactlab.studies.lint.linted_model import apply_edits, linted_model
from contactlab.studies.lint.linting import lint
from contactlab.studies.lint.rules import RULES

# An arm of two links on a base, which hangs free of the floor.
ROBOT = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <size memory="1M"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="base" pos="0 0 1">
      <body name="upper" pos="0 0 .1">
        <joint name="shoulder" axis="0 1 0" range="-1 1" damping="1"/>
        <geom name="upper" type="capsule" fromto=".1 0 0 .3 0 0" size=".02"/>
        <body name="lower" pos=".4 0 0">
          <joint name="elbow" axis="0 1 0" range="-1 1" damping="1"/>
          <geom name="lower" type="capsule" fromto=".1 0 0 .3 0 0" size=".02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="lift" joint="shoulder" kp="10" ctrlrange="-1 1"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="0 0" ctrl="0"/>
  </keyframe>
</mujoco>
"""
_TETRAHEDRON = "0 0 0 .1 0 0 0 .1 0 0 0 .1"
_MESH = f'<asset><mesh name="part" vertex="{_TETRAHEDRON}"/></asset>\n  <worldbody>'
_INERTIAL = '<inertial pos=".2 0 0" mass="{}" diaginertia="{}"/>'
_URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="0" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="0" velocity="1"/></joint>
</robot>
"""


_CONTACTS = (
    '<replicate count="99" offset=".1 0 0"><geom pos="0 0 -1.1" size=".01" mass="0"/></replicate>'
)


class Planted(NamedTuple):
    """Replacements that plant a defect, and a word of the line where it is found."""

    defect: Mapping[str, str]
    line: str
    mends: bool = True  # whether the lines that are proposed end it
    robot: str = ROBOT


_UPPER = 'fromto=".1 0 0 .3 0 0" size=".02"/>\n        <body'
_OTHER = '<body name="other" pos=".2 .01 1.1"><freejoint/><geom name="other" size=".02"/></body>'
# Folds back on the upper arm, from which the lower arm is between them.
_HAND = (
    '\n<body name="hand"><joint axis="0 1 0"/><geom name="hand" pos="-.2 0 0" size=".03"/></body>'
)
# Wheels whose axles a fixed frame holds, 10 mm in the floor.
_CART = (
    '<body name="wheel" pos="0 .5 .09"><joint axis="0 1 0"/><geom name="wheel" size=".1"/></body>'
)
_SUNK = '<body name="sunk" pos=".5 .5 -.2"><freejoint/><geom name="sunk" size=".1"/></body>'
_HOOK = """<site name="top" pos="0 0 2"/>
    <body name="load" pos="0 0 1.6"><freejoint/><geom name="load" size=".1" mass="20"/></body>
    <body name="hook" pos="0 0 1.7"><freejoint/><geom name="hook" size=".01" mass=".01"
      contype="0" conaffinity="0"/><site name="eye"/></body>"""
_ROPE = """<tendon><spatial name="rope" limited="true" range="0 .3"><site site="top"/>
    <site site="eye"/></spatial></tendon>
  <equality><weld name="grasp" body1="hook" body2="load"/></equality>"""
_JAWS = """<mujoco><worldbody><body name="hand">
  <body name="left" pos="0 .05 0"><joint name="left" type="slide" axis="0 -1 0" range="0 .05"/>
    <geom name="left" type="box" size=".01 .005 .03" mass=".05"/></body>
  <body name="right" pos="0 -.05 0"><joint name="right" type="slide" axis="0 1 0" range="0 .05"/>
    <geom name="right" type="box" size=".01 .005 .03" mass=".05"/></body>
</body></worldbody><actuator>
  <position name="left" joint="left" kp="2000"/><position name="right" joint="right" kp="2000"/>
</actuator></mujoco>
"""
_WHEEL = """<link name="{0}"><inertial><mass value="1"/>
    <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius=".1"/></geometry></collision></link>
  <joint name="{0}" type="continuous"><parent link="base"/><child link="{0}"/>
    <origin xyz="{1} 0 -.2"/><axis xyz="0 1 0"/></joint>"""
_ROVER = f"""<robot name="rover">
  <link name="base"><collision><geometry><box size=".6 .2 .1"/></geometry></collision></link>
  {_WHEEL.format("front", ".2")}
  {_WHEEL.format("rear", "-.2")}
</robot>
"""
_LIFT = '<position name="lift" joint="shoulder" kp="10" ctrlrange="-1 1"/>'
_MOTORS = '<motor name="lift" joint="shoulder" {0}/>\n    <motor name="bend" joint="elbow" {0}/>'
CASES: Mapping[str, Planted] = {
    "keyframe-length": Planted({'qpos="0 0"': 'qpos="0"'}, "<key", mends=False),
    "keyframe-range": Planted({'qpos="0 0"': 'qpos="0 1.5"'}, "<key"),
    "keyframe-control": Planted({'ctrl="0"': 'ctrl="2"'}, "<key"),
    "qpos0-range": Planted(
        {'name="elbow" axis="0 1 0" range="-1 1"': 'name="elbow" axis="0 1 0" range=".5 1"'}
        | {'<key name="home" qpos="0 0" ctrl="0"/>': ""},
        'name="elbow"',
    ),
    "radians-as-degrees": Planted({'<compiler angle="radian"/>': "<compiler/>"}, "shoulder"),
    "degrees-as-radians": Planted({'range="-1 1" damping': 'range="-90 90" damping'}, "shoulder"),
    "inertia-impossible": Planted(
        {'<geom name="lower"': _INERTIAL.format(1, "1 1 3") + '<geom name="lower"'}
        | {'angle="radian"': 'angle="radian" balanceinertia="true"'},
        'name="lower"',
        mends=False,
    ),
    "density": Planted(
        {'size=".02"/>\n        </body>': 'size=".02" density="1"/></body>'}, "lower", False
    ),
    "inertia-shape": Planted(
        {'<geom name="lower"': _INERTIAL.format(0.3, ".2 .2 .2") + '<geom name="lower"'},
        "lower",
        False,
    ),
    "visual-mass": Planted(
        {"<worldbody>": _MESH}
        | {
            '<geom name="lower"': '<geom name="look" type="mesh" mesh="part" contype="0" '
            'conaffinity="0"/>\n          <geom name="lower"'
        },
        'name="look"',
    ),
    "gain-step": Planted({'kp="10"': 'kp="1e7"'}, "shoulder"),
    "solref-step": Planted(
        {'<geom name="lower"': '<geom name="lower" solref=".001 1"'}, '<geom name="lower"'
    ),
    "long-step": Planted({'timestep="0.002"': 'timestep="0.015"'}, "<option"),
    "option-value": Planted(
        {'timestep="0.002"': 'timestep="0.002" gravity="0 0 -inf" impratio="0"'}, "<option"
    ),
    "gravity-size": Planted(
        {'timestep="0.002"': 'timestep="0.002" gravity="0 0 -981"'}, "<option", False
    ),
    "solref-energy": Planted(
        {'<geom name="lower"': '<geom name="lower" solref=".02 .05"'}, '<geom name="lower"'
    ),
    "solref-mixed": Planted(
        {'<geom name="lower"': '<geom name="lower" solref="-100 1"'}, '<geom name="lower"'
    ),
    "frictionless-condim": Planted(
        {'size=".02"/>\n        </body>': 'size=".02" priority="1" friction="0"/></body>'},
        '<geom name="lower"',
    ),
    "contact-margin": Planted(
        {'<geom name="lower"': '<geom name="lower" margin=".01"'}, '<geom name="lower"'
    ),
    "contact-softness": Planted(
        {'<geom name="lower"': '<geom name="lower" solref=".05 1"'}, '<geom name="lower"'
    ),
    "parent-filter": Planted(
        {
            'size=".02"/>\n        </body>': f'size=".02"/>{_HAND}</body>',
            'qpos="0 0"': 'qpos="0 0 0"',
        },
        'body name="hand"',
    ),
    "base-filter": Planted(
        {
            '<body name="base" pos="0 0 1">': '<body name="base" pos="0 0 1">'
            '<geom name="base" size=".15"/>'
        },
        'body name="upper"',
    ),
    "overlap": Planted(
        {'<body name="base"': f'{_OTHER}\n    <body name="base"'}
        | {'qpos="0 0"': 'qpos=".2 .01 1.1 1 0 0 0 0 0"'},
        "<key",
        mends=False,
    ),
    "overlap-qpos0": Planted(
        {'<body name="base"': f'{_OTHER}\n    <body name="base"'}
        | {'<key name="home" qpos="0 0" ctrl="0"/>': ""},
        'body name="upper"',
        mends=False,
    ),
    "coincident-geoms": Planted(
        {
            '<geom name="lower"': '<geom name="seen" type="capsule" fromto=".1 0 0 .3 0 0" '
            'size=".02" mass="0"/>\n          <geom name="lower"'
        },
        'name="lower"',
    ),
    "pressing": Planted(
        {'<body name="base"': f'{_CART}\n    <body name="base"'}
        | {'qpos="0 0"': 'qpos="0 0 0"', 'ctrl="0"': 'ctrl="0"'},
        'body name="wheel"',
        mends=False,
    ),
    "below-floor": Planted(
        {'<body name="base"': f'{_SUNK}\n    <body name="base"'}
        | {'<key name="home" qpos="0 0" ctrl="0"/>': ""},
        'body name="sunk"',
        mends=False,
    ),
    "no-actuators": Planted(
        {
            '<position name="lift" joint="shoulder" kp="10" ctrlrange="-1 1"/>': "",
            'ctrl="0"': "",
            'damping="1"': 'damping="1" actuatorfrcrange="-5 5"',
        },
        'name="shoulder"',
        mends=False,
    ),
    "welded-root": Planted({}, 'link name="front"', False, _ROVER),
    "nothing-below": Planted(
        {
            '<body name="base" pos="0 0 1">': '<body name="base" pos="0 0 1"><freejoint/>'
            '<geom name="trunk" size=".05"/>',
            'type="plane"': 'type="plane" contype="0" conaffinity="0"',
            'qpos="0 0"': 'qpos="0 0 1 1 0 0 0 0 0"',
        },
        'body name="base"',
        mends=False,
    ),
    "control-range": Planted({'ctrlrange="-1 1"': 'ctrlrange="-90 90"'}, "<position", False),
    "keyframe-torque": Planted(
        {_LIFT: _MOTORS.format(""), 'ctrl="0"': 'ctrl=".2 -.5"', 'qpos="0 0"': 'qpos=".2 -.5"'},
        "<key",
        mends=False,
    ),
    "clipped-control": Planted(
        {_LIFT: _MOTORS.format('gear="2" ctrlrange="-9 9" forcerange="-4 4"'), 'ctrl="0"': ""},
        "<motor",
        mends=False,
    ),
    "jaw-force": Planted({}, "<position", False, _JAWS),
    "activation-step": Planted(
        {
            _LIFT: "<general "
            'name="lift" joint="shoulder" ctrlrange="-1 1" dyntype="filter" dynprm=".001"/>'
        },
        "<general",
    ),
    "light-link": Planted(
        {
            '<body name="base"': f'{_HOOK}\n    <body name="base"',
            "<actuator>": f"{_ROPE}\n  <actuator>",
            '<key name="home" qpos="0 0" ctrl="0"/>': "",
        },
        'body name="hook"',
        mends=False,
    ),
    "pyramid-friction": Planted({'type="plane"': 'type="plane" friction="20"'}, 'name="floor"'),
    "hfield-cell": Planted(
        {
            "<worldbody>": '<asset><hfield name="hills" nrow="3" ncol="3" size="1 1 .1 .1" '
            'elevation="0 0 0 0 1 0 0 0 0"/></asset>\n  <worldbody>',
            '<body name="base"': '<geom name="hills" type="hfield" hfield="hills" pos="0 0 -1"/>'
            '\n    <body name="base"',
        },
        'geom name="hills"',
        mends=False,
    ),
    "hull-fills-mesh": Planted({"<worldbody>": "{corner}<worldbody>"}, "corner", False),
    "memory": Planted(
        {'memory="1M"': 'memory="50K"'}
        | {'<geom name="lower"': f'{_CONTACTS}\n          <geom name="lower"'},
        "<size",
    ),
    "advisory": Planted({'timestep="0.002"': 'timestep="0.002" jacobian="sparse"'}, "<option"),
    "unnamed": Planted({'<position name="lift"': "<position"}, "<position"),
    "unread": Planted(
        {'mesh="none"': "", '<geom name="lower"': '<geom mesh="none" name="lower"'}, "lower", False
    ),
    "deprecated": Planted(
        {'angle="radian"': 'angle="radian" settotalmass="3"'}, "<compiler", False
    ),
    "legacy": Planted({'memory="1M"': 'njmax="100"'}, "<size", False),
    "absolute-path": Planted(
        {"<worldbody>": '<asset><mesh name="far" file="{folder}/far.obj"/></asset>\n  <worldbody>'},
        'name="far"',
    ),
    "resource-name": Planted(
        {
            '<link name="lower">': '<link name="lower"><collision><geometry>'
            '<mesh filename="package://arm/far.obj"/></geometry></collision>'
        },
        "package://",
        False,
        _URDF,
    ),
    "unused-asset": Planted(
        {"<worldbody>": '<asset><mesh name="far" file="far.obj"/></asset>\n  <worldbody>'},
        'name="far"',
        False,
    ),
}
# Two bars that meet in a corner, as one mesh of twelve faces: half of its hull is empty.
_CORNER = """<asset><mesh name="corner"
    vertex="0 0 0 1 0 0 1 .1 0 .1 .1 0 .1 1 0 0 1 0 0 0 .1 1 0 .1 1 .1 .1 .1 .1 .1 .1 1 .1 0 1 .1"
    face="0 2 1 0 3 2 0 4 3 0 5 4 6 7 8 6 8 9 6 9 10 6 10 11 0 1 7 0 7 6 1 2 8 1 8 7 2 3 9 2 9 8
      3 4 10 3 10 9 4 5 11 4 11 10 5 0 6 5 6 11"/></asset>
  """


def planted(case: Planted, folder: Path) -> str:
    """Return the robot with a defect."""
    text = case.robot
    for old, new in case.defect.items():
        text = text.replace(old, new)
    if "{corner}" in text:
        corner = '<geom name="corner" type="mesh" mesh="corner"/>'
        text = text.replace("{corner}", _CORNER).replace(
            '<geom name="lower"', f'{corner}\n          <geom name="lower"'
        )
    return text.replace("{folder}", str(folder))


_ADVISORY = Advisory(
    id="LAB-2026-0001",
    title="Sparse Jacobians are wrong",
    consequence="It is for tests only.",
    affected=(AffectedReleases(introduced="0"),),
    severity="wrong result",
    applies="sparse_jacobian",
    witness=Witness(
        model="<mujoco/>", measure="nv", right=1, wrong=0, tolerance=0, reason="It is made up."
    ),
    workarounds=(Workaround(modification="jacobian", settings={"jacobian": "dense"}),),
)


@pytest.fixture(autouse=True)
def _advisories(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "contactlab.advisories.met_advisories.list_advisories", lambda: (_ADVISORY,)
    )


@pytest.fixture(autouse=True)
def _file(tmp_path: Path) -> None:
    points = zip(*[iter(_TETRAHEDRON.split())] * 3, strict=True)
    lines = [f"v {' '.join(point)}" for point in points]
    faces = ["f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]
    (tmp_path / "far.obj").write_text("\n".join([*lines, *faces]), encoding="utf-8")


@pytest.mark.parametrize("robot", [ROBOT, _URDF], ids=["mjcf", "urdf"])
def test_clean_twins_have_nothing(linted: Linted, robot: str) -> None:
    assert rules_of(linted(robot)) <= {"inertia-shape"}  # a ball of 1 kg and 1 kg m^2, of a URDF


def test_a_visual_copy_that_weighs_doubles_the_mass(linted: Linted) -> None:
    """Of two equal boxes one is for the eye: the part weighs twice what one box does."""
    box = '<geom name="{}" type="box" size=".02 .02 .02" {}/>'
    seen = 'contype="0" conaffinity="0"'

    def report_of(real: str, look: str) -> LintReport:
        boxes = box.format("real", real) + box.format("look", f"{seen} {look}")
        return linted(ROBOT.replace('<geom name="lower"', f'{boxes}<geom name="lower"'))

    assert "0.064 of" in only(report_of("", ""), "visual-mass").message
    for real, look in (("", 'mass="0"'), ("", 'pos=".05 0 0"'), ('mass="0"', "")):
        assert "visual-mass" not in rules_of(report_of(real, look))
    # Two visual copies of each other double no geom that collides; without both, mass would lack.
    assert "visual-mass" not in rules_of(report_of(seen, ""))


@pytest.mark.parametrize("copy", ['contype="0" conaffinity="0"', 'pos="0 0 .001"'])
def test_a_visual_or_displaced_copy_is_not_coincident(linted: Linted, copy: str) -> None:
    box = '<geom type="box" size=".02 .02 .02" {}/>'
    boxes = f"{box.format('')}\n          {box.format(copy)}\n          "
    text = ROBOT.replace('<geom name="lower"', f'{boxes}<geom name="lower"')
    assert "coincident-geoms" not in rules_of(linted(text))


SOUND: Mapping[str, Mapping[str, str]] = {
    "pressing": {'pos="0 .5 .09"': 'pos="0 .5 .1"'},
    "below-floor": {'pos=".5 .5 -.2"': 'pos=".5 .5 .01"'},
    "no-actuators": {'damping="1" actuatorfrcrange="-5 5"': 'damping="1"'},
    "welded-root": {_WHEEL.format("rear", "-.2"): ""},
    "nothing-below": {'contype="0" conaffinity="0"': ""},
    "control-range": {'ctrlrange="-90 90"': 'ctrlrange="-2 2"'},
    "keyframe-torque": {'ctrl=".2 -.5"': 'ctrl=".2 -.4"'},
    "clipped-control": {'forcerange="-4 4"': 'forcerange="-9 9"'},
    "activation-step": {'dyntype="filter"': 'dyntype="filterexact"'},
    "jaw-force": {'kp="2000"': 'kp="2000" forcerange="-10 10"'},
    "light-link": {'mass=".01"': 'mass="5"'},
    "pyramid-friction": {'friction="20"': 'friction="1.5"'},
    "hfield-cell": {'size="1 1 .1 .1"': 'size=".1 .1 .1 .1"'},
}
"""Replacements in a planted model that make a sound one, which is like it."""


@pytest.mark.parametrize("rule", SOUND)
def test_a_rule_finds_nothing_in_a_sound_model(linted: Linted, rule: str, tmp_path: Path) -> None:
    text = planted(CASES[rule], tmp_path)
    for old, new in SOUND[rule].items():
        assert old in text
        text = text.replace(old, new)
    assert rule not in rules_of(linted(text))


def test_motors_may_press(linted: Linted) -> None:
    """Jaws that a servo closes on each other press with many times their weight."""
    key = '<keyframe><key name="closed" qpos=".046 .046" ctrl=".05 .05"/></keyframe></mujoco>'
    text = _JAWS.replace("</mujoco>", key)
    assert "pressing" not in rules_of(linted(text))
    springs = text.replace('range="0 .05"/>', 'range="0 .05" stiffness="2000" springref=".05"/>')
    assert "pressing" not in rules_of(linted(springs))


@pytest.mark.parametrize("rule", CASES)
def test_a_rule_finds_its_defect_at_its_line(linted: Linted, rule: str, tmp_path: Path) -> None:
    case = CASES[rule]
    text = planted(case, tmp_path)
    found = only(linted(text), rule)
    assert case.line in text.splitlines()[found.line - 1]
    assert found.file in ("robot.xml", "robot.urdf")
    assert found.level == RULES[rule].level


@pytest.mark.parametrize("rule", [rule for rule, case in CASES.items() if case.mends])
def test_the_lines_of_a_remedy_end_the_finding(linted: Linted, rule: str, tmp_path: Path) -> None:
    before = linted(planted(CASES[rule], tmp_path))
    with linted_model(find_scene("robot.xml")) as model:
        files = apply_edits(RULES[rule].function(model))
    assert files
    for file, data in files.items():
        file.write_bytes(data)
    after = lint(["robot.xml"])
    assert rule not in rules_of(after)
    # Nothing else is wrong then that was not before.
    assert rules_of(after) <= rules_of(before)


def test_controls_that_a_keyframe_leaves_out_are_nobodys(linted: Linted) -> None:
    """They are 0, and clamped, which no author wrote."""
    text = ROBOT.replace('ctrlrange="-1 1"', 'ctrlrange=".5 1"')
    assert "keyframe-control" in rules_of(linted(text))
    assert "keyframe-control" not in rules_of(linted(text.replace(' ctrl="0"', "")))


def test_efforts_of_a_urdf_are_motors(linted: Linted) -> None:
    text = _URDF.replace('effort="0"', 'effort="5"')
    found = only(linted(text), "no-actuators")
    assert 'name="shoulder"' in text.splitlines()[found.line - 1]
    assert "attaches it" in found.message


def test_the_base_of_a_urdf_is_no_mount(linted: Linted) -> None:
    """A URDF says nothing of what its base stands on, an MJCF that fixes it means it."""
    ball = '<collision><origin xyz="{} 0 0"/><geometry><sphere radius=".1"/></geometry></collision>'
    text = _URDF.replace('<link name="base"/>', f'<link name="base">{ball.format(0)}</link>')
    text = text.replace('<link name="upper">', f'<link name="upper">{ball.format(0.05)}')
    assert rules_of(linted(text)) & {"parent-filter", "base-filter"} == {"parent-filter"}


def test_each_rule_has_a_case_and_a_fix() -> None:
    assert set(CASES) == set(RULES)
    assert [name for name, rule in RULES.items() if "Fix: " not in rule.details] == ["unread"]


LID = """<mujoco><option gravity="0 0 {gravity}"/><worldbody><body>
<joint name="lid" type="slide" axis="0 0 1" range="0 .05" damping="1"
  solreflimit=".1 1"/><geom size=".02" mass=".2"/></body></worldbody>
<keyframe><key name="start" qpos="{place}"/></keyframe></mujoco>"""
BLOCK = """<mujoco><option gravity="0 0 {gravity}"/><default><geom solref=".15 1"/></default>
<worldbody><geom type="plane" size="1 1 .1"/><body><joint type="slide" axis="0 0 1"/>
<geom name="block" type="box" size=".1 .1 .02" mass="2"/></body></worldbody>
<keyframe><key name="start" qpos="{place}"/></keyframe></mujoco>"""


@pytest.mark.parametrize(
    ("text", "above", "rule"), [(LID, 0.0, "keyframe-range"), (BLOCK, 0.02, "overlap")]
)
def test_what_rests_against_a_limit_or_a_floor_is_no_fault(
    linted: Linted, text: str, above: float, rule: str
) -> None:
    """A start in which plain MuJoCo came to rest is one, however deep; without weight it is not."""
    model = mujoco.MjModel.from_xml_string(text.format(gravity=-9.81, place=above))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(3 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    place = float(data.qpos[0])
    assert rule not in rules_of(linted(text.format(gravity=-9.81, place=place)))
    assert rule in rules_of(linted(text.format(gravity=0, place=place)))


def grows(xml: str, seconds: float = 0.2) -> bool:
    """Return whether plain MuJoCo makes a small motion a hundred times as large."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    data.qvel[:] = 1e-9
    most = 0.0
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        most = max(most, float(abs(data.qvel).max()))
    return most > 1e-7


SLIDER = """<mujoco><option timestep="{h}" integrator="{integrator}"/><worldbody><body>
<joint name="x" type="slide" damping="{d}" stiffness="{k}"/><geom size=".1" mass="1"/></body>
</worldbody><actuator><velocity joint="x" kv="{c}"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    "integrator",
    [
        "Euler",
        "implicitfast",
        pytest.param("RK4", marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize(
    ("k", "c", "d"),
    [
        (1e5, 300, 200),
        (0, 0, 1e4),
        pytest.param(1e5, 0, 0, marks=pytest.mark.long),
        pytest.param(0, 1e3, 0, marks=pytest.mark.long),
    ],
)
def test_the_step_that_holds_a_slider_is_where_plain_mujoco_begins_to_grow(
    linted: Linted, integrator: str, k: float, c: float, d: float
) -> None:
    for timestep in (0.5e-3, 1e-3, 2e-3, 4e-3, 5e-3, 7e-3, 10e-3, 20e-3):
        text = SLIDER.format(h=timestep, integrator=integrator, k=k, c=c, d=d)
        assert ("gain-step" in rules_of(linted(text))) == grows(text)


@pytest.mark.parametrize("timestep", ["nan", "inf", "0", "-1"])
def test_a_step_that_is_none_has_no_gains_to_hold(linted: Linted, timestep: str) -> None:
    found = rules_of(linted(SLIDER.format(h=timestep, integrator="Euler", k=1e5, c=0, d=0)))
    assert "option-value" in found
    assert "gain-step" not in found


def test_a_warning_of_the_engine_names_the_models_own_file(tmp_path: Path) -> None:
    """Lint compiles a copy of the model; MuJoCo warns of the copy's mesh."""
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\n"
    (tmp_path / "part.obj").write_text(
        f"{corners}f 1/9 2/9 3/9\nf 1/1 2/1 4/1\nf 1/1 3/1 4/1\nf 2/1 3/1 4/1\n"
    )
    model = tmp_path / "model.xml"
    mesh = '<mesh name="part" file="part.obj"/>'
    model.write_text(
        f"<mujoco><asset>{mesh}</asset><worldbody><body><freejoint/>"
        '<geom type="mesh" mesh="part"/></body></worldbody></mujoco>'
    )
    (warned,) = (each for each in lint([str(model)]).findings if each.name == "deprecated")
    assert f"'{tmp_path / 'part.obj'}'" in warned.message
