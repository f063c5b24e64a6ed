"""A written model is the one that is meant, in every field; what cannot be so is refused."""

import importlib.util
import os
import shutil
import stat
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.errors import OutputError, SceneError
from contactlab.mjcf import CONTACT
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.scene.parameters import PARAMETERS, WORDS
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import stored_scene

Write = Callable[[Path, Mapping[str, str]], None]
Differing = Callable[..., set[str]]
Change = Callable[[mujoco.MjSpec], None]

# One of each way in which MJCF makes several objects of an element, or one of several.
ROBOT = Path(__file__).parent / "written_model"
FILES = {
    name: (ROBOT / name).read_text(encoding="utf-8")
    for name in ("robot.xml", "parts/legs.xml", "parts/arm.xml")
}


@pytest.fixture
def robot(write_files: Write, tmp_path: Path) -> Scene:
    write_files(tmp_path / "own", FILES)
    return Scene.open(str(tmp_path / "own" / "robot.xml"))


def check_patch(scene: Scene, written: WrittenModel, folder: Path) -> None:
    """Apply the patch to the scene's files: they become the written ones, byte for byte."""
    content = scene.source.content
    content.copy_to(folder)
    start = folder / written.folder.relative_to(content.root)
    patch = ["patch", "-p1", "--binary"]
    done = subprocess.run(patch, input=written.patch, cwd=start, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    for file in content.files:
        same = written.path if file == content.model else written.source.content.root / file
        assert (folder / file).read_bytes() == same.read_bytes()


@pytest.fixture
def unlike(differing: Differing) -> Differing:
    """Return a comparison that names what two models differ in, but for where their files lie."""
    return lambda one, two: {
        each for each in differing(one, two) if "path" not in each and each != "nbuffer"
    }


def compiled(path: Path, change: Change = lambda _: None) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(path))
    change(spec)
    return spec.compile()


def named(spec: mujoco.MjSpec, name: str) -> list[mujoco.MjsGeom]:
    return [each for each in spec.geoms if name in each.name]


def mask(spec: mujoco.MjSpec) -> None:
    for geom in named(spec, "shin"):
        geom.contype = geom.conaffinity = 0


def reshape(spec: mujoco.MjSpec) -> None:
    spec.add_exclude(bodyname1="leg", bodyname2="left_arm")
    spec.delete(spec.sensors[1])


def free_turn(spec: mujoco.MjSpec) -> None:
    spec.option.timestep, spec.option.integrator = 0.00123456789, mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity[:] = 0, 0, -1.625
    spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_INVDISCRETE
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    spec.joints[[each.name for each in spec.joints].index("knee")].damping[0] = 1 / 3


def rub(spec: mujoco.MjSpec) -> None:
    spec.pairs[0].condim = 6
    spec.pairs[0].solimp = [0.8, 0.9, 0.01, 0.4, 3]
    for geom in named(spec, "hand"):
        geom.friction[:] = 0.1, 0.2, 0.3


CASES: Mapping[str, tuple[ModelEdits, Change]] = {
    "nothing": (ModelEdits(), lambda _: None),
    "a mask": (ModelEdits(masked=("shin",)), mask),
    "parts": (
        ModelEdits(
            excluded=(("leg", "left_arm"),),
            sensors=("sensor[1]",),
        ),
        reshape,
    ),
    "options": (
        ModelEdits(
            {
                "timestep": 0.00123456789,
                "integrator": "RK4",
                "gravity": 1.625,
                "invdiscrete": True,
                "midphase": False,
                "dof_damping[knee]": 1 / 3,
            }
        ),
        free_turn,
    ),
    "fields": (
        ModelEdits(
            {
                "pair_dim[rub]": 6,
                "pair_solimp[rub]": (0.8, 0.9, 0.01, 0.4, 3.0),
                "geom_friction[left_hand]": (0.1, 0.2, 0.3),
                "geom_friction[right_hand]": (0.1, 0.2, 0.3),
            }
        ),
        rub,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_written_model_is_the_meant_one(
    case: str, robot: Scene, tmp_path: Path, unlike: Differing
) -> None:
    edits, change = CASES[case]
    written = write_model(robot, edits, tmp_path / "out", "tuned.xml")
    assert written.path.name == "tuned.xml"
    meant = compiled(tmp_path / "own" / "robot.xml", change)
    assert unlike(compiled(written.path), meant) == set()
    check_patch(robot, written, tmp_path / "patched")


def test_written_files_have_the_permissions_of_new_files(robot: Scene, tmp_path: Path) -> None:
    """A folder that exists keeps its own, whatever those of temporary files are."""
    folder = tmp_path / "out"
    folder.mkdir(mode=0o750)
    before = os.umask(0o027)
    try:
        written = write_model(robot, ModelEdits({"timestep": 0.004}), folder / "new", "tuned.xml")
        write_model(robot, ModelEdits({"timestep": 0.004}), folder, "tuned.xml")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (folder, folder / "new", written.path)]
    assert modes == [0o750, 0o750, 0o640]
    assert stat.S_IMODE(written.path.with_suffix(".patch").stat().st_mode) == 0o640


def test_contact_parameters_reach_every_monitored_geom(
    robot: Scene, tmp_path: Path, unlike: Differing
) -> None:
    settings = {"solref": (0.0123, 1.1), "condim": 6, "margin": 0.002}
    written = write_model(robot, ModelEdits(settings), tmp_path / "out")
    base = robot.base({})
    meant = compiled(tmp_path / "own" / "robot.xml")
    for name, value in settings.items():
        half = np.array(value) / 2 if name == "margin" else value
        getattr(meant, f"geom_{name}")[list(base.targets.geoms)] = half
        getattr(meant, {"condim": "pair_dim"}.get(name, f"pair_{name}"))[:] = value
    mujoco.mj_setConst(meant, mujoco.MjData(meant))
    assert unlike(compiled(written.path), meant) == set()
    check_patch(robot, written, tmp_path / "patched")


SETTINGS = {
    "timestep": 1e-3 / 3,
    "integrator": "RK4",
    "cone": "elliptic",
    "solver": "CG",
    "jacobian": "dense",
    "impratio": 10.0,
    "gravity": (0.1, 0.2, -3.0),
    "iterations": 7,
    "tolerance": 1e-11,
    "ls_iterations": 9,
    "ls_tolerance": 0.02,
    "noslip_iterations": 3,
    "noslip_tolerance": 1e-5,
    "ccd_iterations": 11,
    "sdf_iterations": 13,
    "sdf_initpoints": 14,
    "ccd_tolerance": 1e-7,
    "density": 1.2,
    "viscosity": 2e-5,
    "solref": (-160000.0, -144.7),
    "solimp": (0.8, 0.97, 0.002, 0.4, 3.0),
    "friction": (0.7, 0.006, 2e-4),
    "condim": 6,
    "margin": 1e-3,
    "gap": 5e-4,
}


def test_every_parameter_arrives_exactly(tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(
        '<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>'
        '<body><freejoint/><geom name="ball" size=".1"/></body></worldbody></mujoco>'
    )
    scene = Scene.open(str(tmp_path / "own.xml"))
    words = {"restitution", "stiffness", "depth_at_rest"}  # which become solref and solimp
    assert {*SETTINGS} == {name for name in PARAMETERS if "." not in name} - words
    written = compiled(write_model(scene, ModelEdits(SETTINGS), tmp_path / "out").path)
    for name, value in SETTINGS.items():
        if name in CONTACT:
            half = np.array(value, float) / 2 if name in ("margin", "gap") else value
            assert np.array_equal(np.ravel(getattr(written.geom("ball"), name)), np.ravel(half))
        else:
            found = getattr(written.opt, name)
            assert np.array_equal(WORDS[name][found] if name in WORDS else found, value)


TEXTS = {
    "carriage returns": lambda text: text.replace("\n", "\r\n"),
    "no newline at the end": lambda text: text.rstrip(),
    "one line": lambda text: text.replace("\n", " "),
    "byte order mark": lambda text: "\ufeff" + text,
    "letters of many bytes": lambda text: text.replace("behind", "dahinter \u2192 \u00e4\u00f6"),
    "document type": lambda text: text.replace("<mujoco", "<!DOCTYPE mujoco>\n<mujoco", 1),
}


ACTUATED = """<mujoco><worldbody><body name="cup"><joint name="hinge" damping="1"/>
  <geom size=".1"/></body></worldbody>
  <tendon><fixed name="cord" limited="true" range="-1 1" frictionloss=".1">
  <joint joint="hinge" coef="1"/></fixed></tendon>
  <actuator>{}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("actuator", "settings"),
    [
        ('<position {} kp="9" kv="2"/>', {"gainprm": (4,), "biasprm": (0, -4, -1)}),
        ('<velocity {} kv="9"/>', {"gainprm": (4,), "biasprm": (0, 0, -4)}),
        (
            '<intvelocity {} actrange="-1 1" kp="9" kv="2"/>',
            {"gainprm": (4,), "biasprm": (0, -4, -1)},
        ),
        ('<damper {} kv="9" ctrlrange="0 1"/>', {"gainprm": (0, 0, -4)}),
        ('<cylinder {} area="9"/>', {"gainprm": (4,)}),
        ('<general {} gainprm="9"/>', {"gainprm": (4,)}),
        ('<adhesion name="own" body="cup" gain="9" ctrlrange="0 1"/>', {"gainprm": (4,)}),
    ],
)
def test_gains_are_written_as_their_actuator_has_them(
    actuator: str, settings: Mapping[str, tuple[float, ...]], tmp_path: Path
) -> None:
    """Writing refuses what makes another model than is meant."""
    names = 'name="own" joint="hinge"'
    (tmp_path / "own.xml").write_text(ACTUATED.format(actuator.format(names)))
    meant = {
        f"actuator_{field}[own]": (*values, *(10 - len(values)) * (0.0,))
        for field, values in settings.items()
    }
    scene = Scene.open(str(tmp_path / "own.xml"))
    written = compiled(write_model(scene, ModelEdits(meant), tmp_path / "out").path)
    for field, values in settings.items():
        found = getattr(written, f"actuator_{field}")[0, : len(values)]
        assert found == pytest.approx(values)


@pytest.mark.parametrize("own", ["solref_lim", "solimp_lim", "solref_fri", "solimp_fri"])
def test_softness_of_a_tendon_is_written(own: str, tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(ACTUATED.format(""))
    scene = Scene.open(str(tmp_path / "own.xml"))
    value = (0.05, 0.7) if "solref" in own else (0.8, 0.97, 0.002, 0.4, 3.0)
    edits = ModelEdits({f"tendon_{own}[cord]": value})
    written = compiled(write_model(scene, edits, tmp_path / "out").path)
    assert getattr(written, f"tendon_{own}")[0] == pytest.approx(value)


def test_an_option_does_not_rewrite_muscles(tmp_path: Path) -> None:
    """Their lengths are found by simulation, by the integrator that is changed: to rounding."""
    (tmp_path / "arm.xml").write_text("""<mujoco><worldbody><body>
      <joint name="elbow" axis="0 1 0" limited="true" range="-60 70" damping=".3"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .3 .01 .02"/></body></worldbody>
      <actuator><muscle name="pull" joint="elbow"/></actuator></mujoco>""")
    scene = Scene.open(str(tmp_path / "arm.xml"))
    made = write_model(scene, ModelEdits({"integrator": "implicitfast"}), tmp_path / "new")
    assert "implicitfast" in "".join(made.lines)


@pytest.mark.parametrize("form", TEXTS)
def test_what_is_not_changed_stays_byte_for_byte(form: str, tmp_path: Path) -> None:
    text = """<?xml version="1.0"?>
<mujoco>
  <option cone='elliptic'><flag midphase="disable"/></option><!-- behind -->
  <worldbody>
    <geom name='a > "b"' type="plane" size="1 1 1" condim='4' />
    <body><freejoint/><geom size=".1"/></body>
  </worldbody>
</mujoco>
"""
    (tmp_path / "own").mkdir()
    path = tmp_path / "own" / "a model.xml"
    path.write_bytes(TEXTS[form](text).encode())
    scene, edits = Scene.open(str(path)), {"condim": 6, "cone": "pyramidal", "midphase": True}
    written = write_model(scene, ModelEdits(edits), tmp_path / "out")
    expected = text.replace("elliptic'", 'pyramidal"').replace("cone='", 'cone="')
    expected = expected.replace('"disable"', '"enable"').replace("condim='4'", 'condim="6"')
    expected = expected.replace('size=".1"', 'size=".1" condim="6"')
    assert written.path.read_bytes() == TEXTS[form](expected).encode()
    check_patch(scene, written, tmp_path / "patched")


def test_elements_that_are_added_and_removed(tmp_path: Path) -> None:
    text = """<mujoco>
  <worldbody>
    <body name="one"><freejoint/><geom size=".1"/></body>
    <body name="two"><freejoint/><geom size=".1"/></body>
  </worldbody>
  <sensor>
    <clock/>
    <accelerometer name="gone" site="none"/>
  </sensor>
</mujoco>
""".replace('name="two">', 'name="two"><site name="none"/>')
    (tmp_path / "own.xml").write_text(text)
    edits = ModelEdits({"timestep": 0.001}, excluded=(("one", "two"),), sensors=("gone",))
    written = write_model(Scene.open(str(tmp_path / "own.xml")), edits, tmp_path / "out")
    gone, end = '    <accelerometer name="gone" site="none"/>\n', "</mujoco>\n"
    added = ['<option timestep="0.001"/>', '<contact><exclude body1="one" body2="two"/></contact>']
    expected = text.replace(gone, "").replace(end, "".join(f"  {each}\n" for each in added) + end)
    assert written.path.read_text() == expected
    assert [(each.line, each.element) for each in written.changes] == [
        (8, ""),
        *((10, each) for each in added),
    ]


@pytest.mark.parametrize("indent", ["\t", "    ", ""])
def test_what_is_added_is_indented_as_its_neighbours_are(tmp_path: Path, indent: str) -> None:
    body = '{}<body name="{}"><freejoint/><geom size=".1"/></body>\n'
    text = f"<mujoco>\n{indent}<worldbody>\n" + "".join(
        body.format(2 * indent, name) for name in ("one", "two")
    )
    text += f"{indent}</worldbody>\n</mujoco>\n"
    (tmp_path / "own.xml").write_text(text)
    edits = ModelEdits({}, excluded=(("one", "two"),))
    written = write_model(Scene.open(str(tmp_path / "own.xml")), edits, tmp_path / "out")
    (added,) = set(written.path.read_text().splitlines()) - set(text.splitlines())
    expected = indent or "  "  # a file without any has two spaces
    assert added == f'{expected}<contact><exclude body1="one" body2="two"/></contact>'


def test_a_scene_keeps_its_manifest_and_its_structure(
    make_scene: Callable[..., Scene], tmp_path: Path, unlike: Differing
) -> None:
    model = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
      <replicate count="2" offset="0 0 .2"><body name="box"><freejoint/>
        <geom type="box" size=".05 .05 .05"/></body></replicate></worldbody></mujoco>"""
    manifest = """effects: {multiccd: true}
structure:
  boxes:
    {default: 3, unit: "1", description: d, element: .//replicate, attribute: count, integer: true}
"""
    scene = make_scene(model, manifest)
    settings = {"friction.slide": 0.7, "timestep": 0.001}
    written = Scene(write_model(scene, ModelEdits(settings), tmp_path / "out", "tuned.xml").source)
    for boxes in (3, 5):
        run = scene.resolve({**settings, "boxes": boxes}, 0, None)
        meant = scene.prepare(run, scene.initial_states([run])).model
        run = written.resolve({"boxes": boxes}, 0, None)
        assert unlike(written.prepare(run, written.initial_states([run])).model, meant) == set()
    with pytest.raises(SceneError, match=r"scene.yaml: cannot write 'boxes'"):
        write_model(scene, ModelEdits({"boxes": 4}), tmp_path / "other")


def test_a_urdf_becomes_mjcf_of_the_same_numbers(
    write_files: Write, tmp_path: Path, unlike: Differing
) -> None:
    mesh = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    third = "0.3333333333333333"
    robot = f"""<robot name="arm">
  <link name="base"><collision><geometry><box size=".1 .1 {third}"/></geometry></collision></link>
  <link name="arm"><inertial><mass value="{third}"/>
      <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><mesh filename="package://arm/part.obj"/></geometry></collision></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>
    <origin rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
    write_files(tmp_path / "arm", {"urdf/arm.urdf": robot, "part.obj": mesh})
    scene = Scene.open(str(tmp_path / "arm" / "urdf" / "arm.urdf"))
    settings = {"timestep": 0.003, "dof_damping[hinge]": 0.1}
    written = write_model(scene, ModelEdits(settings), tmp_path / "out", "tuned.xml")
    assert (written.path.name, written.patch) == ("tuned.xml", b"")
    assert {each.file for each in written.changes} == {"tuned.xml"}
    meant = scene.base({}).prepare(scene.resolve(settings, 0, None).list_edits()).model
    again = Scene(written.source)
    assert unlike(again.base({}).prepare({}).model, meant) == set()


def test_what_is_left_is_a_store_s_copy_too(robot: Scene, tmp_path: Path) -> None:
    robot.source.content.copy_to(tmp_path / "copy")
    copy = Scene(stored_scene(tmp_path / "copy", "robot.xml", "robot"))
    edits = ModelEdits({"timestep": 0.001}, masked=("shin",))
    one, two = (write_model(each, edits, tmp_path / each.name) for each in (robot, copy))
    assert (one.patch, one.changes) == (two.patch, two.changes)


REFUSED: Mapping[str, tuple[ModelEdits, str]] = {
    "one of three": (
        ModelEdits(masked=("geom[4]",)),
        r"geom_conaffinity of geom 'geom\[5\]' \(from the same element as 'geom\[4\]'\)",
    ),
    "one of two attached": (
        ModelEdits({"geom_condim[left_hand]": 6}),
        r"condim of geom 'right_hand' \(from the same element as 'left_hand'\): it would be 6",
    ),
    "no geom": (ModelEdits(masked=("skin",)), "no geom 'skin' in the model; did you mean 'shin'"),
    "no sensor": (ModelEdits(sensors=("angel",)), "no sensor 'angel'.*did you mean 'angle'"),
    "no attribute": (
        ModelEdits({"jnt_range[knee]": (-1.0, 0.3)}),
        "cannot write jnt_range of joint 'knee'",
    ),
    "a free joint": (
        ModelEdits({"dof_damping[ball0]": 0.1}),
        "no joint named|which no element has for itself",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_written_is_refused_by_name(case: str, robot: Scene, tmp_path: Path) -> None:
    edits, reason = REFUSED[case]
    with pytest.raises((SceneError, ValueError), match=reason):
        write_model(robot, edits, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_model_of_one_file_takes_a_changed_copy_next_to_it(tmp_path: Path) -> None:
    own = tmp_path / "ball.xml"
    own.write_text(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    text = own.read_text()
    edits = ModelEdits({"timestep": 0.001})
    written = write_model(Scene.open(str(own)), edits, tmp_path, "fixed.xml")
    assert mujoco.MjModel.from_xml_path(str(written.path)).opt.timestep == 0.001
    assert own.read_text() == text
    assert {path.name for path in tmp_path.iterdir()} == {"ball.xml", "fixed.xml", "fixed.patch"}


def test_a_scene_is_not_written_over(robot: Scene, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is the folder of the scene"):
        write_model(robot, ModelEdits(), tmp_path / "own")
    shutil.copy(tmp_path / "own" / "parts" / "legs.xml", tmp_path / "own" / "legs.xml")
    model = (tmp_path / "own" / "robot.xml").read_text().replace("parts/legs", "legs")
    (tmp_path / "own" / "robot.xml").write_text(model)
    scene = Scene.open(str(tmp_path / "own" / "robot.xml"))
    with pytest.raises(OutputError, match=r"has another file legs\.xml"):
        write_model(scene, ModelEdits(), tmp_path / "out", "legs.xml")


def test_a_folder_with_other_scenes_does_not_change_the_written_one(
    robot: Scene, tmp_path: Path
) -> None:
    other = tmp_path / "out" / "checkout" / "other"
    other.mkdir(parents=True)
    (other / "scene.yaml").write_text(
        "version: 1\ntitle: t\ndescription: d\nduration: 1\nmodel: scene.xml\n"
    )
    (other / "scene.xml").write_text("<mujoco/>")
    written = write_model(robot, ModelEdits({"timestep": 0.001}), tmp_path / "out", "new.xml")
    assert written.path == tmp_path / "out" / "new.xml"


ROBOTS = {
    "menagerie": "franka_emika_panda/scene.xml",
    "gymnasium": "envs/mujoco/assets/humanoid.xml",
    "gymnasium_robotics": "envs/assets/fetch/pick_and_place.xml",
    "robosuite": "models/assets/robots/sawyer/robot.xml",
    "dm_control": "suite/quadruped.xml",
}


def robot_file(package: str) -> Path:
    """Return a robot's file: of an installed package, or of one that ROBOT_WHEELS has."""
    if package == "menagerie":
        place = os.environ.get("MENAGERIE_ROOT")
    elif (wheels := os.environ.get("ROBOT_WHEELS")) and Path(wheels, package).is_dir():
        place = str(Path(wheels, package))
    else:
        spec = importlib.util.find_spec(package)
        place = next(iter(spec.submodule_search_locations or ()), None) if spec else None
    if place is None:
        pytest.skip(f"no robots of {package} here")
    return Path(place, ROBOTS[package])


@pytest.mark.night
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("package", ROBOTS)
def test_robots_as_they_are_published(package: str, tmp_path: Path, unlike: Differing) -> None:
    path = robot_file(package)
    scene = Scene.open(str(path))
    model = scene.base({}).model
    last = int(np.flatnonzero((model.geom_contype > 0) & (model.geom_conaffinity > 0))[-1])
    hinge = int(np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE))[-1])
    stiffness = f"jnt_stiffness[{model.joint(hinge).name}]"
    settings = {"timestep": 0.00123, "cone": "elliptic", stiffness: 0.7}
    settings |= {"solref": (0.0123, 1.1)} if scene.base({}).pairs else {}
    edits = ModelEdits(settings, masked=(model.geom(last).name,))
    written = write_model(scene, edits, tmp_path / "out")

    def change(spec: mujoco.MjSpec) -> None:
        spec.geoms[last].contype = spec.geoms[last].conaffinity = 0

    meant, targets = compiled(path, change), scene.base({}).targets
    meant.opt.timestep, meant.opt.cone = 0.00123, mujoco.mjtCone.mjCONE_ELLIPTIC
    meant.jnt_stiffness[hinge] = 0.7
    meant.geom_solref[list(targets.geoms)] = 0.0123, 1.1
    meant.pair_solref[list(targets.explicit)] = 0.0123, 1.1
    assert unlike(compiled(written.path), meant) == set()
    check_patch(scene, written, tmp_path / "patched")
