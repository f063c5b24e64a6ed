"""What shipped models look like decides nothing of their physics."""

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import pytest

from contactlab import resources
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

LOOKS = ("visual", "asset")
SWEEP = "{{version: 1, scene: {scene}, duration: {duration}, trace: none, axes: {{{axis}}}}}"


def strip(path: Path) -> None:
    """Take lights, materials, groups and all geoms that are only looked at out of a file."""
    tree = ET.parse(path)  # noqa: S314 - our own
    for parent in list(tree.iter()):
        for child in list(parent):
            if child.tag in {*LOOKS, "light"} or child.get("class") == "look":
                parent.remove(child)
        for attribute in ("material", "group"):
            parent.attrib.pop(attribute, None)
    tree.write(path)


def hashes(folder: Path, scene: Path, duration: float, axis: str) -> list[str | None]:
    text = SWEEP.format(scene=scene, duration=duration, axis=axis)
    ask = read_request(text, "looked", folder, folder=scene.parent, workers=0)
    run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
    return [record.trajectory_hash for record in Store.open(folder).records()]


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "duration", "axis"),
    [("grasp_mug", 0.5, "shape: [1, 2]"), ("mug_drop", 0.4, "solref: ['0.005 1', '0.02 0.2']")],
)
def test_looks_change_no_bit_of_a_trajectory(
    tmp_path: Path, scene: str, duration: float, axis: str
) -> None:
    found: list[list[str | None]] = []
    for name in ("as shipped", "plain"):
        models = tmp_path / name
        for each in ("grasp_mug", "mug_drop"):
            shutil.copytree(resources.MODELS / each, models / each)
        if name == "plain":
            for path in models.rglob("*.xml"):
                strip(path)
        found.append(hashes(tmp_path / f"{name} runs", models / scene, duration, axis))
    assert found[0] == found[1]
    assert None not in found[0]
    assert len({*found[0]}) == 2


def test_the_hand_has_fingers_that_can_be_seen() -> None:
    """Between palm and pad, where a gap was: parts that weigh nothing and touch nothing."""
    model = mujoco.MjModel.from_xml_path(str(resources.MODELS / "grasp_mug" / "scene.xml"))
    for side in ("left", "right"):
        finger = model.geom(f"{side}_finger")
        assert (finger.contype, finger.conaffinity) == (0, 0)
        bottom, top = (finger.pos[2] + sign * finger.size[2] for sign in (-1, 1))
        palm = model.geom("palm")
        assert top >= palm.pos[2] - palm.size[2]
        assert bottom <= model.geom(side).size[2]
