"""A run's model as one file without assets, its start as a keyframe, and parts taken out of it."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
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
"""Name of the keyframe in which the run begins."""
_DIGITS = 9  # of times in seconds: what is nearer is one time
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
    """Where the parts of a model begin, by their names, and what drives it from there.

    Attributes:
        qpos, qvel: rows of each joint [m or rad, m/s or rad/s].
        act, ctrl: of each actuator.
        mocap: pose of each mocap body: position [m] and quaternion.
        controls: what was applied over time; None if only `ctrl`.
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
            {joint.name: qpos[_span(model.jnt_qposadr, joint.id, model.nq)] for joint in joints},
            {joint.name: qvel[_span(model.jnt_dofadr, joint.id, model.nv)] for joint in joints},
            {model.actuator(index).name: act[_activations(model, index)] for index in actuators},
            {model.actuator(index).name: ctrl[[index]] for index in actuators},
            {
                model.body(int(body)).name: np.hstack([positions[place], turns[place]])
                for body in np.flatnonzero(model.body_mocapid >= 0)
                for place in [int(model.body_mocapid[body])]
            },
            controls,
            tuple(input_names(model, controls.places)) if controls else (),
        )

    def keyframe(self, model: mujoco.MjModel) -> dict[str, Floats]:
        """Return the values of a keyframe of what is left of the model."""
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

    def after(self, model: mujoco.MjModel, steps: int) -> "Start":
        """Return the state and drive of what is left of the model, some steps on from here."""
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
        kept, places = self._kept(model), self._places(model)
        inputs = np.hstack([data.ctrl, data.xfrc_applied.ravel()])
        for _ in range(steps):
            if self.controls is not None and kept:
                inputs[places] = self.controls.levels[_row(self.controls, data.time), kept]
                data.ctrl[:] = inputs[: model.nu]
                data.xfrc_applied[:] = inputs[model.nu :].reshape(-1, 6)
            mujoco.mj_step(model, data)
        joints = [model.joint(index).name for index in range(model.njnt)]
        actuators = [model.actuator(index) for index in range(model.nu)]
        return replace(
            self,
            qpos={name: data.joint(name).qpos.copy() for name in joints},
            qvel={name: data.joint(name).qvel.copy() for name in joints},
            act={each.name: data.act[_activations(model, each.id)] for each in actuators},
            ctrl={each.name: data.ctrl[[each.id]] for each in actuators},
            controls=self._controls_from(data.time),
        )

    def _places(self, model: mujoco.MjModel) -> list[int]:
        """Return the places of what is left of the inputs among controls and then forces."""
        known, first = coordinate_indices(model), part_starts(model)["ctrl"]
        named = [self.inputs[place] for place in self._kept(model)]
        return [known[name if name in known else f"{name}.ctrl"] - first for name in named]

    def _controls_from(self, time: float) -> RecordedControls | None:
        """Return what is applied from a time on [s], which is its 0."""
        if self.controls is None:
            return None
        first = _row(self.controls, time)
        times = np.round(np.maximum(self.controls.times[first:] - time, 0), _DIGITS)
        return replace(self.controls, times=times, levels=self.controls.levels[first:])

    def _kept(self, model: mujoco.MjModel) -> list[int]:
        """Return the places of the inputs of what is left of the model."""
        bodies = {model.body(index).name for index in range(1, model.nbody)}
        actuators = {model.actuator(index).name for index in range(model.nu)}
        return [
            place
            for place, name in enumerate(self.inputs)
            if name in actuators or name.rpartition(".")[0] in bodies
        ]

    def table(self, model: mujoco.MjModel, duration: float) -> str:
        """Return as CSV what drives what is left of the model; empty if nothing does."""
        if self.controls is None:
            return ""
        kept = self._kept(model)
        levels = self.controls.levels[:, kept]
        if not levels.any():
            return ""
        times = self.controls.times
        last = min(len(times) - 1, int(np.searchsorted(times, duration)))
        head = ",".join(["time", *(self.inputs[place] for place in kept)])
        rows = np.column_stack([times, levels])[: last + 1]
        return "\n".join([head, *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"


def _span(addresses: Any, index: int, end: int) -> slice:  # noqa: ANN401 - MuJoCo's array
    stop = int(addresses[index + 1]) if index + 1 < len(addresses) else end
    return slice(int(addresses[index]), stop)


def _row(controls: RecordedControls, time: float) -> int:
    """Return the place of the levels that are held at a time [s]."""
    return max(int(np.searchsorted(controls.times, time + 10**-_DIGITS, "right")) - 1, 0)


def _activations(model: mujoco.MjModel, actuator: int) -> slice:
    first, count = int(model.actuator_actadr[actuator]), int(model.actuator_actnum[actuator])
    return slice(first, first + count) if first >= 0 else slice(0, 0)


def as_one_file(scene: Scene, run: RunSpec, start: InitialStates) -> str:
    """Return the model of a run as MJCF without assets.

    Looks are left out, meshes become their hulls, and bodies that they weigh keep their inertia. A
    SceneError says what cannot be written.
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
    looks = [geom for geom in spec.geoms if geom.name in _looks(meant)]
    _weigh(spec, meant, {geom.parent.name for geom in looks})
    for geom in looks:
        spec.delete(geom)
    shown = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if mesh.name not in shown]:
        spec.delete(mesh)
    have, want = fields_of(spec.compile()), fields_of(meant)
    others = {int(row) for name in _INERTIAS for row in differing_rows(have[name], want[name])}
    _weigh(spec, meant, {meant.body(body).name for body in others})
    return _text(spec)


def _looks(model: mujoco.MjModel) -> set[str]:
    """Return the names of geoms that touch nothing, and that no tendon, sensor or fluid meets."""
    met = (model.geom_contype | model.geom_conaffinity).astype(bool) | (model.geom_fluid[:, 0] > 0)
    met[np.concatenate([model.pair_geom1, model.pair_geom2])] = True
    wraps = [int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER)]
    met[model.wrap_objid[np.isin(model.wrap_type, wraps)]] = True
    for kinds, parts in (
        (model.sensor_objtype, model.sensor_objid),
        (model.sensor_reftype, model.sensor_refid),
    ):
        met[parts[kinds == mujoco.mjtObj.mjOBJ_GEOM]] = True
    return {model.geom(int(geom)).name for geom in np.flatnonzero(~met)}


def _weigh(spec: mujoco.MjSpec, meant: mujoco.MjModel, bodies: Collection[str]) -> None:
    """Write the inertia of bodies, which their geoms do not give."""
    for body in [body for body in spec.bodies if body.name in bodies and body.name != "world"]:
        place = meant.body(body.name).id
        body.explicitinertial = True
        body.mass = float(meant.body_mass[place])
        body.ipos, body.iquat = meant.body_ipos[place], meant.body_iquat[place]
        body.inertia = meant.body_inertia[place]


def _text(spec: mujoco.MjSpec) -> str:
    """Return a specification as MJCF, without classes, sites and frames that nothing uses.

    MuJoCo before 4.0 rounds its numbers to six digits.
    """
    if hasattr(spec.compiler, "savecompiled"):
        spec.compiler.savecompiled = False
    root = ET.fromstring(str(spec.to_xml()))  # noqa: S314 - MuJoCo wrote it
    defaults = root.findall("default")
    classes = {default.get("class") for each in defaults for default in each.iter("default")}
    used = {
        element.get(name)
        for part in root
        if part.tag != "default"
        for element in part.iter()
        for name in ("class", "childclass")
    }
    for each in defaults if classes - used else ():
        _drop_unused(each, used)
    _drop_marks(root)
    return ET.tostring(root, "unicode")


def _drop_unused(default: ET.Element, used: set[str | None]) -> bool:
    """Remove classes below one that nothing uses; return whether it is used, or one below it is."""
    inner = default.findall("default")
    for each in [each for each in inner if not _drop_unused(each, used)]:
        default.remove(each)
    return default.get("class") in {"main", *used} or default.find("default") is not None


def _drop_marks(root: ET.Element) -> None:
    """Remove sites that nothing names, and frames that hold nothing."""
    named = {value for part in root.iter() for key, value in part.items() if key != "name"}
    for parent in [part for world in root.findall("worldbody") for part in world.iter()][::-1]:
        for child in list(parent):
            site = child.tag == "site" and child.get("name") not in named
            if site or (child.tag == "frame" and not len(child)):
                parent.remove(child)


def _without_assets(spec: mujoco.MjSpec, model: mujoco.MjModel) -> str:
    """Return MJCF that names no file: hulls and heights by their numbers, and no looks."""
    for key in list(spec.keys):
        spec.delete(key)
    root = ET.fromstring(_text(spec))  # noqa: S314 - MuJoCo wrote it
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


def _set_poses(spec: mujoco.MjSpec, meant: mujoco.MjModel) -> None:
    """Set poses of bodies and geoms that a run has otherwise than its file."""
    model = spec.compile()
    for parts, poses in ((spec.bodies, _body_poses), (spec.geoms, _geom_poses)):
        want = poses(meant)
        for place in np.flatnonzero(np.abs(poses(model) - want).max(axis=1) > SUM_ROUNDING):
            _set_pose(parts[place], want[place, :3], want[place, 3:])


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
    found = np.hstack([model.geom_pos, model.geom_quat])
    for geom in np.flatnonzero(model.geom_type == int(_MESH)):
        mesh, back, turn = int(model.geom_dataid[geom]), np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(back, model.mesh_quat[mesh])
        mujoco.mju_mulQuat(turn, model.geom_quat[geom], back)
        found[geom, :3] -= rotation_matrix(turn) @ model.mesh_pos[mesh]
        found[geom, 3:] = turn
    return _one_sign(found)


def _one_sign(poses: Floats) -> Floats:
    """Return poses of which none has a quaternion q where another of the same turn has -q."""
    turns = poses[:, 3:]
    largest = np.take_along_axis(turns, np.abs(turns).argmax(axis=1)[:, None], axis=1)
    return np.hstack([poses[:, :3], turns * np.sign(largest)])


def _set_fields(spec: mujoco.MjSpec, meant: mujoco.MjModel) -> None:
    """Set what a run's model has otherwise than its file: options, and fields of parts."""
    for name in dir(meant.opt):
        if not name.startswith("_") and hasattr(spec.option, name):
            setattr(spec.option, name, getattr(meant.opt, name))
    _set_poses(spec, meant)
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
            value = want[name][row]
            setattr(elements[place], attribute, value.item() if value.ndim == 0 else value)


@dataclass(frozen=True)
class FailingModel:
    """A model as one file.

    Attributes:
        text: MJCF, without keyframes.
        start: where its parts begin, and what drives it.
        duration: of its run [s].
        start_time: when in the stored run it begins [s].
        pairs: that its runs monitor, if both sides are left.
    """

    text: str
    start: Start = field(compare=False)
    duration: float
    start_time: float = 0.0
    pairs: tuple[MonitoredPair, ...] = field(default=(), compare=False)

    def spec(self) -> mujoco.MjSpec:
        """Return its specification."""
        return mujoco.MjSpec.from_string(self.text)

    def compiled(self) -> mujoco.MjModel:
        """Return its compiled model."""
        return self.spec().compile()

    def whole_text(self) -> str:
        """Return its MJCF with the keyframe that it starts from."""
        spec = self.spec()
        values = self.start.keyframe(spec.compile())
        key = spec.add_key(name=START)
        for name, value in values.items():
            setattr(key, name, value)
        return _text(spec)

    def later(self, steps: int) -> "FailingModel":
        """Return the model with a run that begins some steps later, and ends when it did."""
        model = mujoco.MjModel.from_xml_string(self.whole_text())
        passed = steps * float(model.opt.timestep)
        return replace(
            self,
            start=self.start.after(model, steps),
            start_time=self.start_time + passed,
            duration=round(self.duration - passed, _DIGITS),
        )

    def monitored(self) -> list[dict[str, object]]:
        """Return the pairs that are left, as a scene's manifest has them."""
        left = {kind: {*self.parts(kind), "world"} for kind in ("geoms", "bodies")}
        return [
            {kind: list(pair.sides), "slots": pair.slots}
            for pair in self.pairs
            for kind in ["bodies" if pair.bodies else "geoms"]
            if {*pair.sides} <= left[kind]
        ]

    def parts(self, kind: str) -> list[str]:
        """Return the names of its parts of a kind, a body before those that it carries."""
        return [element.name for element in _elements(self.spec(), kind)]

    def without(self, kind: str, names: Collection[str]) -> "FailingModel | None":
        """Return the model without parts of a kind, and all that refers to them; None if none is.

        A body takes along those that it carries.
        """
        spec = self.spec()
        parts = {part.name: part for part in _elements(spec, kind)}
        for name in names:
            if name in {left.name for left in getattr(spec, kind)}:
                spec.delete(parts[name])
        return self._changed(spec)

    def still(self, names: Collection[str]) -> "FailingModel | None":
        """Return the model without joints: their bodies stay as they are at the start."""
        spec = self.spec()
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = self.start.keyframe(model)["qpos"]
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
        return self._changed(spec)

    @property
    def options(self) -> list[str]:
        """The options that it sets, and `flag` for all flags."""
        return [
            name
            for option in self._tree().iter("option")
            for name in (*option.attrib, *(child.tag for child in option))
        ]

    def plain(self, option: str) -> "FailingModel | None":
        """Return the model with the default of an option, or of all flags."""
        root = self._tree()
        for element in root.iter("option"):
            element.attrib.pop(option, None)
            for child in element.findall(option):
                element.remove(child)
        return self._changed(mujoco.MjSpec.from_string(ET.tostring(root, "unicode")))

    def coarser(self, meshes: Collection[str], vertices: int) -> "FailingModel | None":
        """Return the model with so many vertices of meshes, each farthest from those before it.

        None if none of them has more.
        """
        spec = self.spec()
        finer = [
            (mesh, points)
            for mesh in spec.meshes
            if mesh.name in meshes
            if len(points := np.array(mesh.uservert).reshape(-1, 3)) > vertices
        ]
        for mesh, points in finer:
            mesh.uservert = points[list(_farthest(points, vertices))].ravel()
        return self._changed(spec) if finer else None

    def fused(self) -> "FailingModel | None":
        """Return the model in which bodies without joints are parts of those that carry them."""
        spec = self.spec()
        if all(body.joints or body.name == "world" for body in spec.bodies):
            return None
        spec.compiler.fusestatic = True
        return self._changed(spec)

    def _tree(self) -> ET.Element:
        return ET.fromstring(self.text)  # noqa: S314 - MuJoCo wrote it

    def _changed(self, spec: mujoco.MjSpec) -> "FailingModel | None":
        """Return the model of a specification; None if it does not compile or nothing moves."""
        try:
            moves = spec.compile().nv > 0
            return replace(self, text=_text(spec)) if moves else None
        except (ValueError, mujoco.FatalError):
            return None


def _elements(spec: mujoco.MjSpec, kind: str) -> list[Any]:
    elements = list(getattr(spec, kind))
    return [each for each in elements if not (kind == "bodies" and each.name == "world")]


def _farthest(points: Floats, count: int) -> Iterator[int]:
    """Yield places of points, the next always the farthest from all before it."""
    apart = np.linalg.norm(points - points.mean(axis=0), axis=1)
    for _ in range(count):
        place = int(apart.argmax())
        yield place
        apart = np.minimum(apart, np.linalg.norm(points - points[place], axis=1))


def sizes(model: mujoco.MjModel) -> dict[str, int]:
    """Return how many parts of each kind a model has, the world's body left out."""
    return {
        "bodies": int(model.nbody) - 1,
        "geoms": int(model.ngeom),
        "joints": int(model.njnt),
        "actuators": int(model.nu),
        "equalities": int(model.neq),
        "vertices": int(model.nmeshvert),
    }
