"""Changes of a model: of its specification, of its settings, and of its files.

Each change is made at the element that defines an object of the model. Attributes of that element
override defaults and classes.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.mjcf import OPTIONS
from contactlab.scene.compile_model import name_sensors, read_spec, recordable_model
from contactlab.scene.effects.effect_table import remove_from_spec
from contactlab.scene.model_edits import (
    FIELD_KINDS,
    FLAG_NAMES,
    is_writable,
    read_flag,
    read_option,
)
from contactlab.scene.model_names import OBJECT_LISTS
from contactlab.scene.model_text import (
    Origin,
    Origins,
    Replacement,
    append_lines,
    apply_replacements,
    attribute_text,
    elements_of,
    line_of,
    mjcf_text,
    remove_element,
    with_attributes,
)
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import MODEL_SUFFIXES, SceneSource
from contactlab.schema.servo import PositionServo

PRIMITIVES: Mapping[str, mujoco.mjtGeom] = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}
"""Shapes that MuJoCo fits to a mesh, by their name in a file."""


@dataclass(frozen=True)
class ModelEdits:
    """Changes of a model."""

    # Canonical values of axes that concern the model: options, flags, effects, contact parameters,
    # model fields.
    settings: Mapping[str, object] = field(default_factory=dict[str, object])
    masked: tuple[str, ...] = ()  # geoms that do not collide
    # Geoms that collide with more, their `contype` or `conaffinity`, and its new bits.
    widened_masks: tuple[tuple[str, str, int], ...] = ()
    # Pairs of bodies that do not collide with each other.
    excluded: tuple[tuple[str, str], ...] = ()
    # Bodies of a URDF that are welded to the world and get a free joint.
    freed: tuple[str, ...] = ()
    # Mesh geoms, each with the primitive that MuJoCo fits to its mesh in place of the hull.
    fitted: tuple[tuple[str, str], ...] = ()
    # Keyframes with their new configurations; a keyframe with a new name is added.
    posed: tuple[tuple[str, tuple[float, ...]], ...] = ()
    # Bodies that begin elsewhere in the reference pose, with their `pos` in the parent.
    placed: tuple[tuple[str, tuple[float, ...]], ...] = ()
    # Motors that become position servos, and keyframes with the targets of these.
    servos: tuple[PositionServo, ...] = ()
    steered: tuple[tuple[str, tuple[float, ...]], ...] = ()
    # Names of sensors to remove; a sensor without a name is called like `sensor[3]`.
    sensors: tuple[str, ...] = ()
    # Most vertices of the convex hulls of meshes, by name.
    hulls: Mapping[str, int] = field(default_factory=dict[str, int])
    pairs: tuple[str, ...] = ()  # explicit <pair> elements to remove
    tendons: tuple[str, ...] = ()  # tendons to remove
    # Flags that are switched off although no compiled scene has them: energy, fwdinv.
    unflagged: tuple[str, ...] = ()

    @property
    def changes_spec(self) -> bool:
        """Whether more than settings and flags changes."""
        settings_only = ModelEdits(self.settings, unflagged=self.unflagged)
        return self != settings_only

    def joined_with(self, other: "ModelEdits") -> "ModelEdits":
        """Return both changes together; those of the other replace own settings and hulls."""
        joined = {
            each.name: tuple(dict.fromkeys((*getattr(self, each.name), *getattr(other, each.name))))
            for each in fields(self)
            if each.name not in ("settings", "hulls")
        }
        return ModelEdits(
            settings={**self.settings, **other.settings},
            hulls={**self.hulls, **other.hulls},
            **joined,
        )

    @property
    def separates_links(self) -> bool:
        """Whether overlapping links no longer touch."""
        return bool(self.excluded or self.freed)

    @property
    def fixes_start(self) -> bool:
        """Whether the changes fix a start that joints, contacts or equalities do not allow."""
        return self.separates_links or self.moves_start

    @property
    def moves_start(self) -> bool:
        """Whether runs begin in another configuration."""
        return bool(self.posed or self.placed)


def join_edits(some: Sequence[ModelEdits]) -> ModelEdits:
    """Return the edits that make several changes; of two values of one part the last one holds."""
    return ModelEdits(
        settings={name: value for each in some for name, value in each.settings.items()},
        masked=tuple(dict.fromkeys(name for each in some for name in each.masked)),
        widened_masks=tuple(dict.fromkeys(mask for each in some for mask in each.widened_masks)),
        excluded=tuple(dict.fromkeys(pair for each in some for pair in each.excluded)),
        freed=tuple(dict.fromkeys(name for each in some for name in each.freed)),
        fitted=tuple(dict(pair for each in some for pair in each.fitted).items()),
        posed=tuple(dict(pair for each in some for pair in each.posed).items()),
        placed=tuple(dict(pair for each in some for pair in each.placed).items()),
        servos=tuple({servo.actuator: servo for each in some for servo in each.servos}.values()),
        steered=tuple(dict(pair for each in some for pair in each.steered).items()),
        sensors=tuple(dict.fromkeys(name for each in some for name in each.sensors)),
        hulls={name: count for each in some for name, count in each.hulls.items()},
        unflagged=tuple(dict.fromkeys(name for each in some for name in each.unflagged)),
    )


@dataclass(frozen=True)
class Change:
    """A change of a file: its line, and the element that then stands there.

    Without an element, the text at that line is removed.
    """

    file: str
    line: int
    element: str

    @property
    def where(self) -> str:
        """The place as `FILE:LINE`."""
        return f"{self.file}:{self.line}"

    def __str__(self) -> str:
        return f"{self.where}: {self.element or 'removed'}"


_SPEC_LISTS = {**OBJECT_LISTS, "sensor": "sensors", "mesh": "meshes"}


def _elements_by_name(spec: mujoco.MjSpec, kind: str) -> dict[str, Any]:
    return {element.name: element for element in getattr(spec, _SPEC_LISTS[kind])}


def _find_element(spec: mujoco.MjSpec, kind: str, name: str) -> Any:  # noqa: ANN401 - as MjSpec has them
    parts = _elements_by_name(spec, kind)
    SceneError.unless_known(name, parts, f"no {kind} '{name}' in the model")
    return parts[name]


class CompiledFiles(NamedTuple):
    """A model with and without settings, and the lines of its elements, by kind and name.

    The line is 0 for elements without a line in MuJoCo. `compiled` is the model as MuJoCo compiled
    it for `run`, which is never edited.
    """

    model: mujoco.MjModel
    plain: mujoco.MjModel
    compiled: mujoco.MjModel
    run: RunSpec
    lines: Mapping[str, Mapping[str, int]]

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        source: SceneSource,
        settings: Mapping[str, object],
        edit: Callable[[mujoco.MjSpec], None] | None = None,
    ) -> "CompiledFiles":
        """Compile the files of a scene without recording sensors, and write settings.

        The scene's own files without an edit are compiled once.
        """
        whole = scene.with_effects("all")
        plain = whole.resolve({}, 0, None)
        run = whole.resolve(settings, 0, None) if settings else plain
        if own := [name for name in run.structure if name in settings]:
            raise SceneError(
                f"cannot write '{own[0]}' into the model files: the scene itself sets this value"
            )
        with read_spec(source, run.structure) as spec:
            name_sensors(spec)
            remove_from_spec(spec, run.without)
            if edit is not None:
                edit(spec)
            lines = _element_lines(spec)
            if edit is None and source is scene.source:
                model = scene.written_model(run)
            else:
                model = recordable_model(spec.compile(), source)
        base = replace(scene.base(run.structure), model=model)
        meant, unchanged = (base.prepare(each.list_edits()).model for each in (run, plain))
        return cls(meant, unchanged, model, run, lines)


def _element_lines(spec: mujoco.MjSpec) -> dict[str, dict[str, int]]:
    """Return the line of each element, by kind and name."""
    return {
        kind: {
            name: int(element.info.rpartition(" ")[2] or 0)
            for name, element in _elements_by_name(spec, kind).items()
        }
        for kind in _SPEC_LISTS
    }


def edit_spec(spec: mujoco.MjSpec, edits: ModelEdits) -> None:
    """Apply the changes of a specification that are not settings."""
    if edits.masked and spec.compiler.discardvisual:
        raise SceneError("cannot mask a geom: <compiler discardvisual> would remove it")
    for kind, name, attribute, value in _attribute_edits(edits):
        own = PRIMITIVES[value] if isinstance(value, str) and attribute == "type" else value
        setattr(_find_element(spec, kind, name), attribute, own)
    for pair in edits.excluded:
        one, other = (_find_element(spec, "body", name).name for name in pair)
        spec.add_exclude(bodyname1=one, bodyname2=other)
    for name in edits.freed:
        spec.compiler.fusestatic = False  # otherwise bodies welded to the world merge into it
        _find_element(spec, "body", name).add_freejoint()
    for name, qpos in edits.posed:
        key = _elements_by_name(spec, "key").get(name) or spec.add_key(name=name)
        key.qpos = qpos
    for servo in edits.servos:
        actuator = _find_element(spec, "actuator", servo.actuator)
        actuator.set_to_position(kp=servo.kp, kv=servo.kv)
        actuator.forcelimited, actuator.forcerange = bool(servo.forces), servo.forces or (0, 0)
        actuator.ctrllimited, actuator.ctrlrange = False, servo.targets
    for kind, names in (
        ("sensor", edits.sensors),
        ("pair", edits.pairs),
        ("tendon", edits.tendons),
    ):
        for name in names:
            spec.delete(_find_element(spec, kind, name))


def drop_textures(spec: mujoco.MjSpec) -> None:
    """Remove pictures, which no simulation reads and every copy of a model would contain."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)


# Attributes with a name other than that of the field after its prefix.
_ATTRIBUTE_NAMES = {
    "pair_dim": "condim",
    "jnt_solref": "solreflimit",
    "jnt_solimp": "solimplimit",
    "dof_solref": "solreffriction",
    "dof_solimp": "solimpfriction",
    "tendon_solref_lim": "solreflimit",
    "tendon_solref_fri": "solreffriction",
    "tendon_solimp_lim": "solimplimit",
    "tendon_solimp_fri": "solimpfriction",
}
# Actuators that are written by gains: the attribute, the index of the parameter, and its sign.
_GAIN_ATTRIBUTES: Mapping[tuple[str, str], tuple[str, int | None, int] | None] = {
    ("position", "gainprm"): ("kp", 0, 1),
    ("position", "biasprm"): ("kv", 2, -1),
    ("velocity", "gainprm"): ("kv", 0, 1),
    ("velocity", "biasprm"): None,  # follows from the gain
    ("intvelocity", "gainprm"): ("kp", 0, 1),
    ("intvelocity", "biasprm"): ("kv", 2, -1),
    ("damper", "gainprm"): ("kv", 2, -1),
    ("cylinder", "gainprm"): ("area", 0, 1),
    ("adhesion", "gainprm"): ("gain", 0, 1),
}
_UNNAMED_BODY = re.compile(r"body\[\d+\]")
_TAG_NAME = re.compile(rb"<([^\s/>]+)")


@dataclass(frozen=True)
class Draft:
    """Changes of a model's files, each at the element that defines an object."""

    main: Path  # the main file, in a copy
    before: Mapping[Path, bytes]  # the original content of each file
    origins: Origins  # the file and line of each element
    # The line of each element in the original files, by kind and name.
    lines: Mapping[str, Mapping[str, int]]
    # Attributes to set.
    values: dict[Origin, dict[str, str]] = field(default_factory=lambda: defaultdict(dict))
    renamed: dict[Origin, str] = field(default_factory=dict[Origin, str])  # new tags
    removed: set[Origin] = field(default_factory=set[Origin])  # elements to remove
    added_lines: list[str] = field(default_factory=list[str])  # lines to add at the main file's end
    # Lines to add at the end of elements.
    inserted: dict[Origin, str] = field(default_factory=dict[Origin, str])

    @classmethod
    def from_scene(cls, scene: Scene, source: SceneSource) -> "Draft":
        """Return a draft without changes."""
        root = source.content.root
        paths = [root / file for file in source.content.files if file.suffix in MODEL_SUFFIXES]
        before = {path: path.read_bytes() for path in paths}
        origins = Origins.lay_out(source.model, root)
        run = scene.with_effects("all").resolve({}, 0, None)
        with read_spec(source, run.structure) as spec:
            name_sensors(spec)
            remove_from_spec(spec, run.without)
            lines = _element_lines(spec)
        return cls(source.model, before, origins, lines)

    def _find_origin(self, kind: str, name: str) -> Origin:
        origin = self.origins.by_line.get(self.lines[kind].get(name, 0))
        own, places = self.origins.keyframes, [*self.lines["key"]]
        if kind == "key" and len(own) == len(places):
            origin = own[places.index(name)]
        if origin is None:
            raise SceneError(f"cannot write {kind} '{name}': no element of a file defines it alone")
        return origin

    def describe_row(self, model: mujoco.MjModel, field: str, row: int) -> str:
        """Name the object of a row of a model's field, and another one from the same element."""
        kind = FIELD_KINDS.get(field.partition("_")[0])
        if kind is None:
            return ""
        name, lines = object_name(model, field, row), self.lines[kind]
        others = [line for line in lines if line != name and lines[line] == lines[name] > 0]
        note = f" (from the same element as '{others[0]}')" if others else ""
        return f" of {kind} '{name}'{note}"

    def set_fields(self, meant: CompiledFiles) -> None:
        """Set the attributes of elements that get other field values from settings."""
        model, old, new = meant.model, fields_of(meant.plain), fields_of(meant.model)
        for name in filter(is_writable, new):
            prefix, _, own = name.partition("_")
            for row in differing_rows(old[name], new[name]):
                part, values = object_name(model, name, row), new[name][row].tolist()
                attribute = _ATTRIBUTE_NAMES.get(name, own)
                if own in ("gainprm", "biasprm"):
                    gain = _GAIN_ATTRIBUTES.get(
                        (self._element_tag("actuator", part), own), (own, None, 1)
                    )
                    if gain is None:
                        continue
                    attribute, place, sign = gain
                    values = values if place is None else sign * values[place]
                self._set_attribute(FIELD_KINDS[prefix], part, attribute, mjcf_text(values))

    def _element_tag(self, kind: str, name: str) -> str:
        path, place = self._find_origin(kind, name)
        data = self.before[path]
        tag_match = _TAG_NAME.match(data, elements_of(data)[place].start)
        return tag_match[1].decode() if tag_match else ""

    def _write_servo(self, servo: PositionServo) -> None:
        origin = self._find_origin("actuator", servo.actuator)
        self.renamed[origin] = "position"
        self.values[origin] |= {
            "kp": mjcf_text(servo.kp),
            "kv": mjcf_text(servo.kv),
            "forcelimited": str(bool(servo.forces)).lower(),
            "forcerange": mjcf_text(list(servo.forces or (0.0, 0.0))),
            "ctrllimited": "false",
            "ctrlrange": mjcf_text(list(servo.targets)),
        }

    def _set_attribute(self, kind: str, name: str, attribute: str, value: str) -> None:
        self.values[self._find_origin(kind, name)][attribute] = value

    def set_options(self, meant: CompiledFiles) -> None:
        """Set the options and flags of a model, in the main file's elements if these are last."""
        new, old = meant.model, meant.plain
        changed = [name for name in OPTIONS if read_option(new, name) != read_option(old, name)]
        options = {name: mjcf_text(read_option(new, name)) for name in changed}
        switched = [name for name in FLAG_NAMES if read_flag(new, name) != read_flag(old, name)]
        flags = {name: "enable" if read_flag(new, name) else "disable" for name in switched}
        self._set_last_element("option", options)
        self._set_last_element("flag", flags)

    def _set_last_element(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Set attributes of the main file's <option> or <flag>, which override all others."""
        added = {"option": "<option{}/>", "flag": "<option><flag{}/></option>"}[tag]
        origin = self.origins.last.get(tag)
        if attributes and origin and origin[0] == self.main:
            self.values[origin] |= attributes
        elif attributes:
            self.added_lines.append(added.format(attribute_text(attributes)))

    def set_parts(self, edits: ModelEdits, meant: CompiledFiles) -> None:
        """Apply the changes that no field of a compiled model shows; remove deleted elements."""
        for kind, name, attribute, value in _attribute_edits(edits):
            self._set_attribute(kind, name, attribute, mjcf_text(value))
        for one, other in edits.excluded:
            pair = attribute_text({"body1": one, "body2": other})
            self.added_lines.append(f"<contact><exclude{pair}/></contact>")
        for servo in edits.servos:
            self._write_servo(servo)
        for name in edits.freed:
            self.inserted[self._find_origin("body", name)] = "<freejoint/>"
        for name, qpos in edits.posed:
            text = mjcf_text(list(qpos))
            if name in self.lines["key"]:
                self._set_attribute("key", name, "qpos", text)
            else:
                key = attribute_text({"name": name, "qpos": text})
                self.added_lines.append(f"<keyframe><key{key}/></keyframe>")
        if edits.unflagged:
            self._set_last_element("flag", dict.fromkeys(edits.unflagged, "disable"))
        for kind, lines in self.lines.items():
            for name in lines.keys() - meant.lines[kind].keys():
                self.removed.add(self._find_origin(kind, name))

    def _text_replacements(self) -> Iterator[tuple[Path, list[Replacement]]]:
        for path, data in self.before.items():
            elements = elements_of(data)
            replacements = [
                with_attributes(data, elements[place], values, self.renamed.get((file, place)))
                for (file, place), values in self.values.items()
                if file == path
            ]
            replacements += [
                remove_element(data, elements[at]) for file, at in self.removed if file == path
            ]
            replacements += [
                append_lines(data, elements[at], [line])
                for (file, at), line in self.inserted.items()
                if file == path
            ]
            if path == self.main and self.added_lines:
                replacements.append(append_lines(data, elements[0], self.added_lines))
            yield path, sorted(replacements)

    def changed_texts(self) -> dict[Path, bytes]:
        """Return the text of each file with the changes applied."""
        return {
            path: apply_replacements(self.before[path], replacements)
            for path, replacements in self._text_replacements()
        }

    def list_changes(self, folder: Path) -> Iterator[Change]:
        """Yield the changes of the files, with paths relative to a folder."""
        for path, replacements in self._text_replacements():
            for replacement in replacements:
                line = line_of(self.before[path], replacement.start)
                text = replacement.text.decode(errors="replace")
                # Inserted text has one element per line; a start tag may span several lines.
                is_inserted = text and replacement.start == replacement.end
                for part in text.strip().splitlines() if is_inserted else [text]:
                    yield Change(path.relative_to(folder).as_posix(), line, " ".join(part.split()))


def _attribute_edits(edits: ModelEdits) -> Iterator[tuple[str, str, str, object]]:
    """Yield the attributes that edits set: kind and name of an element, attribute and value."""
    for name, attribute in product(edits.masked, ("contype", "conaffinity")):
        yield "geom", name, attribute, 0
    for name, attribute, bits in edits.widened_masks:
        yield "geom", name, attribute, bits
    for name, count in edits.hulls.items():
        yield "mesh", name, "maxhullvert", count
    for name, primitive in edits.fitted:
        yield "geom", name, "type", primitive
    for name, place in edits.placed:
        yield "body", name, "pos", place
    for name, ctrl in edits.steered:
        yield "key", name, "ctrl", ctrl
    for name in {name for pair in edits.excluded for name in pair}:
        if _UNNAMED_BODY.fullmatch(name):  # the body has no name in its file
            yield "body", name, "name", name


def object_name(model: mujoco.MjModel, field: str, row: int) -> str:
    """Return the name of the object that a row of a model's field belongs to."""
    prefix = field.partition("_")[0]
    index = int(model.dof_jntid[row]) if prefix == "dof" else row
    return getattr(model, FIELD_KINDS[prefix])(index).name


def differing_rows(some: np.ndarray, other: np.ndarray) -> list[int]:
    """Return the rows that differ in any bit between two arrays."""
    if some.tobytes() == other.tobytes():
        return []
    rows = enumerate(zip(some, other, strict=True))
    return [row for row, (one, two) in rows if one.tobytes() != two.tobytes()]


_UNCOMPARED_FIELDS = re.compile("^_|buffer|name|path|signature")


def fields_of(owner: object) -> dict[str, np.ndarray]:
    """Return the fields of a model, or of its options, by name."""
    members = {
        name: getattr(owner, name) for name in dir(owner) if not _UNCOMPARED_FIELDS.search(name)
    }
    kinds = (int, float, np.ndarray)
    return {
        name: np.atleast_1d(value) for name, value in members.items() if isinstance(value, kinds)
    }
