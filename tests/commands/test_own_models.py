"""A user's own models and scenes: found, run, kept with the store, and told what is wrong."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

Run = Callable[..., Any]

MODELS = Path(__file__).parent / "own_models"
BOX = (MODELS / "box.xml").read_text(encoding="utf-8")
BARE = (MODELS / "bare.xml").read_text(encoding="utf-8")
MESH = (MODELS / "mesh.xml").read_text(encoding="utf-8")
WEDGE = (MODELS / "wedge.obj").read_text(encoding="utf-8")
URDF = (MODELS / "arm.urdf").read_text(encoding="utf-8")
PENDULUM = (MODELS / "pendulum.xml").read_text(encoding="utf-8")
MANIFEST = """version: 1
title: A box
description: It lies on the floor.
duration: 0.1
subject: box
pairs: [{geoms: [floor, box], slots: 4}]
"""
SWEEP = """version: 1
scene: SCENE
duration: 0.05
axes: AXES
"""


def write(folder: Path, **files: str) -> None:
    for name, text in files.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)


def sweep_of(folder: Path, scene: str, axes: str = "{timestep: [1.0e-3, 2.0e-3]}") -> str:
    text = SWEEP.replace("SCENE", scene).replace("AXES", axes)
    (folder / "own.yaml").write_text(text)
    return "own.yaml"


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "files", "stored"),
    [
        ("box.xml", {"box_xml": BOX}, {"box.xml"}),
        ("bare.xml", {"bare_xml": BARE}, {"bare.xml"}),
        ("pendulum.xml", {"pendulum_xml": PENDULUM}, {"pendulum.xml"}),
        ("arm.urdf", {"arm_urdf": URDF}, {"arm.urdf"}),
        (
            "./own/mesh.xml",
            {"own__mesh_xml": MESH, "own__notes_txt": "mine"},
            {"mesh.xml", "parts/wedge.obj"},
        ),
        (
            "./own",
            {"own__scene_xml": BOX, "own__scene_yaml": MANIFEST},
            {"scene.xml", "scene.yaml"},
        ),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_models_run_and_replay(
    contactlab: Run, tmp_path: Path, scene: str, files: dict[str, str], stored: set[str]
) -> None:
    write(tmp_path, **files)
    if "parts/wedge.obj" in stored:
        (tmp_path / "own/parts").mkdir()
        (tmp_path / "own/parts/wedge.obj").write_text(WEDGE)
    sweep = sweep_of(tmp_path, scene)
    code, _, err = contactlab("sweep", sweep, "-o", "store", "--workers", "0")
    assert (code, err) == (0, "")
    assert find_problems(tmp_path / "store") == []
    (kept,) = (tmp_path / "store/scenes").iterdir()
    assert {path.relative_to(kept).as_posix() for path in kept.rglob("*.*")} == stored
    for path in tmp_path.glob("own*"):
        path.rename(tmp_path / ("gone " + path.name))
    (run, _) = Store.open(tmp_path / "store").table["run_id"].to_pylist()
    assert contactlab("verify", "store", run)[0] == 0


@pytest.mark.parametrize(
    ("scene", "files", "messages"),
    [
        ("gone.xml", {}, ["no model file gone.xml"]),
        ("./gone", {}, ["gone"]),
        ("torn.xml", {"torn_xml": "<mujoco><worldbody>"}, ["torn.xml:1:20: not XML"]),
        (
            "cube.xml",
            {"cube_xml": BOX.replace('"box" size', '"cube" size')},
            ["cube.xml:6: does not compile", "type of <geom> cannot be 'cube'"],
        ),
        ("mesh.xml", {"mesh_xml": MESH}, ["mesh.xml", "wedge.obj"]),
        (
            "./own",
            {
                "own__scene_xml": BOX,
                "own__scene_yaml": MANIFEST.replace("[floor, box]", "[a, box]"),
            },
            ["no geom 'a' in the model"],
        ),
        (
            "./own",
            {"own__scene_xml": BOX, "own__scene_yaml": MANIFEST.replace(": box", ": bax")},
            ["subject 'bax' is not a body of the model"],
        ),
        (
            "./own",
            {"own__scene_xml": BOX, "own__scene_yaml": MANIFEST + "colour: red\n"},
            ["colour"],
        ),
        ("./own", {"own__scene_xml": BOX, "own__scene_yaml": "pairs: ["}, ["not YAML"]),
        ("./own", {"own__scene_xml": BOX}, ["has no scene.yaml"]),
        (
            "box.xml",
            {"box_xml": BOX.replace("<worldbody>", '<option timestep="0"/><worldbody>')},
            ["its timestep is 0 s; write a positive one there, or sweep `timestep`"],
        ),
        (
            "box.xml",
            {"box_xml": BOX.replace("<worldbody>", '<option timestep="nan"/><worldbody>')},
            ["its timestep is nan s"],
        ),
    ],
)
def test_mistakes_are_told(
    contactlab: Run, tmp_path: Path, scene: str, files: dict[str, str], messages: list[str]
) -> None:
    write(tmp_path, **files)
    sweep = sweep_of(tmp_path, scene, axes="{cone: [elliptic]}")
    code, out, err = contactlab("sweep", sweep, "-o", "store", "--workers", "0")
    assert (code, out) == (2, "")
    assert err.startswith("error")
    assert all(message in err for message in messages), err
    assert "Traceback" not in err
    assert len(err.splitlines()) <= 8
    assert not (tmp_path / "store").exists()


@pytest.mark.long
@pytest.mark.parametrize("scene", ["ball_drop", "box_slide", "box_stack", "box.xml"])
def test_a_starter_file_runs(contactlab: Run, tmp_path: Path, scene: str) -> None:
    write(tmp_path, box_xml=BOX)
    code, out, err = contactlab("init", scene)
    assert (code, out) == (0, "")
    assert "next: contactlab sweep sweep.yaml" in err
    before = (tmp_path / "sweep.yaml").read_text()
    code, out, err = contactlab("init", scene)
    assert (code, err) == (2, "error: sweep.yaml exists; choose another file with -o\n")
    assert (tmp_path / "sweep.yaml").read_text() == before
    short = ("--set", "duration=0.02", "--limit", "3", "--workers", "0")
    code, _, err = contactlab("sweep", "sweep.yaml", *short)
    assert (code, err) == (0, "")


UNNAMED = PENDULUM.replace(
    "</mujoco>",
    """  <option timestep="0.004" integrator="implicitfast" cone="elliptic"/>
  <actuator><motor joint="hinge" gear="5"/></actuator>
  <keyframe><key qpos="1"/></keyframe>
</mujoco>""",
)


@pytest.mark.long
@pytest.mark.parametrize("scene", ["pendulum.xml", "models/arm.xml", "box"])
def test_a_starter_file_may_lie_anywhere(contactlab: Run, tmp_path: Path, scene: str) -> None:
    write(tmp_path, box__scene_yaml=MANIFEST, box__scene_xml=BOX, sweeps__here="")
    write(tmp_path, pendulum_xml=UNNAMED, models__arm_xml=UNNAMED)
    bare = scene.endswith(".xml")
    code, _, err = contactlab("init", scene, "-o", "sweeps/own.yaml")
    # Three timesteps, two integrators, two cones and three seeds; with contact, two solrefs.
    assert (code, f", {36 if bare else 72} runs of" in err) == (0, True)
    text = (tmp_path / "sweeps" / "own.yaml").read_text()
    assert f'scene: "../{scene}' in text
    assert ("\ndrive: auto" in text, "[0.004, 0.002, 0.008]" in text) == (bare, bare)
    assert ('# keyframe: ["key[0]", qpos0]' in text) == bare
    assert contactlab("sweep", "sweeps/own.yaml", "--plan")[0] == 0


@pytest.mark.long
def test_a_keyframe_without_a_name_is_chosen_by_an_option(contactlab: Run, tmp_path: Path) -> None:
    write(tmp_path, pendulum_xml=UNNAMED)
    sweep_of(tmp_path, "pendulum.xml", '{keyframe: ["key[0]", qpos0]}')
    for option in ("--set", "--where"):
        assert (
            contactlab("sweep", "own.yaml", option, "keyframe=key[0]", "-o", "s" + option)[0] == 0
        )
        assert Store.open(tmp_path / ("s" + option)).table["keyframe"].to_pylist() == ["key[0]"]
    assert contactlab("examine", "pendulum.xml", "--keyframe", "key[0]", "--check", "task")[0] < 2


def test_a_folder_that_is_not_there_is_told(contactlab: Run, tmp_path: Path) -> None:
    write(tmp_path, pendulum_xml=PENDULUM)
    code, _, err = contactlab("init", "pendulum.xml", "-o", "nowhere/own.yaml")
    assert (code, err.splitlines()[0][:39]) == (2, "error: cannot write nowhere/own.yaml: N")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["init", "bal_drop"], "error: no shipped scene named 'bal_drop'; did you mean 'ball_dr"),
        (["init", "-o", "nowhere/sweep.yaml"], "error: cannot write nowhere/sweep.yaml: No such"),
        (
            ["list", "axes", "box_slid"],
            "error: no shipped scene named 'box_slid'; did you mean 'box_s",
        ),
        (["list", "axes", "gone.xml"], "error: no model file gone.xml"),
        (["list", "lables"], "error: there is no list 'lables'; did you mean 'labels'?"),
        (["list", "axes"], "error: list axes: name a scene too"),
        (["list", "labels", "ball_drop"], "error: only axes belong to a scene"),
        (["balldrop"], "error: no command, model or shipped scene 'balldrop'; did you mean 'ball"),
        (["swep", "bounce"], "error: no command, model or shipped scene 'swep'; did you mean 'sw"),
        (["list", "schemas", "swep"], "error: no schema 'swep'; did you mean 'sweep'?"),
        (["list", "schemas", "--write", "/proc/here"], "error: cannot write /proc/here"),
    ],
)
def test_mistakes_of_other_commands(
    contactlab: Run, tmp_path: Path, arguments: list[str], message: str
) -> None:
    code, out, err = contactlab(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.parametrize(
    "arguments",
    [[], ["axes", "ball_drop"], ["scenes"], ["sweeps"], ["metrics"], ["labels"], ["limits"]],
)
def test_lists_in_both_formats(contactlab: Run, arguments: list[str]) -> None:
    arguments = ["list", *arguments]
    code, out, err = contactlab(*arguments)
    assert (code, err) == (0, "")
    code, listed, err = contactlab(*arguments, "--format", "json")
    assert (code, err) == (0, "")
    rows = json.loads(listed)
    assert len(rows) >= 3
    for row in rows:
        assert str(next(iter(row.values()))) in out


@pytest.mark.long
def test_schemas(contactlab: Run, tmp_path: Path) -> None:
    listed = json.loads(contactlab("list", "schemas", "--format", "json")[1])
    names = [f"{row['schema']}.schema.json" for row in listed]
    assert "record.schema.json" in names
    for name in ("record.schema.json", "sweep"):
        assert json.loads(contactlab("list", "schemas", name)[1])["$schema"]
    assert contactlab("list", "schemas", "--write", "out")[0] == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(names)
