"""The models of public wheels, as their authors wrote them, and robosuite's arms with grippers.

The robots of example-robot-data are URDF: what MuJoCo cannot compile of them is named, and left
out. The Panda of MENAGERIE_ROOT is among the models where that folder is known.

Nothing depends on these packages. They are looked for where ROBOT_WHEELS says, or among those that
are installed. Files that repeat another's text are left out; a mere part of a model has no verdict.
"""

import hashlib
import importlib.util
import os
import re
import shutil
import sys
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco

PACKAGES = ("mujoco", "gymnasium", "gymnasium_robotics", "dm_control", "robosuite")
_URDF = "cmeel.prefix/share/example-robot-data"
_AS_URDF = """<mujoco><compiler strippath="false" discardvisual="true" balanceinertia="true"/>
</mujoco>"""
_ARMS = "robosuite/models/assets/robots"
_GRIPPERS = "robosuite/models/assets/grippers"
# As robosuite pairs them, but for grippers that this MuJoCo refuses to compile.
_HANDS = {
    "baxter": {"right_hand": "rethink_gripper", "left_hand": "rethink_gripper"},
    "iiwa": {"right_hand": "robotiq_gripper_140"},
    "jaco": {"right_hand": "jaco_three_finger_gripper"},
    "kinova3": {"right_hand": "robotiq_gripper_140"},
    "panda": {"right_hand": "panda_gripper"},
    "sawyer": {"right_hand": "rethink_gripper"},
    "spot_arm": {"right_hand": "bd_gripper"},
    "tiago": {"right_hand": "robotiq_gripper_140", "left_hand": "robotiq_gripper_140"},
    "ur5e": {"right_hand": "robotiq_gripper_s"},
    "xarm7": {"right_hand": "inspire_right_hand"},
}


@dataclass(frozen=True)
class PublicModel:
    """A model and what it is called: its package, and its place there."""

    name: str
    path: Path


def public_models(folder: Path, pattern: str) -> list[PublicModel]:
    """Return the models whose name has a pattern; those that are put together go into a folder."""
    found = [model for model in (*_found(), *_menagerie()) if pattern in model.name]
    return [*found, *_with_grippers(folder, pattern), *_from_urdf(folder, pattern)]


def moves(path: Path) -> bool:
    """Return whether a file is a whole model that can move; many are parts of others."""
    try:
        return mujoco.MjModel.from_xml_path(str(path)).nv > 0
    except ValueError:
        return False


def _place(package: str) -> Path | None:
    folder = os.environ.get("ROBOT_WHEELS")
    if folder and (Path(folder) / package).is_dir():
        return Path(folder) / package
    spec = importlib.util.find_spec(package)
    return Path(next(iter(spec.submodule_search_locations or ()))) if spec else None


def _say(text: str) -> None:
    print(text, file=sys.stderr)  # noqa: T201


def _found() -> Iterator[PublicModel]:
    seen: set[str] = set()
    for package in PACKAGES:
        place = _place(package)
        if place is None:
            _say(f"{package} is left out: not installed, nor in the folder ROBOT_WHEELS")
            continue
        for path in sorted(place.rglob("*.xml")):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            if digest not in seen:
                seen.add(digest)
                yield PublicModel(f"{package}/{path.relative_to(place)}", path)


def _menagerie() -> Iterator[PublicModel]:
    root = os.environ.get("MENAGERIE_ROOT")
    for path in sorted(Path(root).rglob("*.xml")) if root else ():
        yield PublicModel(f"menagerie/{path.relative_to(root or '.')}", path)


def _from_urdf(folder: Path, pattern: str) -> Iterator[PublicModel]:
    """Yield the robots of example-robot-data, written as MJCF; their base is fixed."""
    share = Path(os.environ.get("ROBOT_WHEELS", ".")) / _URDF
    if not share.is_dir():
        _say("example-robot-data is left out: not in the folder ROBOT_WHEELS")
    for path in sorted(share.rglob("*.urdf")):
        robot = path.parent.parent.name.removesuffix("_description")
        name = f"example-robot-data/{robot}/{path.name}"
        if pattern in name:
            written = folder / f"{robot}_{path.stem}.xml"
            try:
                _write_urdf(path, share, written)
            except (OSError, ValueError) as error:
                _say(f"{name} cannot be compiled: {' '.join(str(error).split())}")
            else:
                yield PublicModel(name, written)


def _write_urdf(path: Path, share: Path, written: Path) -> None:
    text = path.read_text(encoding="utf-8")
    text = re.sub("package:/+example-robot-data", str(share), text)
    text = re.sub(r"(<robot\b[^>]*>)", rf"\1{_AS_URDF}", text, count=1)
    model = mujoco.MjModel.from_xml_string(text)
    mujoco.mj_saveLastXML(str(written), model)
    saved = written.read_text(encoding="utf-8")
    balanced = saved.replace("<compiler ", '<compiler balanceinertia="true" ', 1)
    written.write_text(balanced, encoding="utf-8")
    spec = _spec(written, written.with_suffix(""))
    spec.compile()
    written.write_text(spec.to_xml(), encoding="utf-8")


def _with_grippers(folder: Path, pattern: str) -> Iterator[PublicModel]:
    robosuite = _place("robosuite")
    if robosuite is None:
        return
    for arm, hands in _HANDS.items():
        name = f"robosuite/{arm}_with_gripper"
        if pattern not in name:
            continue
        try:
            path = _joined(robosuite.parent, arm, hands, folder / f"{arm}_with_gripper")
        except (KeyError, OSError, ValueError) as error:
            _say(f"{arm} and its gripper cannot be joined: {error}")
        else:
            yield PublicModel(name, path)


def _joined(wheels: Path, arm: str, hands: Mapping[str, str], place: Path) -> Path:
    """Write an arm that holds its grippers, and return its file."""
    place.mkdir()
    robot = _spec(wheels / _ARMS / arm / "robot.xml", place / "arm")
    for body, hand in hands.items():
        gripper = _spec(wheels / _GRIPPERS / f"{hand}.xml", place / body)
        robot.attach(gripper, f"{body}_", frame=robot.body(body).add_frame())
    path = place / "robot.xml"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Gravity of robot and gripper may differ.
        robot.compile()
        path.write_text(robot.to_xml(), encoding="utf-8")
    return path


def _spec(path: Path, folder: Path) -> mujoco.MjSpec:
    """Read a model and copy its files to where it can be joined to another."""
    spec = mujoco.MjSpec.from_file(str(path))
    folder.mkdir()
    for group, place in {"meshes": spec.meshdir, "textures": spec.texturedir}.items():
        for number, asset in enumerate(getattr(spec, group)):
            if asset.file:
                source = path.parent / place / asset.file
                copy = folder / f"{group}_{number}{source.suffix}"
                shutil.copyfile(source, copy)
                asset.file = f"{folder.name}/{copy.name}"
    spec.modelfiledir = str(folder.parent)
    spec.meshdir = spec.texturedir = ""
    return spec
