"""A run's model as one file without assets, its start as a keyframe, and parts taken out of it."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats, RecordedControls
from contactlab.errors import SceneError
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.compile_model import compile_model
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.effects.effect_table import remove_from_spec
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.mesh_hulls import hull_vertices, rotation_matrix
from contactlab.scene.model_draft import differing_rows, fields_of
from contactlab.scene.model_edits import is_writable
from contactlab.scene.model_names import coordinate_indices, input_names, part_starts
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene

START = "start"
"""Name of the keyframe that the run begins in."""
_DIGITS = 9  # of times in seconds: nearer times are one time
_INERTIAS = ("body_mass", "body_inertia", "body_ipos", "body_iquat")
# Attributes of a specification that are not called as the field is, after its prefix.
_ATTRIBUTES = {
    "pair_dim": "condim",
    "jnt_solref": "solref_limit",
    "jnt_solimp": "solimp_limit",
    "dof_solref": "solref_friction",
    "dof_solimp": "solimp_friction",
    "tendon_solref_lim": "solref_limit",
    "tendon_solimp_lim": "solimp_limit",
    "tendon_solref_fri": "solref_friction",
    "tendon_solimp_fri": "solimp_friction",
    "tendon_lengthspring": "springlength",
    "eq_active0": "active",
}
_KINDS = {
    "body": "bodies",
    "geom": "geoms",
    "pair": "pairs",
    "jnt": "joints",
    "dof": "joints",
    "tendon": "tendons",
    "actuator": "actuators",
    "eq": "equalities",
}
_MESH = mujoco.mjtGeom.mjGEOM_MESH
_POSES = ("geom_pos", "geom_quat", "body_pos", "body_quat")
_LOOKS = {"material", "texture", "skin", "light", "visual"}
PARTS = ("bodies", "actuators", "equalities", "tendons", "sensors", "excludes", "pairs", "geoms")
"""Kinds of parts that can be taken out, those first that take others with them."""


@dataclass(frozen=True)
class Start:
    """The start of the parts of a model, by their names, and the drive from there.

    Attributes:
        qpos, qvel: rows of each joint [m or rad, m/s or rad/s].
        act, ctrl: of each actuator.
        mocap: pose of each mocap body: position [m] and quaternion.
        controls: inputs over time; None if only `ctrl`.
        inputs: names of its columns.
    """

    qpos: Mapping[str, Floats]
    qvel: Mapping[str, Floats]
    act: Mapping[str, Floats]
    ctrl: Mapping[str, Floats]
    mocap: Mapping[str, Floats]
    controls: RecordedControls | None
    inputs: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, model: mujoco.MjModel, start: InitialStates, controls: RecordedControls | None
    ) -> "Start":
        """Return the start of one run."""
        qpos, qvel, act, ctrl = (row[0] for row in (start.qpos, start.qvel, start.act, start.ctrl))
        poses = start.mocap[0].reshape(-1)
        positions = poses[: 3 * model.nmocap].reshape(-1, 3)
        turns = poses[3 * model.nmocap :].reshape(-1, 4)
        joints = [model.joint(index) for index in range(model.njnt)]
        actuators = range(model.nu)
        return cls(
            {
                joint.name: qpos[_index_span(model.jnt_qposadr, joint.id, model.nq)]
                for joint in joints
            },
            {
                joint.name: qvel[_index_span(model.jnt_dofadr, joint.id, model.nv)]
                for joint in joints
            },
            {
                model.actuator(index).name: act[_activation_places(model, index)]
                for index in actuators
            },
            {model.actuator(index).name: ctrl[[index]] for index in actuators},
            {
                model.body(int(body)).name: np.hstack([positions[place], turns[place]])
                for body in np.flatnonzero(model.body_mocapid >= 0)
                for place in [int(model.body_mocapid[body])]
            },
            controls,
            tuple(input_names(model, controls.places)) if controls else (),
        )

    def keyframe_values(self, model: mujoco.MjModel) -> dict[str, Floats]:
        """Return the values of a keyframe of the remaining model."""
        joints = [model.joint(index).name for index in range(model.njnt)]
        actuators = [model.actuator(index).name for index in range(model.nu)]
        mocap = sorted(np.flatnonzero(model.body_mocapid >= 0), key=lambda b: model.body_mocapid[b])
        poses = [self.mocap[model.body(int(body)).name] for body in mocap]
        return {
            "qpos": np.hstack([np.empty(0), *(self.qpos[name] for name in joints)]),
            "qvel": np.hstack([np.empty(0), *(self.qvel[name] for name in joints)]),
            "act": np.hstack([np.empty(0), *(self.act[name] for name in actuators)]),
            "ctrl": np.hstack([np.empty(0), *(self.ctrl[name] for name in actuators)]),
            "mpos": np.hstack([np.empty(0), *(pose[:3] for pose in poses)]),
            "mquat": np.hstack([np.empty(0), *(pose[3:] for pose in poses)]),
        }

    def advance_by(self, model: mujoco.MjModel, steps: int) -> "Start":
        """Return the state and drive of the remaining model, some steps later."""
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
        coordinate_places, first = coordinate_indices(model), part_starts(model)["ctrl"]
        kept_inputs = [self.inputs[place] for place in self._kept_places(model)]
        input_places, places = (
            self._kept_places(model),
            [
                coordinate_places[name if name in coordinate_places else f"{name}.ctrl"] - first
                for name in kept_inputs
            ],
        )
        inputs = np.hstack([data.ctrl, data.xfrc_applied.ravel()])
        for _ in range(steps):
            if self.controls is not None and input_places:
                inputs[places] = self.controls.levels[
                    _row_at(self.controls, data.time), input_places
                ]
                data.ctrl[:] = inputs[: model.nu]
                data.xfrc_applied[:] = inputs[model.nu :].reshape(-1, 6)
            mujoco.mj_step(model, data)
        joints = [model.joint(index).name for index in range(model.njnt)]
        actuators = [model.actuator(index) for index in range(model.nu)]
        return replace(
            self,
            qpos={name: data.joint(name).qpos.copy() for name in joints},
            qvel={name: data.joint(name).qvel.copy() for name in joints},
            act={each.name: data.act[_activation_places(model, each.id)] for each in actuators},
            ctrl={each.name: data.ctrl[[each.id]] for each in actuators},
            controls=self._controls_from(data.time),
        )

    def _controls_from(self, time: float) -> RecordedControls | None:
        """Return the inputs from a time on [s]; that time is then 0."""
        if self.controls is None:
            return None
        first = _row_at(self.controls, time)
        times = np.round(np.maximum(self.controls.times[first:] - time, 0), _DIGITS)
        return replace(self.controls, times=times, levels=self.controls.levels[first:])

    def _kept_places(self, model: mujoco.MjModel) -> list[int]:
        """Return the places of the inputs of the remaining model."""
        bodies = {model.body(index).name for index in range(1, model.nbody)}
        actuators = {model.actuator(index).name for index in range(model.nu)}
        return [
            place
            for place, name in enumerate(self.inputs)
            if name in actuators or name.rpartition(".")[0] in bodies
        ]

    def input_table(self, model: mujoco.MjModel, duration: float) -> str:
        """Return the drive of the remaining model as CSV; empty if nothing does."""
        if self.controls is None:
            return ""
        input_places = self._kept_places(model)
        levels = self.controls.levels[:, input_places]
        if not levels.any():
            return ""
        times = self.controls.times
        last = min(len(times) - 1, int(np.searchsorted(times, duration)))
        head = ",".join(["time", *(self.inputs[place] for place in input_places)])
        rows = np.column_stack([times, levels])[: last + 1]
        return "\n".join([head, *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"


def _index_span(addresses: Any, index: int, end: int) -> slice:  # noqa: ANN401 - MuJoCo's array
    stop = int(addresses[index + 1]) if index + 1 < len(addresses) else end
    return slice(int(addresses[index]), stop)


def _row_at(controls: RecordedControls, time: float) -> int:
    """Return the place of the levels that are held at a time [s]."""
    return max(int(np.searchsorted(controls.times, time + 10**-_DIGITS, "right")) - 1, 0)


def _activation_places(model: mujoco.MjModel, actuator: int) -> slice:
    first, count = int(model.actuator_actadr[actuator]), int(model.actuator_actnum[actuator])
    return slice(first, first + count) if first >= 0 else slice(0, 0)


def as_one_file(scene: Scene, run: RunSpec, start: InitialStates) -> str:
    """Return the model of a run as MJCF without assets.

    Looks are left out, meshes become their hulls, and bodies that they weigh keep their inertia. A
    SceneError names the part that cannot be written.
    """
    texts = list[str]()

    def flatten(spec: mujoco.MjSpec) -> None:
        remove_from_spec(spec, run.without)
        for kind in PARTS:
            for place, part in enumerate(getattr(spec, kind)):
                part.name = part.name or f"{kind}[{place}]"
        copied = spec.copy()
        texts.append(_without_assets(copied, copied.compile()))

    compiled = compile_model(scene.source, run.structure, flatten)
    meant = scene.prepare(run, start, compiled).model
    spec = mujoco.MjSpec.from_string(texts[0])
    for geom in spec.geoms:
        if geom.meshname and geom.type != _MESH:  # it was fitted to the mesh, not to its hull
            geom.meshname, geom.size = "", meant.geom(geom.name).size
    _set_fields(spec, meant)
    looks = [geom for geom in spec.geoms if geom.name in _drawn_geoms(meant)]
    _write_inertia(spec, meant, {geom.parent.name for geom in looks})
    for geom in looks:
        spec.delete(geom)
    used_meshes = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if mesh.name not in used_meshes]:
        spec.delete(mesh)
    have, want = fields_of(spec.compile()), fields_of(meant)
    others = {int(row) for name in _INERTIAS for row in differing_rows(have[name], want[name])}
    _write_inertia(spec, meant, {meant.body(body).name for body in others})
    return _plain_text(spec)


def _drawn_geoms(model: mujoco.MjModel) -> set[str]:
    """Return the names of geoms that touch nothing, and that no tendon, sensor or fluid meets."""
    acts_physically = (model.geom_contype | model.geom_conaffinity).astype(bool) | (
        model.geom_fluid[:, 0] > 0
    )
    acts_physically[np.concatenate([model.pair_geom1, model.pair_geom2])] = True
    wraps = [int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER)]
    acts_physically[model.wrap_objid[np.isin(model.wrap_type, wraps)]] = True
    for kinds, parts in (
        (model.sensor_objtype, model.sensor_objid),
        (model.sensor_reftype, model.sensor_refid),
    ):
        acts_physically[parts[kinds == mujoco.mjtObj.mjOBJ_GEOM]] = True
    return {model.geom(int(geom)).name for geom in np.flatnonzero(~acts_physically)}


def _write_inertia(spec: mujoco.MjSpec, meant: mujoco.MjModel, bodies: Collection[str]) -> None:
    """Write the inertia of bodies, which their geoms do not give."""
    for body in [body for body in spec.bodies if body.name in bodies and body.name != "world"]:
        place = meant.body(body.name).id
        body.explicitinertial = True
        body.mass = float(meant.body_mass[place])
        body.ipos, body.iquat = meant.body_ipos[place], meant.body_iquat[place]
        body.inertia = meant.body_inertia[place]


def _plain_text(spec: mujoco.MjSpec) -> str:
    """Return a specification as MJCF, without classes, sites and frames that nothing uses.

    MuJoCo before 4.0 rounds its numbers to six digits.
    """
    if hasattr(spec.compiler, "savecompiled"):
        spec.compiler.savecompiled = False
    root = ET.fromstring(str(spec.to_xml()))  # noqa: S314 - MuJoCo wrote it
    defaults = root.findall("default")
    classes = {default.get("class") for each in defaults for default in each.iter("default")}
    used_classes = {
        element.get(name)
        for part in root
        if part.tag != "default"
        for element in part.iter()
        for name in ("class", "childclass")
    }
    for each in defaults if classes - used_classes else ():
        _drop_unused(each, used_classes)
    # Remove sites that nothing names, and frames that hold nothing.
    referenced = {value for part in root.iter() for key, value in part.items() if key != "name"}
    for parent in [part for world in root.findall("worldbody") for part in world.iter()][::-1]:
        for child in list(parent):
            site = child.tag == "site" and child.get("name") not in referenced
            if site or (child.tag == "frame" and not len(child)):
                parent.remove(child)
    return ET.tostring(root, "unicode")


def _drop_unused(default: ET.Element, used_classes: set[str | None]) -> bool:
    """Remove classes below one that nothing uses; return whether it is used, or one below it is."""
    inner = default.findall("default")
    for each in [each for each in inner if not _drop_unused(each, used_classes)]:
        default.remove(each)
    return default.get("class") in {"main", *used_classes} or default.find("default") is not None


def _without_assets(spec: mujoco.MjSpec, model: mujoco.MjModel) -> str:
    """Return MJCF that names no file: hulls and heights by their numbers, and no looks."""
    for key in list(spec.keys):
        spec.delete(key)
    root = ET.fromstring(_plain_text(spec))  # noqa: S314 - MuJoCo wrote it
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in _LOOKS or (parent.tag == "default" and child.tag == "mesh"):
                parent.remove(child)
        parent.attrib.pop("material", None)
    for mesh in root.iterfind("asset/mesh"):
        name = mesh.get("name") or Path(mesh.get("file", "")).stem
        corners = file_hull(model, model.mesh(name).id)
        mesh.attrib = {"name": name, "vertex": " ".join(map(repr, corners.ravel().tolist()))}
    for terrain in root.iterfind("asset/hfield"):
        name = terrain.get("name") or Path(terrain.get("file", "")).stem
        ground = model.hfield(name)
        rows, columns = int(ground.nrow[0]), int(ground.ncol[0])
        heights = " ".join(map(repr, ground.data.ravel().tolist()))
        size = terrain.get("size", "")
        terrain.attrib = {"name": name, "size": size, "nrow": str(rows), "ncol": str(columns)}
        terrain.set("elevation", heights)
    return ET.tostring(root, "unicode")


def file_hull(model: mujoco.MjModel, mesh: int) -> Floats:
    """Return the (n, 3) vertices of a mesh's hull, in the frame of its file [m]."""
    return (
        hull_vertices(model, mesh) @ rotation_matrix(model.mesh_quat[mesh]).T + model.mesh_pos[mesh]
    )


def _set_pose(part: Any, position: Floats, turn: Floats) -> None:  # noqa: ANN401 - body or geom
    """Set the pose that a part has in its body, whatever frames it stands in."""
    frames, frame = list[Any](), part.frame
    while frame is not None:
        frames.append(frame)
        frame = frame.frame
    for frame in reversed(frames):
        back, inner, turned = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(back, frame.quat)
        mujoco.mju_rotVecQuat(inner, position - frame.pos, back)
        mujoco.mju_mulQuat(turned, back, turn)
        position, turn = inner, turned
    part.pos, part.quat = position, turn


def _body_poses(model: mujoco.MjModel) -> Floats:
    """Return the (nbody, 7) poses of bodies in those that carry them."""
    return _one_sign(np.hstack([model.body_pos, model.body_quat]))


def _geom_poses(model: mujoco.MjModel) -> Floats:
    """Return the (ngeom, 7) poses of geoms in their bodies; of meshes, of the frame of the file.

    MuJoCo has a mesh in the frame of its own inertia, which is not that of its hull.
    """
    geom_poses = np.hstack([model.geom_pos, model.geom_quat])
    for geom in np.flatnonzero(model.geom_type == int(_MESH)):
        mesh, back, turn = int(model.geom_dataid[geom]), np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(back, model.mesh_quat[mesh])
        mujoco.mju_mulQuat(turn, model.geom_quat[geom], back)
        geom_poses[geom, :3] -= rotation_matrix(turn) @ model.mesh_pos[mesh]
        geom_poses[geom, 3:] = turn
    return _one_sign(geom_poses)


def _one_sign(poses: Floats) -> Floats:
    """Return poses with one sign for all quaternions of equal turns."""
    turns = poses[:, 3:]
    largest = np.take_along_axis(turns, np.abs(turns).argmax(axis=1)[:, None], axis=1)
    return np.hstack([poses[:, :3], turns * np.sign(largest)])


def _set_fields(spec: mujoco.MjSpec, meant: mujoco.MjModel) -> None:
    """Set the differences of a run's model from its file: options, and fields of parts."""
    for name in dir(meant.opt):
        if not name.startswith("_") and hasattr(spec.option, name):
            setattr(spec.option, name, getattr(meant.opt, name))
    # Set poses of bodies and geoms that a run has otherwise than its file.
    model = spec.compile()
    for parts, poses in ((spec.bodies, _body_poses), (spec.geoms, _geom_poses)):
        poses_meant = poses(meant)
        for index in np.flatnonzero(np.abs(poses(model) - poses_meant).max(axis=1) > SUM_ROUNDING):
            _set_pose(parts[index], poses_meant[index, :3], poses_meant[index, 3:])
    have, want = fields_of(spec.compile()), fields_of(meant)
    for name in filter(is_writable, want):
        if name in (*_POSES, *_INERTIAS):
            continue
        prefix, _, own = name.partition("_")
        kind = _KINDS.get(prefix)
        if kind is None or have[name].shape != want[name].shape:
            continue
        elements = list(getattr(spec, kind))
        for row in differing_rows(have[name], want[name]):
            place = int(meant.dof_jntid[row]) if prefix == "dof" else row
            attribute = _ATTRIBUTES.get(name, own)
            if not hasattr(elements[place], attribute):
                raise SceneError(f"cannot write {name} of {elements[place].name} into one file")
            value, own_value = want[name][row], getattr(elements[place], attribute)
            if value.ndim == 0 and np.ndim(own_value):  # the first coefficient of a polynomial
                value = np.array([value, *own_value[1:]])
            setattr(elements[place], attribute, value.item() if value.ndim == 0 else value)


@dataclass(frozen=True)
class FailingModel:
    """A model as one file.

    Attributes:
        text: MJCF, without keyframes.
        start: the start of its parts, and its drive.
        duration: of its run [s].
        start_time: when in the stored run it begins [s].
        pairs: that its runs monitor, if both sides are left.
    """

    text: str
    start: Start = field(compare=False)
    duration: float
    start_time: float = 0.0
    pairs: tuple[MonitoredPair, ...] = field(default=(), compare=False)

    def make_spec(self) -> mujoco.MjSpec:
        """Return its specification."""
        return mujoco.MjSpec.from_string(self.text)

    def compile_spec(self) -> mujoco.MjModel:
        """Return its compiled model."""
        return self.make_spec().compile()

    def whole_text(self) -> str:
        """Return its MJCF with the keyframe that it starts from."""
        spec = self.make_spec()
        values = self.start.keyframe_values(spec.compile())
        key = spec.add_key(name=START)
        for name, value in values.items():
            setattr(key, name, value)
        return _plain_text(spec)

    def start_later(self, steps: int) -> "FailingModel":
        """Return the model with a run that begins some steps later, and ends when it did."""
        model = mujoco.MjModel.from_xml_string(self.whole_text())
        passed = steps * float(model.opt.timestep)
        return replace(
            self,
            start=self.start.advance_by(model, steps),
            start_time=self.start_time + passed,
            duration=round(self.duration - passed, _DIGITS),
        )

    def monitored_pairs(self) -> list[dict[str, object]]:
        """Return the pairs that are left, as a scene's manifest has them."""
        remaining_parts = {kind: {*self.part_names(kind), "world"} for kind in ("geoms", "bodies")}
        return [
            {kind: list(pair.sides), "slots": pair.slots}
            for pair in self.pairs
            for kind in ["bodies" if pair.bodies else "geoms"]
            if {*pair.sides} <= remaining_parts[kind]
        ]

    def part_names(self, kind: str) -> list[str]:
        """Return the names of its parts of a kind, a body before those that it carries."""
        return [element.name for element in _list_elements(self.make_spec(), kind)]

    def remove_parts(self, kind: str, names: Collection[str]) -> "FailingModel | None":
        """Return the model without parts of a kind, and all that refers to them; None if none is.

        A body takes along those that it carries.
        """
        spec = self.make_spec()
        parts = {part.name: part for part in _list_elements(spec, kind)}
        for name in names:
            if name in {existing.name for existing in getattr(spec, kind)}:
                spec.delete(parts[name])
        return self._with_spec(spec)

    def remove_joints(self, names: Collection[str]) -> "FailingModel | None":
        """Return the model without joints: their bodies stay as at the start."""
        spec = self.make_spec()
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = self.start.keyframe_values(model)["qpos"]
        mujoco.mj_kinematics(model, data)
        for joint in [joint for joint in spec.joints if joint.name in names]:
            body, own = joint.parent, model.body(joint.parent.name).id
            carrier = int(model.body_parentid[own])
            back, turn, away = np.zeros(4), np.zeros(4), np.zeros(3)
            mujoco.mju_negQuat(back, data.xquat[carrier])
            mujoco.mju_mulQuat(turn, back, data.xquat[own])
            mujoco.mju_rotVecQuat(away, data.xpos[own] - data.xpos[carrier], back)
            body.pos, body.quat = away, turn
            spec.delete(joint)
        return self._with_spec(spec)

    @property
    def options(self) -> list[str]:
        """The options that it sets, and `flag` for all flags."""
        return [
            name
            for option in self._parse_text().iter("option")
            for name in (*option.attrib, *(child.tag for child in option))
        ]

    def reset_option(self, option: str) -> "FailingModel | None":
        """Return the model with the default of an option, or of all flags."""
        root = self._parse_text()
        for element in root.iter("option"):
            element.attrib.pop(option, None)
            for child in element.findall(option):
                element.remove(child)
        return self._with_spec(mujoco.MjSpec.from_string(ET.tostring(root, "unicode")))

    def coarsen_meshes(self, meshes: Collection[str], vertices: int) -> "FailingModel | None":
        """Return the model with `vertices` vertices of meshes, each farthest from those before it.

        None if no mesh has more.
        """
        spec = self.make_spec()
        finer = [
            (mesh, points)
            for mesh in spec.meshes
            if mesh.name in meshes
            if len(points := np.array(mesh.uservert).reshape(-1, 3)) > vertices
        ]
        for mesh, points in finer:
            kept = list[int]()
            apart = np.linalg.norm(points - points.mean(axis=0), axis=1)
            for _ in range(vertices):
                kept.append(int(apart.argmax()))
                apart = np.minimum(apart, np.linalg.norm(points - points[kept[-1]], axis=1))
            mesh.uservert = points[kept].ravel()
        return self._with_spec(spec) if finer else None

    def fuse_bodies(self) -> "FailingModel | None":
        """Return the model with bodies without joints as parts of those that carry them."""
        spec = self.make_spec()
        if all(body.joints or body.name == "world" for body in spec.bodies):
            return None
        spec.compiler.fusestatic = True
        return self._with_spec(spec)

    def _parse_text(self) -> ET.Element:
        return ET.fromstring(self.text)  # noqa: S314 - MuJoCo wrote it

    def _with_spec(self, spec: mujoco.MjSpec) -> "FailingModel | None":
        """Return the model of a specification; None if it does not compile or nothing moves."""
        try:
            moves = spec.compile().nv > 0
            return replace(self, text=_plain_text(spec)) if moves else None
        except (ValueError, mujoco.FatalError):
            return None


def _list_elements(spec: mujoco.MjSpec, kind: str) -> list[Any]:
    elements = list(getattr(spec, kind))
    return [each for each in elements if not (kind == "bodies" and each.name == "world")]


def count_parts(model: mujoco.MjModel) -> dict[str, int]:
    """Return how many parts of each kind a model has, the world's body left out."""
    return {
        "bodies": int(model.nbody) - 1,
        "geoms": int(model.ngeom),
        "joints": int(model.njnt),
        "actuators": int(model.nu),
        "equalities": int(model.neq),
        "vertices": int(model.nmeshvert),
    }
