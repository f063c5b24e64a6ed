"""Compile a scene's model with its structure values written and recording sensors added.

The sensors' addresses in `sensordata` are known from here; so is why MuJoCo refuses a model, and
which inertias its file writes that no body has.
"""

import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import mujoco
import numpy as np
from mujoco._specs import MjsBody, MjsSensor

from contactlab.contact.trace_arrays import SLOT_WIDTH, Floats
from contactlab.errors import ModelWarning, SceneError
from contactlab.expression import Expression, ExpressionError
from contactlab.scene.compile_messages import in_words
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.model_files import FileSearch, name_in_copy, parse, plain_name
from contactlab.scene.model_names import name_by_address
from contactlab.scene.mujoco_versions import has_batch, silence_mujoco
from contactlab.scene.scene_source import BINARY, MODEL_SUFFIXES, SceneSource
from contactlab.scene.timed_inputs import HoldSpec
from contactlab.schema.scene_manifest import SceneManifest

PREFIX = "contactlab/"
_FORCE, _LENGTH = "force/", "length/"
_ALL_FIELDS = (1 << 9) - 1
_FOUND_AND_DISTANCE = 1 << 0 | 1 << 3
_FIRST = 0
_NEAREST = 1
_ABOVE_ZERO = ("timestep", "impratio")
_NOT_BELOW_ZERO = (
    *("density", "viscosity"),
    *("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations"),
)
_OBJ, _KIND = mujoco.mjtObj, mujoco.mjtSensor
_NOTHING = (_OBJ.mjOBJ_UNKNOWN, "")
_NOT_ALWAYS = ("kinetic", "potential", "momentum", "angular_momentum", "held")


@dataclass(frozen=True)
class SensorLayout:
    """Addresses in `sensordata`; None for what is not recorded."""

    pairs: tuple[int, ...]  # where the contact slots of each monitored pair start
    contacts: int  # of the count of all contacts, followed by their smallest distance
    kinetic: int | None  # of the kinetic energy
    potential: int | None  # of the potential energy
    momentum: int | None  # of the velocity of the centre of mass
    angular_momentum: int | None  # of the angular momentum
    # Of the held body's position relative to its holder, followed by the holder's orientation.
    held: int | None
    forces: int  # of the first actuator's force, which those of the others follow
    lengths: int  # of the first tendon's length, likewise

    def from_contacts(self) -> "SensorLayout":
        """Return addresses in rows that begin with the count of all contacts, without pairs."""
        moved = {name: getattr(self, name) for name in (*_NOT_ALWAYS, "forces", "lengths")}
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
    """Add what a run records: contacts, energies, momenta, actuator forces, tendon lengths."""
    for pair in pairs:
        sensor = _add_contacts(spec, pair.name, (_ALL_FIELDS, _FIRST, pair.slots), SLOT_WIDTH)
        sensor.objtype = sensor.reftype = _OBJ.mjOBJ_BODY if pair.bodies else _OBJ.mjOBJ_GEOM
        sensor.objname, sensor.refname = pair.sides
    _add_contacts(spec, "contacts", (_FOUND_AND_DISTANCE, _NEAREST, 1), 2)
    if energy:
        _add(spec, "kinetic", _KIND.mjSENS_E_KINETIC)
        _add(spec, "potential", _KIND.mjSENS_E_POTENTIAL)
    if free:
        world = (_OBJ.mjOBJ_BODY, "world")
        _add(spec, "momentum", _KIND.mjSENS_SUBTREELINVEL, world)
        _add(spec, "angular_momentum", _KIND.mjSENS_SUBTREEANGMOM, world)
    if holding:
        held, holder = (_OBJ.mjOBJ_XBODY, holding.subject), (_OBJ.mjOBJ_XBODY, holding.holder)
        position = _add(spec, "held", _KIND.mjSENS_FRAMEPOS, held)
        position.reftype, position.refname = holder
        _add(spec, "holder", _KIND.mjSENS_FRAMEQUAT, holder)
    for name in [actuator.name for actuator in spec.actuators]:
        _add(spec, _FORCE + name, _KIND.mjSENS_ACTUATORFRC, (_OBJ.mjOBJ_ACTUATOR, name))
    for name in [tendon.name for tendon in spec.tendons]:
        _add(spec, _LENGTH + name, _KIND.mjSENS_TENDONPOS, (_OBJ.mjOBJ_TENDON, name))


def _add(
    spec: mujoco.MjSpec, name: str, kind: mujoco.mjtSensor, of: tuple[mujoco.mjtObj, str] = _NOTHING
) -> MjsSensor:
    return spec.add_sensor(name=PREFIX + name, type=kind, objtype=of[0], objname=of[1])


def _add_contacts(
    spec: mujoco.MjSpec, name: str, settings: tuple[int, int, int], width: int
) -> MjsSensor:
    """Add a contact sensor; where MuJoCo has none, a user sensor that the engine fills."""
    if has_batch():
        sensor = _add(spec, name, _KIND.mjSENS_CONTACT)
        sensor.intprm[:3] = settings
        return sensor
    sensor = _add(spec, name, _KIND.mjSENS_USER)
    sensor.dim = width * settings[2]
    sensor.needstage = mujoco.mjtStage.mjSTAGE_ACC
    sensor.datatype = mujoco.mjtDataType.mjDATATYPE_REAL
    return sensor


def find_layout(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], holding: HoldSpec | None, *, free: bool
) -> SensorLayout:
    """Return the addresses of the added sensors in a compiled model's `sensordata`.

    Without them, those in rows that are read from a loop, in the order of `add_sensors`.
    """
    sensors = (model.sensor(index) for index in range(model.nsensor))
    found = {
        sensor.name.removeprefix(PREFIX): int(sensor.adr[0])
        for sensor in sensors
        if sensor.name.startswith(PREFIX)
    }
    if not found:
        forces, nowhere = 4 + 6 * free + 7 * bool(holding), (0,) * len(pairs)
        momenta, held = (4, 7) if free else (None, None), forces - 7 if holding else None
        return SensorLayout(nowhere, 0, 2, 3, *momenta, held, forces, forces + model.nu)
    return SensorLayout(
        pairs=tuple(found[pair.name] for pair in pairs),
        contacts=found["contacts"],
        **{name: found.get(name) for name in _NOT_ALWAYS},
        forces=found[_FORCE + model.actuator(0).name] if model.nu else 0,
        lengths=found[_LENGTH + model.tendon(0).name] if model.ntendon else 0,
    )


_MOST_FAULTS_LISTED = 3
_LINE = re.compile(r", line (\d+)")
_FOLDER_HINT = {
    False: '<compiler meshdir="FOLDER"/>, relative to the model',
    True: '<mujoco><compiler meshdir="FOLDER" strippath="true"/></mujoco> within <robot>',
}
_BRACES = re.compile(r"\{([^{}]*)\}")


def compile_model(
    source: SceneSource, structure: Mapping[str, object], edit: Callable[[mujoco.MjSpec], None]
) -> mujoco.MjModel:
    """Compile a scene's structure after an edit of its specification; a SceneError says why not.

    What is compiled already stays as it is.
    """
    with _model_file(source, structure) as path, _said_once(source):
        try:
            if path.suffix == BINARY:
                return _checked(mujoco.MjModel.from_binary_path(str(path)), source)
            spec = mujoco.MjSpec.from_file(str(path))
            for element in (*spec.meshes, *spec.hfields, *spec.skins, *spec.textures):
                if found := source.content.resources.get(plain_name(element.file)):
                    element.file = str(found)
            name_by_address(spec)
            edit(spec)
            return _checked(spec.compile(), source)
        except (ValueError, mujoco.FatalError) as error:
            raise compile_error(source.model, path, error) from error


def _checked(model: mujoco.MjModel, source: SceneSource) -> mujoco.MjModel:
    """Return a model that can be recorded; a SceneError says why not.

    Its options can be, but for the step, which a sweep may replace, and its actuators have one
    control and one force.
    """
    for option, told in wrong_options(model).items():
        if option != "timestep":
            raise SceneError(f"{source.model}: its {option} {told}, in <option {option}=.../>")
    for actuator in range(getattr(model, "nactuator", 0)):
        controls, forces = model.actuator_ctrlnum[actuator], model.actuator_outnum[actuator]
        if (controls, forces) != (1, 1):
            name = model.actuator(actuator).name
            raise SceneError(
                f"{source.model}: actuator '{name}' has {controls} controls and {forces} forces, "
                "and contactlab records one of each; write an actuator for each of them, such as "
                '<position joint="..."/> or <motor gear="..."/>'
            )
    return model


def wrong_options(model: mujoco.MjModel) -> Mapping[str, str]:
    """Return the attributes of <option> that no simulation can have, and what is wrong with each.

    They are not finite, or zero or negative where nothing in the world is.
    """
    found = dict[str, str]()
    for option in dir(model.opt):
        value = getattr(model.opt, option)
        if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
            told = " ".join(f"{number:g}" for number in np.ravel(value))
            found[option] = f"is {told}, which has to be finite"
        elif option in _ABOVE_ZERO and value <= 0:
            found[option] = f"is {value:g}, which has to be above 0"
        elif option in _NOT_BELOW_ZERO and value < 0:
            found[option] = f"is {value:g}, which has to be 0 or more"
    return found


_said: set[tuple[Path, str]] = set()


@contextmanager
def _said_once(source: SceneSource) -> Generator[None]:
    """Say what MuJoCo warns of once for each model, and nothing for a store's copy of it."""
    silence_mujoco()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for text in dict.fromkeys(str(warning.message) for warning in caught):
        warn_once(source, text, ModelWarning)


def warn_once(source: SceneSource, text: str, kind: type[ModelWarning]) -> None:
    """Warn of a model once in a process, and never of a store's copy of it."""
    if not source.content.copied and (source.model, text) not in _said:
        _said.add((source.model, text))
        warnings.warn(f"{source.model}: {text}", kind, stacklevel=2)


@contextmanager
def _model_file(source: SceneSource, structure: Mapping[str, object]) -> Generator[Path]:
    """Yield the model file, in a copy of the scene where something is written into it."""
    content = source.content
    moved = content.copied and content.absolute
    if not structure and not moved:
        yield source.model
        return
    with TemporaryDirectory(prefix="contactlab-") as folder:
        content.copy_to(Path(folder))
        files = [Path(folder) / file for file in content.files if file.suffix in MODEL_SUFFIXES]
        roots = {file: parse(file) for file in files}
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
                entry.attribute, _BRACES.sub(partial(_computed_text, name, value), entry.text)
            )


def _computed_text(name: str, value: object, braces: re.Match[str]) -> str:
    """Return what replaces braces in a structure's text: the value itself if they are empty."""
    if not braces[1]:
        return repr(value)
    try:
        return repr(Expression(braces[1]).evaluate({name: value}))
    except ExpressionError as error:
        raise SceneError(f"structure '{name}': cannot compute {braces[0]}: {error}") from error


def compile_error(model: Path, tried: Path, error: Exception) -> SceneError:
    """Return why a model, or the copy of it that was tried, does not compile, and what to write."""
    lines = str(error).strip().replace(str(tried), str(model)).splitlines()
    place = "".join(f":{found[1]}" for found in [_LINE.search(str(error))] if found)
    hints = list(_missing_file(lines[0], model))
    if "inertia" in lines[0] and "XML Error" not in lines[0]:
        # MuJoCo gives no access to a specification that it failed to compile.
        faults = written_inertia_faults(mujoco.MjSpec.from_file(str(tried)))
        hints += [
            f"body '{fault.body}': {fault.reason}" for fault in islice(faults, _MOST_FAULTS_LISTED)
        ]
    if "no decoder found" in lines[0]:
        hints.append(
            "MuJoCo reads meshes from .stl, .obj and .msh files; convert it to one of them"
        )
    return SceneError(
        "\n  ".join([f"{model}{place}: does not compile", *in_words(lines, model), *hints])
    )


def _missing_file(message: str, model: Path) -> Iterator[str]:
    """Yield where MuJoCo looked for a file that it cannot open."""
    if "opening file" not in message:
        return
    for path in (reference.path for reference in FileSearch().references(model)):
        if not path.is_file() and f"{path.name}'" in message:
            yield f"it was expected at {path}; put it there, or say where it is:"
            yield _FOLDER_HINT[model.suffix == ".urdf"]
            return


Kind = Literal[
    "not_positive", "triangle", "balanced", "density", "outside", "too_large", "too_small"
]


@dataclass(frozen=True)
class InertiaFault:
    """A body whose mass or inertia no real body has.

    The value violates the limit, both in the unit; the reason is the whole fault in words.
    """

    body: str
    kind: Kind
    value: float
    limit: float
    unit: str
    reason: str


def written_inertia_faults(spec: mujoco.MjSpec) -> Iterator[InertiaFault]:
    """Yield the faults of the inertias that a model file writes out, before it is compiled."""
    compiler = spec.compiler
    if compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        return
    for body in spec.bodies[1:]:
        # With joints, and no body fixed to it that could bring the inertia.
        alone = bool(body.joints) and all(child.joints for child in body.bodies)
        if not body.explicitinertial and (body.geoms or not alone):
            continue
        name = body.name or f"body {body.id}"
        mass = max(float(body.mass), compiler.boundmass or -np.inf)
        moments = np.maximum(_moments(body), compiler.boundinertia or -np.inf)
        # A body fixed to another may have no inertia of its own, but not a negative one.
        lower = mujoco.mjMINVAL if alone else -np.finfo(float).tiny
        if not np.min([mass, *moments]) > lower:
            yield not_positive(name, mass, moments)
        elif not closes(moments):
            yield open_triangle(name, moments, balanced=bool(compiler.balanceinertia))


def _moments(body: MjsBody) -> Floats:
    xx, yy, zz, xy, xz, yz = (float(entry) for entry in body.fullinertia)
    # The first number is NaN where diaginertia gives the moments.
    if np.isnan(xx):
        return np.array(body.inertia, np.float64)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.linalg.eigvalsh(tensor) if np.isfinite(tensor).all() else np.full(3, np.nan)


def not_positive(name: str, mass: float, moments: Floats) -> InertiaFault:
    """Return the fault of a body whose mass or inertia is zero or negative."""
    reason = (
        f"its mass is {mass:g} kg and its principal moments are {_listed(moments)} kg m^2; "
        "write all of them above 0"
    )
    least = float(np.min([mass, *moments]))
    return InertiaFault(name, "not_positive", least, 0.0, "kg or kg m^2", reason)


def closes(moments: Floats) -> bool:
    """Return whether no principal moment exceeds the sum of the other two."""
    low, middle, high = np.sort(moments)
    return bool(low + middle >= high)


def open_triangle(name: str, moments: Floats, *, balanced: bool) -> InertiaFault:
    """Return the fault of principal moments [kg m^2] that violate the triangle inequality.

    Balanced ones were replaced by their mean, by the compiler.
    """
    low, middle, high = np.sort(moments).tolist()
    end = f"; balanceinertia replaced all three by their mean, {np.mean(moments):g}"
    reason = (
        f"its principal moments are {_listed(moments)} kg m^2, and no mass distribution has "
        f"{low:g} + {middle:g} < {high:g}" + (end if balanced else "")
    )
    kind = "balanced" if balanced else "triangle"
    return InertiaFault(name, kind, high, low + middle, "kg m^2", reason)


def _listed(moments: Floats) -> str:
    return ", ".join(f"{moment:g}" for moment in moments)
