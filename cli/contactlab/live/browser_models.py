"""Models for the browser's MuJoCo: compiled bytes or MJCF, and the changes of a run.

A browser reads the bytes of a model if its MuJoCo has the version that compiled them. Another
version gets MJCF, and all real numbers of the compiled model in addition, since MJCF is written
with few digits.
"""

import copy
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.live.surfaces import Texture, textures_of
from contactlab.scene.compile_model import compile_model
from contactlab.scene.effects.effect_table import remove_from_spec
from contactlab.scene.model_draft import fields_of
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.view.drawn_shapes import VISIBLE_GROUPS, drawn_geoms

Numbers = NDArray[np.float64] | NDArray[np.float32]
Change = tuple[list[int], list[float]]  # flat indices in a field, and the numbers there


@dataclass(frozen=True, eq=False)
class BrowserModel:
    """A structure of a scene, compiled without recording sensors and without pictures."""

    model: mujoco.MjModel
    spec: mujoco.MjSpec | None  # its source; None if it was already compiled
    fields: Mapping[str, bytes]  # files of its height fields, by their names in its MJCF
    textures: Sequence[Texture] = ()  # of its materials, for drawing

    @classmethod
    def of(cls, scene: Scene, run: RunSpec) -> "BrowserModel":
        """Compile the structure of a run; raise a SceneError with the reason if that fails."""
        specs: list[mujoco.MjSpec] = []
        fields: dict[str, bytes] = {}

        def plain(spec: mujoco.MjSpec) -> None:
            remove_from_spec(spec, run.without)
            # Textures and skins do not affect the motion.
            for material in spec.materials:
                material.textures = [""] * len(material.textures)
            for unused in (*spec.textures, *spec.skins):
                spec.delete(unused)
            specs.append(spec)
            # Files written for a model are compiled in a folder that is removed afterwards.
            folder = Path(spec.modelfiledir) / (spec.meshdir or "")
            for element in spec.hfields:
                if element.file:
                    fields[element.file] = (folder / element.file).read_bytes()

        model = compile_model(scene.source, run.structure, plain)
        pictures = tuple(textures_of(scene.base_of(run).model))
        return cls(model, specs[0] if specs else None, fields, pictures)

    @property
    def compiled(self) -> bytes:
        """The compiled model; only MuJoCo of the same version can read it."""
        model = _without_drawing_data(self.model)
        buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, buffer)
        return buffer.tobytes()

    @cached_property
    def mjcf(self) -> str:
        """The model as one MJCF document; empty if it was already compiled."""
        return self.spec.to_xml() if self.spec else ""

    @cached_property
    def standalone_mjcf(self) -> tuple[str, Mapping[str, bytes]]:
        """The MJCF for versions before MuJoCo 4, and its files by the names in it.

        A mesh is written as compiled, in its author's frame, so that it compiles to itself.
        """
        root = ET.fromstring(self.mjcf)  # noqa: S314 - written by MuJoCo
        files: dict[str, bytes] = {}
        for place, element in enumerate(root.iterfind("./asset/*[@file]")):
            file = element.get("file", "")
            if element.tag == "mesh":
                mesh = self.model.mesh(element.get("name", Path(file).stem))
                name, content = f"{place}.msh", _mesh_file(self.model, mesh.id)
                element.attrib.pop("content_type", None)
                # The class of the mesh may set other values.
                element.attrib.update(_UNCHANGED_MESH)
            else:
                name, content = f"{place}{Path(file).suffix}", self.fields[file]
            files[name] = content
            element.set("file", name)
        for compiler in root.iterfind("./compiler"):
            for folder in ("meshdir", "texturedir", "assetdir", "strippath"):
                compiler.attrib.pop(folder, None)
        for actuator in root.iterfind("./actuator/*"):
            # Older versions do not know this attribute, which is written even with its only value.
            actuator.attrib.pop("input", None)
        return ET.tostring(root, encoding="unicode"), files

    @property
    def numbers(self) -> dict[str, Numbers]:
        """Every real number of the model by field, flat, except for those derived from meshes.

        Versions may number the faces of hulls of equal meshes in different orders.
        """
        return {
            name: np.ravel(value)
            for name, value in _numeric_fields(self.model).items()
            if value.dtype.kind == "f" and value.size and not _MESH_FIELDS.match(name)
        }


_UNCHANGED_MESH = {"scale": "1 1 1", "refpos": "0 0 0", "refquat": "1 0 0 0"}
_DRAWN_FIELDS = ("mesh_normal", "mesh_texcoord", "mesh_facenormal", "mesh_facetexcoord")
_MESH_FIELDS = re.compile("bvh_|mesh_(?!vert$|pos$|quat$)")
_RAY_SENSORS = {
    int(kind)
    for name, kind in mujoco.mjtSensor.__members__.items()
    if any(word in name for word in ("RANGEFINDER", "TACTILE", "USER", "PLUGIN"))
}


def _without_drawing_data(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model without data that only drawing and rays use: half of a mesh's bytes, and more.

    A model with ray sensors or signed distances keeps its bounding volumes.
    """
    lighter = copy.copy(model)
    for name in _DRAWN_FIELDS:
        getattr(lighter, name)[:] = 0
    if (
        _RAY_SENSORS & {*model.sensor_type.tolist()}
        or (model.geom_type == mujoco.mjtGeom.mjGEOM_SDF).any()
    ):
        return lighter
    for start, count in zip(model.mesh_bvhadr, model.mesh_bvhnum, strict=True):
        lighter.bvh_aabb[start : start + count] = 0
    return lighter


def _mesh_file(model: mujoco.MjModel, mesh: int) -> bytes:
    """Return a mesh in its author's frame, in MuJoCo's own format: points and triangles."""
    mesh_view = model.mesh(mesh)
    first, count = int(mesh_view.vertadr[0]), int(mesh_view.vertnum[0])
    face, faces = int(mesh_view.faceadr[0]), int(mesh_view.facenum[0])
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.mesh_quat[mesh])
    compiled = model.mesh_vert[first : first + count].astype(np.float64)
    points = (compiled @ turn.reshape(3, 3).T + model.mesh_pos[mesh]).astype(np.float32)
    header = np.array([count, 0, 0, faces], np.int32)
    return b"".join(
        part.tobytes() for part in (header, points, model.mesh_face[face : face + faces])
    )


def model_changes(before: mujoco.MjModel, after: mujoco.MjModel) -> dict[str, Change]:
    """Return the differences of two models of one layout, by field."""
    old, new = _numeric_fields(before), _numeric_fields(after)
    return {
        name: array_difference(old[name].ravel(), value.ravel())
        for name, value in new.items()
        if value.tobytes() != old[name].tobytes()
    }


def shown_groups(model: mujoco.MjModel) -> dict[str, Change]:
    """Return visible groups for geoms of hidden groups that are drawn, by the field of groups."""
    geoms = np.flatnonzero(drawn_geoms(model) & (model.geom_group >= VISIBLE_GROUPS)).tolist()
    return {"geom_group": (geoms, [VISIBLE_GROUPS - 1] * len(geoms))} if geoms else {}


def array_difference(before: np.ndarray, after: np.ndarray) -> Change:
    """Return the indices of the differences of two flat arrays, and the second's numbers there."""
    places = np.flatnonzero(before != after)
    return places.tolist(), after[places].tolist()


def _numeric_fields(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    owners = {"": model, "opt.": model.opt, "stat.": model.stat}
    return {
        prefix + name: value
        for prefix, owner in owners.items()
        for name, value in fields_of(owner).items()
        if value.dtype.kind in "fiub"
    }
