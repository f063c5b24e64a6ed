"""Compile a scene's model with its structure values written and recording sensors added.

The sensors' addresses in `sensordata` are known from here; so is why MuJoCo refuses a model.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
from mujoco._specs import MjsSensor

from contactlab.contact.trace_arrays import SLOT_WIDTH
from contactlab.errors import SceneError
from contactlab.expression import Expression, ExpressionError
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.mujoco_versions import has_contact_sensors
from contactlab.scene.scene_source import (
    MODEL_SUFFIXES,
    SceneSource,
    find_resource,
    is_resource,
    parse,
    references,
)
from contactlab.scene.timed_inputs import HoldSpec
from contactlab.scene.written_inertia import written_inertia_faults

PREFIX = "contactlab/"
_ALL_FIELDS = (1 << 9) - 1
_FOUND_AND_DISTANCE = 1 << 0 | 1 << 3
_FIRST = 0
_NEAREST = 1


@dataclass(frozen=True)
class SensorLayout:
    """Addresses in `sensordata`.

    Attributes:
        size: length of `sensordata`.
        pairs: where the contact slots of each monitored pair start.
        contacts: address of the count of all contacts, followed by their smallest distance.
        kinetic: address of the kinetic energy, or None.
        potential: address of the potential energy, or None.
        momentum: address of the velocity of the centre of mass, or None.
        angular_momentum: address of the angular momentum, or None.
        held: address of the held body's position relative to its holder, followed by the holder's
            orientation, or None.
    """

    size: int
    pairs: tuple[int, ...]
    contacts: int
    kinetic: int | None
    potential: int | None
    momentum: int | None
    angular_momentum: int | None
    held: int | None


def add_sensors(
    spec: mujoco.MjSpec,
    pairs: Sequence[MonitoredPair],
    holding: HoldSpec | None,
    *,
    free: bool,
    energy: bool,
) -> None:
    """Add what a run records: contacts of each monitored pair, all contacts, energies, momenta."""
    for pair in pairs:
        kind = mujoco.mjtObj.mjOBJ_BODY if pair.bodies else mujoco.mjtObj.mjOBJ_GEOM
        sensor = _add_contacts(spec, pair.name, (_ALL_FIELDS, _FIRST, pair.slots), SLOT_WIDTH)
        sensor.objtype = sensor.reftype = kind
        sensor.objname, sensor.refname = pair.sides
    _add_contacts(spec, "contacts", (_FOUND_AND_DISTANCE, _NEAREST, 1), 2)
    if energy:
        _add(spec, "kinetic", mujoco.mjtSensor.mjSENS_E_KINETIC)
        _add(spec, "potential", mujoco.mjtSensor.mjSENS_E_POTENTIAL)
    if free:
        for name, kind in (
            ("momentum", mujoco.mjtSensor.mjSENS_SUBTREELINVEL),
            ("angular_momentum", mujoco.mjtSensor.mjSENS_SUBTREEANGMOM),
        ):
            sensor = _add(spec, name, kind)
            sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_BODY, "world"
    if holding:
        _add_holding(spec, holding)


def _add_contacts(
    spec: mujoco.MjSpec, name: str, settings: tuple[int, int, int], width: int
) -> MjsSensor:
    """Add a contact sensor; where MuJoCo has none, a user sensor that the engine fills."""
    if has_contact_sensors():
        sensor = _add(spec, name, mujoco.mjtSensor.mjSENS_CONTACT)
        sensor.intprm[:3] = settings
        return sensor
    sensor = _add(spec, name, mujoco.mjtSensor.mjSENS_USER)
    sensor.dim = width * settings[2]
    sensor.needstage = mujoco.mjtStage.mjSTAGE_ACC
    sensor.datatype = mujoco.mjtDataType.mjDATATYPE_REAL
    return sensor


def _add_holding(spec: mujoco.MjSpec, holding: HoldSpec) -> None:
    frame = mujoco.mjtObj.mjOBJ_XBODY
    position = _add(spec, "held", mujoco.mjtSensor.mjSENS_FRAMEPOS)
    position.objtype, position.objname = frame, holding.subject
    position.reftype, position.refname = frame, holding.holder
    orientation = _add(spec, "holder", mujoco.mjtSensor.mjSENS_FRAMEQUAT)
    orientation.objtype, orientation.objname = frame, holding.holder


def find_layout(
    model: mujoco.MjModel,
    pairs: Sequence[MonitoredPair],
    holding: HoldSpec | None,
    *,
    free: bool,
    energy: bool,
) -> SensorLayout:
    """Return the addresses of the added sensors in a compiled model's `sensordata`."""

    def address(name: str) -> int:
        return int(model.sensor(PREFIX + name).adr[0])

    for pair in pairs:
        assert int(model.sensor(PREFIX + pair.name).dim[0]) == pair.slots * SLOT_WIDTH
    return SensorLayout(
        size=model.nsensordata,
        pairs=tuple(address(pair.name) for pair in pairs),
        contacts=address("contacts"),
        kinetic=address("kinetic") if energy else None,
        potential=address("potential") if energy else None,
        momentum=address("momentum") if free else None,
        angular_momentum=address("angular_momentum") if free else None,
        held=address("held") if holding else None,
    )


def _add(spec: mujoco.MjSpec, name: str, kind: mujoco.mjtSensor) -> MjsSensor:
    return spec.add_sensor(name=PREFIX + name, type=kind)


_MAX_LISTED = 3
_FOLDER_HINT = {
    False: '<compiler meshdir="FOLDER"/>, relative to the model',
    True: '<mujoco><compiler meshdir="FOLDER" strippath="true"/></mujoco> within <robot>',
}
_BRACES = re.compile(r"\{([^{}]*)\}")


def compile_model(
    source: SceneSource, structure: Mapping[str, object], edit: Callable[[mujoco.MjSpec], None]
) -> mujoco.MjModel:
    """Compile one structure of a scene, after a last edit of its specification.

    Raises:
        SceneError: the model does not compile, or no element takes a structure value.
    """
    with _model_file(source, structure) as path:
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            _find_packages(spec, path.parent)
            _name_geoms(spec)
            edit(spec)
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise compile_error(source.model, path, error) from error


@contextmanager
def _model_file(source: SceneSource, structure: Mapping[str, object]) -> Generator[Path]:
    """Yield the model file, in a copy of the scene where structure values are written."""
    if not structure:
        yield source.model
        return
    with TemporaryDirectory(prefix="contactlab-") as folder:
        source.content.copy_to(Path(folder))
        with source.named_in_errors():
            _write_structure(Path(folder), source, structure)
        yield Path(folder) / source.content.model


def _write_structure(folder: Path, source: SceneSource, structure: Mapping[str, object]) -> None:
    entries = source.manifest.structure if source.manifest else {}
    files = [folder / file for file in source.content.files if file.suffix in MODEL_SUFFIXES]
    roots = {file: parse(file) for file in files}
    for name, value in structure.items():
        entry = entries[name]
        try:
            elements = [each for root in roots.values() for each in root.findall(entry.element)]
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
    for file, root in roots.items():
        ET.ElementTree(root).write(file)


def _computed_text(name: str, value: object, braces: re.Match[str]) -> str:
    """Return what replaces braces in a structure's text: the value itself if they are empty."""
    if not braces[1]:
        return repr(value)
    try:
        return repr(Expression(braces[1]).evaluate({name: value}))
    except ExpressionError as error:
        raise SceneError(f"structure '{name}': cannot compute {braces[0]}: {error}") from error


def _find_packages(spec: mujoco.MjSpec, folder: Path) -> None:
    for mesh in spec.meshes:
        if is_resource(mesh.file) and (resource := find_resource(mesh.file, folder)).is_file():
            mesh.file = str(resource.absolute())


def _name_geoms(spec: mujoco.MjSpec) -> None:
    taken = {geom.name for geom in spec.geoms}
    for index, geom in enumerate(spec.geoms):
        name = geom.name or f"geom{index}"
        while not geom.name and name in taken:
            name += "_"
        geom.name = name


def compile_error(model: Path, tried: Path, error: Exception) -> SceneError:
    """Return the error for a model that does not compile, with what to write instead.

    Args:
        model: its file, for the message.
        tried: the file that was compiled, which may be a copy.
        error: what MuJoCo raised.
    """
    lines = str(error).strip().replace(str(tried), str(model)).splitlines()
    hints = [*_missing_file(lines[0], model), *_impossible_inertias(lines[0], tried)]
    return SceneError("\n  ".join([f"{model}: does not compile", *lines, *hints]))


def _impossible_inertias(message: str, tried: Path) -> Iterator[str]:
    """Yield the inertias that no real body has."""
    if "inertia" in message:
        # MuJoCo gives no access to a specification that it failed to compile.
        spec = mujoco.MjSpec.from_file(str(tried))
        for fault in written_inertia_faults(spec)[:_MAX_LISTED]:
            yield f"body '{fault.body}': {fault.reason}"


def _missing_file(message: str, model: Path) -> Iterator[str]:
    """Yield where MuJoCo looked for a file that it cannot open."""
    if "opening file" not in message:
        return
    for path in references(model):
        if not path.is_file() and f"{path.name}'" in message:
            yield f"it was expected at {path}; put it there, or say where it is:"
            yield _FOLDER_HINT[model.suffix == ".urdf"]
            return
