"""What has no name in a model has an address, the same wherever a name is read or printed."""

from collections.abc import Callable

import mujoco
import pytest

from contactlab.errors import SceneError
from contactlab.scene.model_names import (
    coordinate_indices,
    match_coordinates,
    match_names,
    name_by_address,
    part_starts,
)
from contactlab.scene.scene import Scene

Make = Callable[..., Scene]
# Only the second of each kind has a name; the third geom is taken away with what is only seen.
MODEL = """
<mujoco>
  <compiler fusestatic="{fuse}" discardvisual="{discard}"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body><geom name="mount" size=".1" pos="2 0 1"/></body>
    <body pos="0 0 1">
      <freejoint/>
      <geom size=".05" contype="0" conaffinity="0" mass="0"/>
      <geom size=".1"/>
      <body pos="0 0 .3"><joint name="elbow"/><geom size=".1"/></body>
      <body name="hand" pos=".3 0 0"><joint axis="0 1 0"/><geom size=".1"/></body>
    </body>
    <body mocap="true"/>
  </worldbody>
  <tendon><fixed><joint joint="elbow" coef="1"/></fixed></tendon>
  <equality><joint joint1="elbow"/></equality>
  <actuator>
    <motor joint="elbow"/><motor name="pull" joint="elbow"/><motor joint="elbow"/>
  </actuator>
  <keyframe><key/><key name="home"/><key/></keyframe>
</mujoco>
"""
PLAIN = MODEL.format(fuse="false", discard="false")
KINDS = ("body", "joint", "geom", "tendon", "equality", "actuator", "key")
COUNTS = ("nbody", "njnt", "ngeom", "ntendon", "neq", "nu", "nkey")


def names(model: mujoco.MjModel) -> dict[str, list[str]]:
    return {
        kind: [getattr(model, kind)(index).name for index in range(getattr(model, count))]
        for kind, count in zip(KINDS, COUNTS, strict=True)
    }


@pytest.mark.parametrize("fuse", ["false", "true"])
@pytest.mark.parametrize("discard", ["false", "true"])
def test_the_number_is_the_id_in_mujoco(fuse: str, discard: str) -> None:
    """Also where the compiler takes bodies and geoms away."""
    text = MODEL.format(fuse=fuse, discard=discard)
    spec = mujoco.MjSpec.from_string(text)
    name_by_address(spec)
    plain, addressed = names(mujoco.MjModel.from_xml_string(text)), names(spec.compile())
    for kind in KINDS:
        expected = [name or f"{kind}[{index}]" for index, name in enumerate(plain[kind])]
        assert addressed[kind] == expected


def test_an_address_that_is_taken_is_left_to_its_owner() -> None:
    spec = mujoco.MjSpec.from_string(PLAIN.replace('name="mount"', 'name="geom[0]"'))
    name_by_address(spec)
    assert names(spec.compile())["geom"][:3] == ["geom[0]_", "geom[0]", "geom[2]"]


@pytest.mark.parametrize(
    ("pattern", "field", "indices"),
    [
        ("actuator[0].ctrl", "ctrl", [0]),
        ("actuator[*].ctrl", "ctrl", [0, 2]),
        ("*.ctrl", "ctrl", [0, 1, 2]),
        ("joint[0].z", "qpos", [2]),
        ("joint[2]", "qpos", [8]),
        ("hand", "qpos", [8]),
        ("joint[2].v", "qvel", [7]),
        ("body[2].fz", "applied", [14]),
        ("elb[aeiou]w", "qpos", [7]),
    ],
)
def test_coordinates_are_found(pattern: str, field: str, indices: list[int]) -> None:
    spec = mujoco.MjSpec.from_string(PLAIN)
    name_by_address(spec)
    model = spec.compile()
    first = part_starts(model)[field]
    assert match_coordinates(model, pattern) == [first + index for index in indices]


def test_every_coordinate_is_found_once(make_scene: Make) -> None:
    model = make_scene(PLAIN).base({}).model
    every = match_coordinates(model, "*")
    assert len(every) == len(set(every)) == model.nq + model.nv + model.nu + 6 * (model.nbody - 1)
    assert set(every) == set(coordinate_indices(model).values())


def test_a_name_goes_before_a_choice_of_characters() -> None:
    assert match_names(["joint1", "joint2", "joint[12]"], "joint[12]") == ["joint[12]"]
    assert match_names(["joint1", "joint2", "joint3"], "joint[12]") == ["joint1", "joint2"]


MANIFEST = """pairs: [{geoms: ["geom[0]", "geom[3]"]}, {bodies: [world, "body[3]"]}]
keyframe: key[2]
subject: body[2]
control: {"actuator[2].ctrl": {at: [0, 1], to: [0, 2]}}
perturb: {coordinates: ["joint[2]"], scale: .1}
"""


def test_a_manifest_uses_addresses(make_scene: Make) -> None:
    scene = make_scene(PLAIN, MANIFEST)
    base = scene.base({})
    assert [pair.name for pair in base.pairs] == ["geom[0]-geom[3]", "world-body[3]"]
    assert base.settings["keyframe"] == "key[2]"
    assert base.targets.subject == 2
    start = scene.initial_states([scene.resolve({}, 1, None)])
    assert start.driven_inputs.tolist() == [2]
    assert start.qpos[0].nonzero()[0].tolist() == [2, 3, 8]


def test_axes_use_addresses(make_scene: Make) -> None:
    scene = make_scene(PLAIN, MANIFEST)
    for name, value in (("actuator_gear[actuator[2],0]", 2.0), ("geom_friction[geom[3],0]", 0.5)):
        axis = scene.catalogue.find_axis(name)
        assert axis is not None
        run = scene.resolve({name: axis.parse(value)}, 0, None)
        model = scene.base_of(run).prepare(run.list_edits()).model
        field, index = name.split("[")[0], 2 if "actuator" in name else 3
        assert getattr(model, field)[index, 0] == value


def test_geoms_are_still_known_by_their_former_words(make_scene: Make) -> None:
    scene = make_scene(PLAIN, "pairs: [{geoms: [geom0, geom3]}]\n")
    assert [pair.name for pair in scene.base({}).pairs] == ["geom[0]-geom[3]"]
    assert scene.catalogue.find_axis("geom_friction[geom3,0]") is not None


def test_what_is_not_there_is_told(make_scene: Make) -> None:
    with pytest.raises(SceneError, match=r"no geom 'geom\[9\]' in the model"):
        make_scene(PLAIN, 'pairs: [{geoms: ["geom[0]", "geom[9]"]}]\n')
    with pytest.raises(SceneError, match=r"no coordinate 'actuator\[3\].ctrl'; did you mean"):
        make_scene(PLAIN, 'control: {"actuator[3].ctrl": {at: [0], to: [0]}}\n')
