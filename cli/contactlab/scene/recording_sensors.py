"""The sensors that record a run, and their addresses in `sensordata`."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
from mujoco._specs import MjsSensor

from contactlab.contact import SLOT_WIDTH
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.mujoco_versions import has_contact_sensors
from contactlab.scene.timed_inputs import HoldSpec

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
