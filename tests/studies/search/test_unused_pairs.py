"""What never touches: masks leave every state as it was, and luck of one run decides nothing."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.studies.verification.planted import BARE_JAWS

from contactlab.engines import engine_of
from contactlab.engines.engine import Buffers, PreparedRuns
from contactlab.modifications.unused_pairs import exclusion_edits, pairs_within, unreachable_edits
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.scene import Scene
from contactlab.scene.unreachable import filtered_pairs, unreachable_pairs

# An arm that turns by 1.5 rad either way, a post at 1.4 rad, a wall out of reach, a lamp above all;
# and a box on the floor, which may be anywhere.
WORKSHOP = """<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <geom name="wall" type="box" size="0.1 2 2" pos="4 0 0"/>
    <geom name="post" type="capsule" size="0.03" fromto="0.153 0.887 0 0.153 0.887 1.2"/>
    <body name="arm" pos="0 0 1">
      <joint name="shoulder" axis="0 0 1" range="-1.5 1.5" damping="10"/>
      <geom name="arm" type="capsule" size="0.05" fromto="0.1 0 0 0.8 0 0"/>
      <body name="lamp" pos="0 0 3"><geom name="lamp" size="0.1" pos="0.5 0 0"/></body>
      <body name="hand" pos="0.9 0 0">
        <joint name="wrist" axis="1 0 0" range="-1 1" damping="1"/>
        <geom name="hand" type="box" size="0.05 0.1 0.02"/>
      </body>
    </body>
    <body name="box" pos="-2 0 0.1"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
  </worldbody>
  <actuator>
    <position joint="shoulder" kp="300" ctrlrange="-1.5 1.5"/>
    <position joint="wrist" kp="20" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
Runs = list[NDArray[np.float64]]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("workshop") / "workshop.xml"
    path.write_text(WORKSHOP)
    return path


def driven(path: Path, seeds: range) -> Runs:
    """Return (T, nq) configurations of exercised runs."""
    scene = Scene.open(str(path)).with_drive("exercise", Path())
    runs = PreparedRuns.of(scene, *[scene.resolve({}, seed, None) for seed in seeds])
    rollout = engine_of(runs.resolved[0]).roll_out(runs, Buffers())
    return [np.array(each[:, 1 : 1 + runs.models[0].nq]) for each in rollout.state]


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(WORKSHOP)


@pytest.fixture(scope="module")
def runs(workshop: Path) -> Runs:
    return driven(workshop, range(3))


def test_without_runs_proofs_remain(model: mujoco.MjModel) -> None:
    """No joint brings anything to the wall or the floor; the arm may get to the post."""
    found = unreachable_edits(model, [])
    assert found.masked == ()
    assert found.excluded == (("world", "arm"), ("world", "lamp"))
    assert len(unreachable_pairs(model, filtered_pairs(model))) == 8


def test_what_kept_apart_in_all_runs_is_no_proof(model: mujoco.MjModel, runs: Runs) -> None:
    """The exercise stops short of the post, which the hand can reach."""
    found = unreachable_edits(model, runs)
    assert ("world", "hand") not in found.excluded
    assert found == unreachable_edits(model, [])


def edited(text: str, found: ModelEdits) -> str:
    """Return a model without what never touches."""
    for name in found.masked:
        text = text.replace(
            f'<geom name="{name}"', f'<geom name="{name}" contype="0" conaffinity="0"'
        )
    pairs = (f'<exclude body1="{one}" body2="{other}"/>' for one, other in found.excluded)
    return text.replace("</mujoco>", f"<contact>{''.join(pairs)}</contact></mujoco>")


ALONE = re.sub('(?s)<geom name="post".*?/>|<body name="box".*?</body>', "", WORKSHOP)


@pytest.mark.long
@pytest.mark.parametrize(("text", "masks"), [(WORKSHOP, False), (ALONE, True)])
def test_without_them_states_stay_bit_equal_from_fresh_seeds(
    tmp_path: Path, text: str, *, masks: bool
) -> None:
    """Nothing is masked that the box may hit; without box and post, all is."""
    written, path = tmp_path / "written.xml", tmp_path / "edited.xml"
    written.write_text(text)
    found = unreachable_edits(mujoco.MjModel.from_xml_string(text), driven(written, range(3)))
    assert bool(found.masked) == masks
    path.write_text(edited(text, found))
    assert not masks or not filtered_pairs(mujoco.MjModel.from_xml_path(str(path)))
    seeds = range(100, 103)
    for one, other in zip(driven(written, seeds), driven(path, seeds), strict=True):
        np.testing.assert_array_equal(one, other)


def test_pads_of_a_gripper_stay_collidable() -> None:
    """Pads that cannot touch each other touch an object that is not in the file."""
    model = mujoco.MjModel.from_xml_string(BARE_JAWS)
    assert set(unreachable_edits(model, []).masked) == {"left", "right"}
    found = unreachable_edits(model, [], with_masks=False)
    assert found.masked == ()
    assert found.excluded == (("left", "right"),)


def test_pairs_come_near_as_the_distance_of_all_geoms_says(workshop: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(workshop))
    data, near = mujoco.MjData(model), set[tuple[int, int]]()
    distance, runs = 0.3, [run[::40] for run in driven(workshop, range(1))]
    for qpos in np.concatenate(runs):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        near |= {
            pair
            for pair in filtered_pairs(model)
            if mujoco.mj_geomDistance(model, data, *pair, 10.0, None) <= distance
        }
    found = pairs_within(model, runs, distance)
    assert found is not None
    # Margins of both geoms count: at most twice the distance, at least that.
    assert near <= found
    assert found <= {
        pair for pair in filtered_pairs(model) if pair in near or is_near(model, runs, pair, 0.6)
    }


def is_near(model: mujoco.MjModel, runs: Runs, pair: tuple[int, int], distance: float) -> bool:
    data = mujoco.MjData(model)
    for qpos in np.concatenate(runs):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        if mujoco.mj_geomDistance(model, data, *pair, 10.0, None) <= distance:
            return True
    return False


def test_what_stays_apart_is_told_by_what_nothing_comes_near(workshop: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(workshop))
    runs, pairs = driven(workshop, range(2)), filtered_pairs(model)
    near = pairs_within(model, runs, 0.05)
    assert near is not None
    edits = exclusion_edits(model, pairs, {pair for pair in pairs if pair not in near})
    # The box lies on the floor, and nothing comes near the wall or the lamp.
    assert {"wall", "lamp"} <= {*edits.masked}
    assert not {"box", "floor"} & {*edits.masked}


@pytest.mark.skipif(
    int(mujoco.__version__.partition(".")[0]) < 4,
    reason="older versions raise where memory is too small for contacts",
)
def test_where_contacts_find_no_room_nothing_is_said(workshop: Path) -> None:
    text = workshop.read_text().replace("<worldbody>", '<size memory="8K"/><worldbody>', 1)
    model = mujoco.MjModel.from_xml_string(text)
    assert pairs_within(model, [np.array(model.qpos0)[None]], 3.0) is None
