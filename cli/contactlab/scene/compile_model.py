"""Compiles a scene's model with its structure values written and recording sensors added.

This module also provides the addresses of the sensors in `sensordata`, the reasons why MuJoCo
refuses a model, and the inertias in a model file that no real body can have.
"""

import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from mujoco._specs import MjsSensor

from contactlab.contact.trace_arrays import SLOT_WIDTH, Floats
from contactlab.errors import ModelWarning, SceneError
from contactlab.expression import Expression, ExpressionError
from contactlab.resources import limited_memory
from contactlab.scene.compile_messages import explain_compile_error
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.model_files import FileSearch, name_in_copy, plain_name
from contactlab.scene.model_names import name_by_address
from contactlab.scene.model_xml import parse_model
from contactlab.scene.mujoco_versions import has_batch, silence_mujoco
from contactlab.scene.scene_source import BINARY, MODEL_SUFFIXES, SceneSource
from contactlab.scene.timed_inputs import HoldSpec
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.temporary_folders import temporary_folder

SENSOR_PREFIX = "contactlab/"
COMPILE_ERRORS = ValueError, RuntimeError, mujoco.FatalError
"""Errors of MuJoCo's compiler: a RuntimeError is one of C++, as for sizes that no memory holds."""
_FORCE, _LENGTH = "force/", "length/"
_POSITIVE_OPTIONS = ("timestep", "impratio")
_NONNEGATIVE_OPTIONS = (
    *("density", "viscosity"),
    *("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations"),
)
_OBJ, _KIND = mujoco.mjtObj, mujoco.mjtSensor
_NO_OBJECT = (_OBJ.mjOBJ_UNKNOWN, "")
_OPTIONAL_SENSORS = ("kinetic", "potential", "momentum", "angular_momentum", "held")


@dataclass(frozen=True)
class SensorLayout:
    """Addresses in `sensordata`; None for a quantity that is not recorded."""

    pairs: tuple[int, ...]  # where the contact slots of each monitored pair start
    contacts: int  # the count of all contacts, followed by their smallest distance
    kinetic: int | None  # the kinetic energy
    potential: int | None  # the potential energy
    momentum: int | None  # the velocity of the center of mass
    angular_momentum: int | None  # the angular momentum
    # The held body's position relative to its holder, followed by the holder's orientation.
    held: int | None
    forces: int  # the first actuator's force, followed by the forces of the others
    lengths: int  # the first tendon's length, followed by the lengths of the others

    def from_contacts(self) -> "SensorLayout":
        """Return the addresses in rows that begin with the count of contacts, without pairs."""
        moved = {name: getattr(self, name) for name in (*_OPTIONAL_SENSORS, "forces", "lengths")}
        moved = {name: size and size - self.contacts for name, size in moved.items()}
        return replace(self, pairs=(), contacts=0, **moved)


def add_sensors(
    spec: mujoco.MjSpec,
    pairs: Sequence[MonitoredPair],
    holding: HoldSpec | None,
    *,
    free: bool,
    energy: bool,
) -> None:
    """Add the recording sensors: contacts, energies, momenta, actuator forces, tendon lengths."""
    # A contact sensor has a bit mask of its fields and a rule that reduces contacts to its slots.
    all_fields, found_and_distance = (1 << 9) - 1, 1 << 0 | 1 << 3
    reduce_to_first, reduce_to_nearest = 0, 1
    for pair in pairs:
        sensor = _add_contact_sensor(
            spec, pair.name, (all_fields, reduce_to_first, pair.slots), SLOT_WIDTH
        )
        sensor.objtype = sensor.reftype = _OBJ.mjOBJ_BODY if pair.bodies else _OBJ.mjOBJ_GEOM
        sensor.objname, sensor.refname = pair.sides
    _add_contact_sensor(spec, "contacts", (found_and_distance, reduce_to_nearest, 1), 2)
    if energy:
        _add_sensor(spec, "kinetic", _KIND.mjSENS_E_KINETIC)
        _add_sensor(spec, "potential", _KIND.mjSENS_E_POTENTIAL)
    if free:
        world = (_OBJ.mjOBJ_BODY, "world")
        _add_sensor(spec, "momentum", _KIND.mjSENS_SUBTREELINVEL, world)
        _add_sensor(spec, "angular_momentum", _KIND.mjSENS_SUBTREEANGMOM, world)
    if holding:
        subject, holder = (_OBJ.mjOBJ_XBODY, holding.subject), (_OBJ.mjOBJ_XBODY, holding.holder)
        position = _add_sensor(spec, "held", _KIND.mjSENS_FRAMEPOS, subject)
        position.reftype, position.refname = holder
        _add_sensor(spec, "holder", _KIND.mjSENS_FRAMEQUAT, holder)
    for name in [actuator.name for actuator in spec.actuators]:
        _add_sensor(spec, _FORCE + name, _KIND.mjSENS_ACTUATORFRC, (_OBJ.mjOBJ_ACTUATOR, name))
    for name in [tendon.name for tendon in spec.tendons]:
        _add_sensor(spec, _LENGTH + name, _KIND.mjSENS_TENDONPOS, (_OBJ.mjOBJ_TENDON, name))


def _add_sensor(
    spec: mujoco.MjSpec,
    name: str,
    kind: mujoco.mjtSensor,
    of: tuple[mujoco.mjtObj, str] = _NO_OBJECT,
) -> MjsSensor:
    return spec.add_sensor(name=SENSOR_PREFIX + name, type=kind, objtype=of[0], objname=of[1])


def _add_contact_sensor(
    spec: mujoco.MjSpec, name: str, settings: tuple[int, int, int], width: int
) -> MjsSensor:
    """Add a contact sensor, or a user sensor for the engine to fill if MuJoCo has none."""
    if has_batch():
        sensor = _add_sensor(spec, name, _KIND.mjSENS_CONTACT)
        sensor.intprm[:3] = settings
        return sensor
    sensor = _add_sensor(spec, name, _KIND.mjSENS_USER)
    sensor.dim = width * settings[2]
    sensor.needstage = mujoco.mjtStage.mjSTAGE_ACC
    sensor.datatype = mujoco.mjtDataType.mjDATATYPE_REAL
    return sensor


def find_layout(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], holding: HoldSpec | None, *, free: bool
) -> SensorLayout:
    """Return the addresses of the added sensors in a compiled model's `sensordata`.

    Without added sensors, return the addresses in the rows that are read from a loop, in the order
    of `add_sensors`.
    """
    sensors = (model.sensor(index) for index in range(model.nsensor))
    addresses = {
        sensor.name.removeprefix(SENSOR_PREFIX): int(sensor.adr[0])
        for sensor in sensors
        if sensor.name.startswith(SENSOR_PREFIX)
    }
    if not addresses:
        forces, nowhere = 4 + 6 * free + 7 * bool(holding), (0,) * len(pairs)
        momenta, held_address = (4, 7) if free else (None, None), forces - 7 if holding else None
        return SensorLayout(nowhere, 0, 2, 3, *momenta, held_address, forces, forces + model.nu)
    return SensorLayout(
        pairs=tuple(addresses[pair.name] for pair in pairs),
        contacts=addresses["contacts"],
        **{name: addresses.get(name) for name in _OPTIONAL_SENSORS},
        forces=addresses[_FORCE + model.actuator(0).name] if model.nu else 0,
        lengths=addresses[_LENGTH + model.tendon(0).name] if model.ntendon else 0,
    )


COMPILE_BYTES = 8 << 30
"""Memory for compiling a model [bytes]: four times as much as the largest allowed assets take."""
_LINE = re.compile(r", line (\d+)")
_FOLDER_HINT = {
    False: '<compiler meshdir="FOLDER"/>, relative to the model',
    True: '<mujoco><compiler meshdir="FOLDER" strippath="true"/></mujoco> within <robot>',
}
_BRACE_TEXT = re.compile(r"\{([^{}]*)\}")


def compile_model(
    source: SceneSource, structure: Mapping[str, object], edit: Callable[[mujoco.MjSpec], None]
) -> mujoco.MjModel:
    """Compile a scene's structure after an edit of its specification.

    A binary model is already compiled and is not edited. A SceneError explains a failure.
    """
    if source.model.suffix == BINARY:
        with _show_warnings_once(source), limited_memory(COMPILE_BYTES):
            try:
                model = mujoco.MjModel.from_binary_path(str(source.model))
            except COMPILE_ERRORS as error:
                raise compile_error(source.model, source.model, error) from error
        return recordable_model(model, source)
    with read_spec(source, structure) as spec:
        edit(spec)
        return recordable_model(spec.compile(), source)


@contextmanager
def read_spec(source: SceneSource, structure: Mapping[str, object]) -> Generator[mujoco.MjSpec]:
    """Yield the specification of a scene's structure, which may be compiled within the context.

    A SceneError explains why it cannot be read, or not be compiled within the context.
    """
    with (
        _model_file(source, structure) as path,
        _show_warnings_once(source),
        limited_memory(COMPILE_BYTES),
    ):
        try:
            copied = _copy_unchanged(source) if path == source.model else None
            yield copied or parse_spec(source, path)
        except COMPILE_ERRORS as error:
            raise compile_error(source.model, path, error) from error


def parse_spec(source: SceneSource, path: Path) -> mujoco.MjSpec:
    """Return the specification of a file, with the scene's resources, addresses and limits.

    MuJoCo's errors are not explained: see `COMPILE_ERRORS`.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    for element in (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures):
        if resource := source.content.resources.get(plain_name(element.file)):
            element.file = str(resource)
    name_by_address(spec)
    _remove_endless_ranges(spec)
    return spec


_LIMITS = {
    "joints": (("range", "limited"),),
    "tendons": (("range", "limited"),),
    "actuators": (
        ("ctrlrange", "ctrllimited"),
        ("forcerange", "forcelimited"),
        ("actrange", "actlimited"),
    ),
}
"""The range of each kind of element, and whether it acts."""


def _remove_endless_ranges(spec: mujoco.MjSpec) -> None:
    # A limit at infinity never acts, so that the motion is the same, bit for bit, without it. Other
    # commands then meet no infinite number.
    for plural, limits in _LIMITS.items():
        for element in getattr(spec, plural):
            for field, limited in limits:
                low, high = getattr(element, field)
                if low == -np.inf and high == np.inf:
                    setattr(element, limited, mujoco.mjtLimited.mjLIMITED_FALSE)
                    setattr(element, field, [0, 0])
                    kind = plural.removesuffix("s")
                    text = (
                        f"{kind} '{element.name}' has {field} -inf inf, so that nothing limits it"
                    )
                    warnings.warn(text, ModelWarning, stacklevel=2)


_REFERRING = ["actuators", "equalities", "excludes", "pairs", "sensors", "tendons", "tuples"]


def _copy_unchanged(source: SceneSource) -> mujoco.MjSpec | None:
    # None if the model has elements that refer to missing parts: MuJoCo leaves them out of a copy,
    # and would compile it.
    spec = _read_unchanged(source)
    copied = spec.copy()
    return copied if _count_referring(copied) == _count_referring(spec) else None


def _count_referring(spec: mujoco.MjSpec) -> list[int]:
    return [len(getattr(spec, name)) for name in _REFERRING]


_last_read: list[tuple[tuple[object, ...], mujoco.MjSpec]] = []
"""The model that was read last, by its path and the bytes of its files.

A command compiles one model several times. A copy of its specification takes a hundredth of the
time of parsing.
"""


def _read_unchanged(source: SceneSource) -> mujoco.MjSpec:
    # Callers copy it, because they edit and compile theirs. Only a compiler reads other files.
    content = source.content
    files = [content.root / file for file in content.files if file.suffix in MODEL_SUFFIXES]
    key = source.model, *((file, file.read_bytes()) for file in files if file.is_file())
    if not _last_read or _last_read[0][0] != key:
        _last_read[:] = [(key, parse_spec(source, source.model))]
    return _last_read[0][1]


def name_sensors(spec: mujoco.MjSpec) -> None:
    """Name sensors without a name by their place, like `sensor[3]`."""
    for place, sensor in enumerate(spec.sensors):
        sensor.name = sensor.name or f"sensor[{place}]"


def recordable_model(model: mujoco.MjModel, source: SceneSource) -> mujoco.MjModel:
    """Return the model if it can be recorded, and raise a SceneError with the reason otherwise.

    Every option except the timestep, which a sweep may replace, must be valid, and each actuator
    must have one control and one force.
    """
    check_numbers(model, source.model)
    for option, problem in wrong_options(model).items():
        if option != "timestep":
            raise SceneError(f"{source.model}: {option} {problem}; see <option {option}=.../>")
    for actuator in range(getattr(model, "nactuator", 0)):
        controls, forces = model.actuator_ctrlnum[actuator], model.actuator_outnum[actuator]
        if (controls, forces) != (1, 1):
            name = model.actuator(actuator).name
            raise SceneError(
                f"{source.model}: actuator '{name}' has {controls} controls and {forces} forces, "
                "but contactlab records one of each; write one actuator for each of them, such as "
                '<position joint="..."/> or <motor gear="..."/>'
            )
    return model


def wrong_options(model: mujoco.MjModel) -> Mapping[str, str]:
    """Return the attributes of <option> that no simulation can have, each with the problem.

    The invalid values are not finite, or zero or negative although the quantity cannot be.
    """
    problems = dict[str, str]()
    for option in dir(model.opt):
        value = getattr(model.opt, option)
        if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
            text = " ".join(f"{number:g}" for number in np.ravel(value))
            problems[option] = f"is {text}, but must be finite"
        elif option in _POSITIVE_OPTIONS and value <= 0:
            problems[option] = f"is {value:g}, but must be above 0"
        elif option in _NONNEGATIVE_OPTIONS and value < 0:
            problems[option] = f"is {value:g}, but must be 0 or more"
    return problems


@cache
def _number_fields(kind: type[mujoco.MjModel]) -> list[str]:
    # Data of the user may be anything.
    model = kind.from_xml_string("<mujoco/>")
    fields = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    names = [
        name
        for name, field in fields.items()
        if isinstance(field, np.ndarray) and field.dtype.kind == "f"
    ]
    # MuJoCo computes this one, and a polygon of a mesh without an area has no normal.
    others = "numeric_data", "mesh_polynormal"
    return [name for name in names if not name.endswith("_user") and name not in others]


def check_numbers(model: mujoco.MjModel, path: Path) -> None:
    """Raise a SceneError for a number of a model that is not finite, or has no finite square.

    Options have their own rules, and data of the user may be anything.
    """
    most = 1e50  # its cube is finite, and no unit makes a number of a robot that large
    for name in _number_fields(type(model)):
        field = np.asarray(getattr(model, name))
        wrong = ~(np.abs(field) <= min(most, float(np.finfo(field.dtype).max)))
        if not wrong.any():
            continue
        place, (kind, _, part) = int(np.argwhere(wrong)[0][0]), name.partition("_")
        named_elements: Any = getattr(model, kind, None)
        element: Any = None
        with suppress(IndexError):  # Fields such as vertices have more rows than elements.
            element = (
                named_elements(len(field) - 1) and named_elements(place)
                if callable(named_elements)
                else None
            )
        owner = f" of {kind} '{element.name}'" if element else ""
        text = " ".join(f"{number:g}" for number in np.ravel(field[place]))
        raise SceneError(
            f"{path}: {part if owner else name}{owner} is {text}; write finite numbers, and none "
            f"above {most:g}"
        )


_shown_warnings: set[tuple[Path, str]] = set()


@contextmanager
def _show_warnings_once(source: SceneSource) -> Generator[None]:
    """Show each warning of MuJoCo once per model, and none for a store's copy of the model."""
    silence_mujoco()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for text in dict.fromkeys(str(warning.message) for warning in caught):
        warn_once(source, text, ModelWarning)


def warn_once(source: SceneSource, text: str, kind: type[ModelWarning]) -> None:
    """Warn about a model once per process, and never about a store's copy of it."""
    if not source.content.copied and (source.model, text) not in _shown_warnings:
        _shown_warnings.add((source.model, text))
        warnings.warn(f"{source.model}: {text}", kind, stacklevel=2)


@contextmanager
def _model_file(source: SceneSource, structure: Mapping[str, object]) -> Generator[Path]:
    content = source.content
    moved = content.copied and content.absolute
    if not structure and not moved:
        yield source.model
        return
    with temporary_folder() as folder:
        content.copy_to(Path(folder))
        files = [Path(folder) / file for file in content.files if file.suffix in MODEL_SUFFIXES]
        roots = {file: parse_model(file) for file in files}
        with source.named_in_errors():
            _write_structure(list(roots.values()), source.manifest, structure)
        for file, root in roots.items():
            if moved:
                name_in_copy(root, Path(folder))
            ET.ElementTree(root).write(file)
        yield Path(folder) / content.model


def _write_structure(
    roots: Sequence[ET.Element], manifest: SceneManifest | None, structure: Mapping[str, object]
) -> None:
    entries = manifest.structure if manifest else {}
    for name, value in structure.items():
        entry = entries[name]
        try:
            elements = [element for root in roots for element in root.findall(entry.element)]
        except (SyntaxError, TypeError, KeyError) as error:
            raise SceneError(
                f"structure '{name}': {entry.element} is not a path of elements: {error}"
            ) from error
        if not elements:
            raise SceneError(f"structure '{name}': no element of the model matches {entry.element}")
        for element in elements:
            element.set(
                entry.attribute, _BRACE_TEXT.sub(partial(_computed_text, name, value), entry.text)
            )


def _computed_text(name: str, value: object, braces: re.Match[str]) -> str:
    """Return the replacement of braces in a structure's text: the value if they are empty."""
    if not braces[1]:
        return repr(value)
    try:
        return repr(Expression(braces[1]).evaluate({name: value}))
    except ExpressionError as error:
        raise SceneError(f"structure '{name}': cannot compute {braces[0]}: {error}") from error


def compile_error(model: Path, compiled_file: Path, error: Exception) -> SceneError:
    """Return why a model does not compile, with corrections. `compiled_file` may be its copy."""
    lines = str(error).strip().replace(str(compiled_file), str(model)).splitlines()
    lines = lines or ["MuJoCo gives no reason"]
    line_match = _LINE.search(str(error))
    place = f"{model}:{line_match[1]}" if line_match else str(model)
    if line_match and line_match[1] == "0":
        place = _find_included_place(model, str(error)) or str(model)
    hints = list[str]()
    if "opening file" in lines[0]:
        # The first missing file, and where MuJoCo expects it.
        for path in (reference.path for reference in FileSearch().iterate_references(model)):
            if not path.is_file() and f"{path.name}'" in lines[0]:
                hints.append(f"it was expected at {path}; put it there, or say where it is:")
                hints.append(_FOLDER_HINT[model.suffix == ".urdf"])
                break
    if "inertia" in lines[0] and "XML Error" not in lines[0]:
        # MuJoCo gives no access to a specification that it failed to compile.
        with suppress(*COMPILE_ERRORS):
            faults = written_inertia_faults(mujoco.MjSpec.from_file(str(compiled_file)))
            hints += [f"body '{f.body}': {f.reason}" for f in islice(faults, 3)]
    if "opening file" in lines[0] and "\\" in str(model.absolute()):
        hints.append("MuJoCo cannot open a path with a backslash: rename its folder or file")
    if "no decoder found" in lines[0]:
        hints.append(
            "MuJoCo reads meshes from .stl, .obj and .msh files; convert it to one of them"
        )
    return SceneError(
        "\n  ".join([f"{place}: does not compile", *explain_compile_error(lines, model), *hints])
    )


def _find_included_place(model: Path, message: str) -> str:
    # MuJoCo counts no lines in included files: FILE:LINE of the only element of the kind that has
    # each word which the message quotes, or "".
    tag = re.search(r"Element '(\w+)'", message)
    if not tag:
        return ""
    words, places = re.findall(r"'([^']*)'", message[: tag.start()]), list[str]()
    for path in dict.fromkeys(one.path for one in FileSearch().iterate_references(model)):
        if path.suffix != ".xml" or not path.is_file():
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        for element in re.finditer(rf"<{tag[1]}\b[^>]*>", text):
            if all(re.search(rf"(?<!\w){re.escape(word)}(?!\w)", element[0]) for word in words):
                places.append(f"{path}:{text.count(chr(10), 0, element.start()) + 1}")
    return places[0] if len(places) == 1 else ""


Kind = Literal[
    "not_positive", "triangle", "balanced", "beyond", "density", "outside", "too_large", "too_small"
]


@dataclass(frozen=True)
class InertiaFault:
    """A body with a mass or inertia that no real body can have.

    The value violates the limit, both in the unit. The reason describes the whole fault as text.
    """

    body: str
    kind: Kind
    value: float
    limit: float
    unit: str
    reason: str


def written_inertia_faults(spec: mujoco.MjSpec) -> Iterator[InertiaFault]:
    """Yield the faults of the inertias that a model file contains, before it is compiled."""
    compiler = spec.compiler
    if compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        return
    for body in spec.bodies[1:]:
        # It has joints, and no body is fixed to it that could supply the inertia.
        alone = bool(body.joints) and all(child.joints for child in body.bodies)
        if not body.explicitinertial and (body.geoms or not alone):
            continue
        name = body.name or f"body {body.id}"
        mass = max(float(body.mass), compiler.boundmass or -np.inf)
        xx, yy, zz, xy, xz, yz = (float(entry) for entry in body.fullinertia)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        # The first number is NaN if diaginertia gives the moments.
        if np.isnan(xx):
            moments = np.array(body.inertia, np.float64)
        elif np.isfinite(tensor).all():
            moments = np.linalg.eigvalsh(tensor)
        else:
            moments = np.full(3, np.nan)
        moments = np.maximum(moments, compiler.boundinertia or -np.inf)
        # A body fixed to another may have no inertia of its own, but not a negative one.
        lower = mujoco.mjMINVAL if alone else -np.finfo(float).tiny
        if not np.min([mass, *moments]) > lower:
            yield nonpositive_inertia_fault(name, mass, moments)
        elif not satisfies_triangle(moments):
            yield triangle_inertia_fault(name, moments, balanced=bool(compiler.balanceinertia))


def nonpositive_inertia_fault(name: str, mass: float, moments: Floats) -> InertiaFault:
    """Return the fault of a body with zero or negative mass or inertia."""
    reason = (
        f"its mass is {mass:g} kg and its principal moments are {_moments_text(moments)} kg m^2; "
        "write all of them above 0"
    )
    least = float(np.min([mass, *moments]))
    return InertiaFault(name, "not_positive", least, 0.0, "kg or kg m^2", reason)


def satisfies_triangle(moments: Floats) -> bool:
    """Return whether no principal moment exceeds the sum of the other two."""
    low, middle, high = np.sort(moments)
    return bool(low + middle >= high)


def triangle_inertia_fault(name: str, moments: Floats, *, balanced: bool) -> InertiaFault:
    """Return the fault of principal moments [kg m^2] that violate the triangle inequality.

    If `balanced`, the compiler replaced them by their mean.
    """
    low, middle, high = np.sort(moments).tolist()
    end = f"; balanceinertia replaced all three by their mean, {np.mean(moments):g}"
    reason = (
        f"its principal moments are {_moments_text(moments)} kg m^2, and no mass distribution has "
        f"{low:g} + {middle:g} < {high:g}" + (end if balanced else "")
    )
    kind = "balanced" if balanced else "triangle"
    return InertiaFault(name, kind, high, low + middle, "kg m^2", reason)


def _moments_text(moments: Floats) -> str:
    return ", ".join(f"{moment:g}" for moment in moments)
