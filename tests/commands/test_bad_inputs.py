"""A hundred and more bad inputs: each gives an error with its place, and what to write instead."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from tests.commands.bad_files import FILES, MODELS, SWEEPS

from contactlab.plan.mistakes import MISTAKES
from contactlab.plan.sweep_file import read_sweep
from contactlab.run.sweep_request import SceneLoader

Run = Callable[..., Any]


class Bad(NamedTuple):
    """A command line, where its error says the mistake is, and what it says to write."""

    words: str
    place: str
    remedy: str
    code: int = 2


# Of parsers, libraries and the interpreter; and of MuJoCo's own C.
FOREIGN = re.compile(
    r"Traceback|pydantic|Input should|Field required|Value error|Extra inputs|validation error|"
    r"flow sequence|block mapping|stream end|while (?:scanning|parsing)|simple key|"
    r"mj_|mjMINVAL|mjOBJ|XML Error|^\s*Error:|Schema violation|"
    r"NoneType|KeyError|ValueError|TypeError|invalid literal|could not convert|Errno|<class|"
    r"No such option|Got unexpected|Usage:"
)
SWEPT = "sweep {} --plan"

FRONT_DOOR = [
    Bad("nosuch.xml", "no model file nosuch.xml", "did you mean"),
    Bad("soun.xml", "no model file soun.xml", "did you mean 'sound.xml'?"),
    Bad("nowhere/a.xml", "no model file nowhere/a.xml", "there is no folder nowhere"),
    Bad("swep grasp", "'swep'", "did you mean 'sweep'?"),
    Bad("ball_dorp", "'ball_dorp'", "did you mean 'ball_drop'?"),
    Bad("nonsense", "'nonsense'", "see contactlab --help"),
    Bad("sound.yaml", "sound.yaml", "`contactlab sweep sound.yaml`"),
    Bad("robot.txt", "robot.txt", "name an .xml or .urdf file"),
    Bad("nothing-here", "nothing-here", "name an .xml or .urdf file"),
    Bad("robot.xacro", "robot.xacro", "`xacro robot.xacro > robot.urdf`"),
    Bad("robot.urdf.xacro", "robot.urdf.xacro", "`xacro robot.urdf.xacro > robot.urdf`"),
    Bad("in-disguise.urdf", "in-disguise.urdf", "expand it first: `xacro"),
    Bad("robot.usd", "robot.usd", "export it as MJCF or URDF"),
    Bad("robot.usda", "robot.usda", "export it as MJCF or URDF"),
    Bad("robot.sdf", "robot.sdf", "export it as MJCF or URDF"),
    Bad("robot.mjb", "robot.mjb", "name the MJCF or URDF"),
    Bad("robot.mjcf", "robot.mjcf", "rename it to robot.xml"),
    Bad("/dev/null", "/dev/null: not a model", "name an .xml or .urdf file"),
    Bad("hand.obj", "hand.obj", "<mesh file='hand.obj'/>"),
    Bad("menagerie:frank_emika_panda", "'frank_emika_panda'", "did you mean 'franka_emika_panda'?"),
]
OF_MODELS = [
    Bad("list-key", "list-key/scene.yaml: not YAML of a manifest", "a key is a list or a mapping"),
    Bad("empty.xml", "empty.xml:1:1: not XML: the file is empty", "<mujoco>...</mujoco>"),
    Bad("empty.urdf", "empty.urdf:1:1: not XML: the file is empty", "<robot>...</robot>"),
    Bad("text.xml", "text.xml:1:1: not XML", "<mujoco>...</mujoco>"),
    Bad("html.xml", "html.xml: does not compile", "MJCF begins with <mujoco>"),
    Bad("unclosed.xml", "unclosed.xml:3:1", "ends before all of its elements do"),
    Bad("unknown-element.xml", "unknown-element.xml:2", "did you mean 'geom'?"),
    Bad("unknown-attribute.xml", "unknown-attribute.xml:2", "did you mean 'type'?"),
    Bad("unknown-word.xml", "unknown-word.xml:2", "did you mean 'box'?"),
    Bad("no-number.xml", "no-number.xml:2", "separate numbers by spaces"),
    Bad("few-numbers.xml", "few-numbers.xml:2", "a number above 0 in place 3"),
    Bad("no-mass.xml", "body 'ghost'", "give it a geom, or <inertial>"),
    Bad("no-mesh.xml", "'hand.stl'", 'compiler meshdir="FOLDER"'),
    Bad("package.urdf", "hand.stl", "put it there, or say where it is"),
    Bad("no-asset.xml", "no-asset.xml:2", "add <asset><mesh name='hand'"),
    Bad("no-include.xml", "arm.xml", "put it there, or name another"),
    Bad("own-include.xml", "own-include.xml: is included", "remove that element"),
    Bad("own-model.xml", "attached within itself", "remove that element"),
    Bad("endless.xml", "gravity is 0 0 -inf", "but must be finite; see <option gravity"),
    Bad("negative.xml", "impratio is -1", "but must be above 0; see <option impratio"),
    Bad("joint-type.urdf", "type of <joint> cannot be 'revolte'", "did you mean 'revolute'?"),
    Bad("outside.xml", "/etc/hostname lies outside", "contactlab --allow-files /etc"),
    Bad("twice.xml", "twice.xml:2", "give it another name"),
    Bad("no-joint.xml", "moves 'knee'", "add it"),
    Bad("nothing.xml", "nothing.xml", "give a body a <joint/> or <freejoint/>"),
    Bad("static.xml", "static.xml", "give a body a <joint/> or <freejoint/>"),
    Bad("no-links.urdf", "no-links.urdf", "a floating joint to a link named world"),
    Bad("nothing.xml --section checks", "nothing.xml", "give a body a <joint/>"),
    Bad("nothing.xml --section labels", "nothing.xml", "give a body a <joint/>"),
    Bad("effects nothing.xml", "nothing.xml", "give a body a <joint/>"),
    Bad("tune nothing.xml", "nothing.xml", "give a body a <joint/>"),
    Bad("init nothing.xml", "nothing.xml", "give a body a <joint/>"),
    Bad("init robot.xacro", "robot.xacro", "`xacro robot.xacro > robot.urdf`"),
    Bad("init empty.xml", "empty.xml:1:1", "the file is empty"),
    Bad("init stepless.xml", "its timestep is nan s", "write one above 0 there"),
    Bad("lint nosuch.xml", "no model file nosuch.xml", "did you mean"),
]
OF_OPTIONS = [
    Bad("no-keyframe.xml --keyframe home", "--keyframe home", "runs start at qpos0"),
    Bad("sound.xml --keyframe hmoe", "--keyframe hmoe", "did you mean 'home'?"),
    Bad("sound.xml --keyframe 7", "--keyframe 7", "write one of home, qpos0"),
    Bad("sound.xml --drive exercis", "--drive exercis", "did you mean 'exercise'?"),
    Bad("sound.xml --drive nosie=0.3", "--drive nosie=0.3", "noise=0.3,rate=10"),
    Bad("sound.xml --drive hold=3", "--drive hold=3", "write auto, none, hold"),
    Bad("sound.xml --drive controls.csv", "controls.csv", "the folder"),
    Bad("sound.xml --drive p.py:Policy --allow-code", "p.py", "the folder"),
    Bad("sound.xml --duration 2lightyears", "--duration 2lightyears", "write 2s or 500ms"),
    Bad("sound.xml --duration -1s", "--duration -1s", "write 2s or 500ms"),
    Bad("sound.xml --duration", "--duration needs a value", "contactlab examine --help"),
    Bad("sound.xml --observe crat", "'crat'", "did you mean 'crate'?"),
    Bad("sound.xml --tolerance 1kg", "--tolerance 1kg", "write a share or a length"),
    Bad("sound.xml --tolerance -1%", "--tolerance -1%", "write a share or a length"),
    Bad("sound.xml --tolerance 20", "--tolerance 20", "write 20% or a share"),
    Bad("compare sound.xml text.xml", "stores", "contactlab diff sound.xml text.xml", code=3),
    Bad("sound.xml --tolerance much", "--tolerance much", "write a share or a length"),
    Bad("sound.xml --tolerance slip=1mm", "no limit 'slip'", "did you mean 'hold_slip'?"),
    Bad(
        "sound.xml --tolerance penetration_max=1kg",
        "penetration_max",
        "a number in m",
    ),
    Bad(
        "sound.xml --require 'held(mugg)'",
        "held(mugg)",
        "write held(mug, by: hand)",
    ),
    Bad("sound.xml --require 'still('", "still(", "write still(box, 1 mm)"),
    Bad("sound.xml --require 'stil(crate)'", "'stil'", "did you mean 'still'?"),
    Bad("sound.xml --require 'still(crat)'", "still(crat)", "did you mean 'crate'?"),
    Bad("sound.xml --set timestp=1ms", "--set timestp=1ms", "did you mean 'timestep'?"),
    Bad("sound.xml --set timestep=fast", "--set timestep=fast", "write a number"),
    Bad("sound.xml --set timestep", "--set timestep", "NAME=VALUE"),
    Bad("sound.xml --set timestep=-1", "--set timestep=-1", "a number above 0"),
    Bad("sound.xml --set timestep=1kg", "--set timestep=1kg", "a number in s"),
    Bad("sound.xml --set cone=eliptic", "--set cone=eliptic", "did you mean 'elliptic'?"),
    Bad("sound.xml --set solref=0.02", "--set solref=0.02", "2 numbers (timeconst dampratio)"),
    Bad("sound.xml --workers all", "--workers all", "a whole number of at least 0"),
    Bad("sound.xml --workers -1", "--workers -1", "a whole number of at least 0"),
    Bad("sound.xml --format xml", "--format xml", "write one of text, full, json"),
    Bad("sound.xml --dutation 2s", "--dutation", "did you mean '--duration'?"),
    Bad("sound.xml other.xml", "other.xml", "the folder"),
    Bad("examine", "needs MODEL", "contactlab examine --help"),
    Bad("sound.xml -o nowhere/a.json", "nowhere/a.json", "choose another folder with -o"),
    Bad("sound.xml -o folder.json", "folder.json", "write the name of a file"),
    Bad("sound.xml --write sound.xml", "sound.xml exists", "choose another file with --write"),
    Bad("sound.xml --write a.urdf", "--write a.urdf", "write a name as new.xml"),
    Bad("sound.xml --write a.xml --section budget", "no fix is tried", "add --section fixes"),
    Bad("sound.xml --write /proc/a.xml", "/proc/a.xml", "choose another file with --write"),
    Bad("sound.xml --observe nobody", "'nobody'", "it has: "),
    Bad("sound.xml --drive noise=-1", "--drive noise=-1", "write a number greater than 0"),
    Bad("sound.xml --drive kp=a,kd=1", "--drive kp=a,kd=1: kp", "kp: write a valid number"),
    Bad("explain sound.xml", "sound.xml", "examine MODEL --section contacts"),
    Bad("stability sound.xml", "sound.xml", "examine sound.xml --section labels"),
    Bad("sound.xml --section contacts --set timestep=3", "a step of 3 s", "a timestep of at most"),
    Bad("list schemas nothing", "'nothing'", "there are sweep, scene"),
    Bad("tune sound.xml --set timestep=1ms", "'--set'", "contactlab tune --help"),
    Bad("tune sound.xml --figure /proc/a.svg", "/proc/a.svg", "cannot write"),
    Bad("sound.xml --plugin nosuch.py", "nosuch.py", "the folder"),
    Bad("sound.xml --plugin broken.py", "broken.py", "line 1"),
    Bad("compare a", "needs CANDIDATE", "contactlab compare --help"),
    Bad("compare a b --until tomorrow", "--until tomorrow", "such as 2030-12-31"),
    Bad("baseline update a b", "'baseline'", "compare BASELINE CANDIDATE --update"),
    Bad("tune sound.xml --apply far-pairs=near", "far-pairs, length near", "such as 5cm or 0.05"),
    Bad("tune sound.xml --max-cpu soon", "--max-cpu soon", "such as 90s, 5min or 1h"),
    Bad(
        "tune sound.xml --error 1kg", "--error 1kg", "write a share of the real forces, such as 2%"
    ),
    Bad("tune sound.xml --error-at start", "--error-at start", "end, peak"),
    Bad("tune sound.xml --error-at end", "--error-at needs", "--observe BODY"),
    Bad("tune sound.xml --figure a.bmp", "a.bmp", ".png or .svg"),
    Bad("tradeoff sound.xml", "is a model", "Write contactlab tune sound.xml"),
    Bad("sound.xml --check contat", "'contat'", "there are task,"),
    Bad("sound.xml --waive nosuch.yaml", "nosuch.yaml", "the folder"),
    Bad("effects sound.xml --metric reality", "--metric needs a scene", "with a recording"),
    Bad("effects cube_toss --metric reality --max-cpu 5s", "--max-cpu does not", "Leave one"),
    Bad("effects sound.xml --write sound.xml", "sound.xml exists", "choose another file"),
    Bad("effects sound.xml --write new.mjb", "--write new.mjb", "write a name as new.xml"),
    Bad("fit ball_drop", "ball_drop", "needs a `recording`"),
    Bad("fit cube_toss --free frction", "--free frction", "did you mean 'friction'?"),
    Bad("fit cube_toss --fitted 1", "--fitted 1", "a whole number of at least 2"),
    Bad("parity grasp", "give SWEEP", "--against ENGINE"),
    Bad("parity grasp --against newton2", "'newton2'", "did you mean 'newton'?"),
    Bad("parity --from nowhere", "nowhere has no bundle.json", "`--bundle`", 3),
    Bad("parity --install brx", "'brx'", "if a plug-in adds it, load the plug-in"),
    Bad("list axs", "'axs'", "did you mean 'axes'?"),
    Bad("list axes", "list axes", "`contactlab list axes SCENE`"),
    Bad("list axes ball_dorp", "'ball_dorp'", "did you mean 'ball_drop'?"),
    Bad("list schemas swep", "'swep'", "did you mean 'sweep'?"),
    Bad("stability tower_2", "'tower_2'", "did you mean 'tower_20'?"),
    Bad("explain chattr", "'chattr'", "did you mean 'chatter'?"),
    Bad("sound.xml --section contacts --set solref=stiff", "solref=stiff", "write 2 numbers"),
    Bad(
        "sound.xml --section contacts --set depth_at_rest=1kg",
        "depth_at_rest=1kg",
        "a number above 0 in m",
    ),
    Bad("explain depth_at_ret", "'depth_at_ret'", "did you mean 'depth_at_rest'?"),
]
OF_SWEEPS = [
    Bad("sweep nosuch.yaml", "no sweep file nosuch.yaml", "the folder"),
    Bad("sweep bounc", "'bounc'", "did you mean 'bounce'?"),
    Bad("sweep sound.xml", "sound.xml is a model", "`contactlab init sound.xml`"),
    Bad("lock sound.xml", "sound.xml is a model", "`contactlab init sound.xml`"),
    Bad("lock sound.yaml --check", "sound.lock.yaml", "write it by `contactlab lock`"),
    Bad("bisect nosuch.yaml --good 3.11.0 --bad 4.0.0", "nosuch.yaml", "the folder"),
    Bad("sweep sound.yaml --set timestep=[", "--set timestep=[", "write ]"),
    Bad("sweep sound.yaml --where timestep=7", "--where timestep=7", "it takes 0.001, 0.002"),
    Bad("sweep sound.yaml --where timestp=1", "--where timestp=1", "did you mean 'timestep'?"),
    Bad("sweep sound.yaml --limit 0", "--limit 0", "a whole number of at least 1"),
    Bad("sweep sound.yaml --executor cluster", "'cluster'", "installed are local"),
    Bad("sweep sound.yaml --mujoco latest", "'latest'", "such as 3.17.0"),
    Bad("sweep sound.yaml -o robot.txt", "robot.txt", "choose another folder with -o"),
    Bad("sweep sound.yaml -o s3:/bucket", "s3:/bucket", "write s3://BUCKET/PREFIX"),
    Bad("init sound.xml -o sound.yaml", "sound.yaml exists", "choose another file with -o"),
    Bad("init sound.xml -o nowhere/a.yaml", "nowhere/a.yaml", "choose another folder with -o"),
    Bad("show nosuch", "no store at nosuch", "`contactlab sweep` writes one", 3),
    Bad("show sound.yaml", "no store at sound.yaml", "a store is a folder", 3),
    Bad("report nothing-here -o p.html", "nothing-here", "`contactlab sweep` writes one", 3),
    Bad("compare nosuch nothing-here", "no store at nosuch", "`contactlab sweep` writes one", 3),
    Bad("render nosuch 1 -o run.avi", "run.avi", "end its name in .gif"),
]
# The file, the line and column of its mistake, and what it says to write.
IN_FILES = {
    "empty": ("1:1", "begin with `version: 1`"),
    "comments": ("1:1", "begin with `version: 1`"),
    "list": ("1:1", "begin with `version: 1`"),
    "words": ("1:1", "begin with `version: 1`"),
    "tabs": ("4:1", "indent with spaces"),
    "unclosed": ("4:1", "write ]"),
    "twice": ("4:1", "first given in line 3"),
    "binary": ("", "write it as YAML"),
    "no-version": ("1:1", "add version: 1"),
    "version-2": ("1:10", "write 1"),
    "no-scene": ("1:1", "add scene: NAME"),
    "scene-typo": ("2:8", "did you mean 'ball_drop'?"),
    "scene-xacro": ("2:8", "`xacro robot.xacro > robot.urdf`"),
    "scene-usd": ("2:8", "export it as MJCF or URDF"),
    "key-typo": ("4:1", "did you mean 'axes'?"),
    "axis-typo": ("4:8", "did you mean 'timestep'?"),
    "axis-empty": ("4:18", "write some, or leave the axis out"),
    "axis-word": ("4:19", "write a number"),
    "axis-number": ("4:18", "write [0.001]"),
    "axis-negative": ("4:19", "write a number above 0"),
    "axis-choice": ("4:15", "did you mean 'elliptic'?"),
    "axis-keyframe": ("4:8", "runs start at qpos0"),
    "axis-unit": ("4:19", "write a number in s"),
    "axis-short": ("4:17", "write 2 numbers"),
    "axes-list": ("4:7", "write axes: {timestep: [1e-3, 2e-3]}"),
    "range-zero": ("4:26", "write [first, last, step]"),
    "log-negative": ("4:30", "write a number above 0"),
    "lin-two": ("4:29", "write {linspace: [first, last, count]}"),
    "form-typo": ("4:19", "did you mean 'linspace'?"),
    "uniform-alone": ("4:8", "add sample: {method: sobol, n: 64}"),
    "duration-unit": ("3:11", "write 2 or 2s"),
    "duration-negative": ("3:11", "write 2 or 2s"),
    "no-oracle": ("4:14", "leave it out"),
    "tolerance-typo": ("4:14", "did you mean 'slip_distance'?"),
    "tolerance-unit": ("4:31", "one with the unit of this metric"),
    "label-typo": ("4:18", "did you mean 'stable'?"),
    "metric-typo": ("4:21", "did you mean 'penetration_max'?"),
    "where-typo": ("5:19", "did you mean 'timestep'?"),
    "formula": ("5:30", "write one such as timestep > 1e-3"),
    "formula-name": ("5:20", "did you mean 'timestep'?"),
    "formula-call": ("5:20", "the functions are abs"),
    "all-excluded": ("5:1", "exclude less"),
    "seeds": ("4:8", "write a count above 0"),
    "trace": ("4:8", "write all, flagged, none, sample:N or flagged+sample:N"),
    "sample": ("5:18", "did you mean 'sobol'?"),
    "include": ("5:17", "relative names start at the sweep's folder"),
    "zip": ("4:42", "give each as many values"),
    "drive-typo": ("4:8", "did you mean 'exercise'?"),
    "drive-key": ("4:8", "{noise: SHARE, rate: HZ}"),
    "drive-file": ("", "no file controls.csv"),
    "drive-policy": ("", "no file policy.py"),
    "must": ("4:8", "write held(mug, by: hand)"),
}


def in_file(name: str, place: str, remedy: str) -> Bad:
    file = f"{name}.yaml"
    return Bad(SWEPT.format(file), f"{file}:{place}" if place else "", remedy)


CASES = [
    *(*FRONT_DOOR, *OF_MODELS, *OF_OPTIONS, *OF_SWEEPS),
    *(in_file(name, *said) for name, said in IN_FILES.items()),
]


@pytest.fixture(scope="module")
def brought(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all of the files, which no error may change."""
    folder = tmp_path_factory.mktemp("brought")
    for name, content in FILES.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def listing(folder: Path) -> list[tuple[str, int]]:
    """Return all files and folders below a folder, with the times at which files changed."""
    paths = sorted(folder.rglob("*"))
    return [(str(path), path.stat().st_mtime_ns if path.is_file() else 0) for path in paths]


@pytest.mark.parametrize("bad", CASES, ids=lambda bad: bad.words)
def test_an_error_says_where_and_what_to_write(
    contactlab: Run, brought: Path, monkeypatch: pytest.MonkeyPatch, bad: Bad
) -> None:
    monkeypatch.chdir(brought)
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    before = listing(brought)
    code, out, err = contactlab(*shlex.split(bad.words))
    assert (code, out) == (bad.code, "")
    assert bad.place in err
    assert bad.remedy in err
    assert not FOREIGN.search(err)
    assert err.startswith("error")
    assert listing(brought) == before


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("little-memory.xml", "error: MuJoCo cannot simulate the model: its contacts need more"),
        ("effects little-memory.xml", "error: no part of the motion can be judged"),
    ],
)
def test_lost_contacts_end_in_an_error(
    contactlab: Run, brought: Path, monkeypatch: pytest.MonkeyPatch, words: str, error: str
) -> None:
    monkeypatch.chdir(brought)
    code, out, err = contactlab(*words.split())
    assert (code, out) == (2, "")
    assert error in err
    assert not FOREIGN.search(err)


def test_there_are_a_hundred_and_all_files_are_among_them() -> None:
    said = " ".join(bad.words for bad in CASES)
    assert len(CASES) >= 100
    assert {name for name in (*MODELS, *SWEEPS) if Path(name).parts[0] not in said} == set()


WITH_UNITS = """version: 1
scene: ball_drop
duration: 10 ms
timeout: 2min
tolerances: {penetration_max: 1 mm, oracle_error: 1%}
thresholds: {penetration_steady: 2cm}
expect: [{metrics: {penetration_max: {max: 5mm}}, mean: {final_speed: {min: 1 mm/s}}}]
"""
WITHOUT = """version: 1
scene: ball_drop
duration: 0.01
timeout: 120
tolerances: {penetration_max: 1.0e-3, oracle_error: 0.01}
thresholds: {penetration_steady: 0.02}
expect: [{metrics: {penetration_max: {max: 5.0e-3}}, mean: {final_speed: {min: 1.0e-3}}}]
"""


def test_numbers_with_units_are_those_in_si(tmp_path: Path) -> None:
    vocabulary = SceneLoader(tmp_path).vocabulary
    assert read_sweep(WITH_UNITS, vocabulary).sweep == read_sweep(WITHOUT, vocabulary).sweep


def test_every_mistake_is_explained(contactlab: Run) -> None:
    code, out, err = contactlab("explain", *MISTAKES)
    assert (code, err) == (0, "")
    assert all(f"{name}: a mistake in a sweep file" in out for name in MISTAKES)
