"""The sensors that record a run, and where their numbers lie in `sensordata`."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
from mujoco._specs import MjsSensor

from contactlab.scene.pairs import Pair
from contactlab.trace import SLOT_WIDTH

_PREFIX = "contactlab/"
_ALL_FIELDS = (1 << 9) - 1
_FOUND = 1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND)
_DIST = 1 << int(mujoco.mjtConDataField.mjCONDATA_DIST)
_FIRST = 0
_NEAREST = 1


@dataclass(frozen=True)
class Layout:
    """Addresses in `sensordata`.

    Attributes:
        size: length of `sensordata`.
        pairs: where each graded pair's slots start.
        contacts: address of the count of all contacts, followed by the least distance.
        kinetic: address of the kinetic energy.
        potential: address of the potential energy.
        momentum: address of the velocity of the centre of mass, or None.
        spin: address of the angular momentum, or None.
    """

    size: int
    pairs: tuple[int, ...]
    contacts: int
    kinetic: int
    potential: int
    momentum: int | None
    spin: int | None


def add_sensors(spec: mujoco.MjSpec, pairs: Sequence[Pair], *, free: bool) -> None:
    """Add what a run records: contacts of each graded pair, all contacts, energies, momenta."""
    for pair in pairs:
        kind = mujoco.mjtObj.mjOBJ_BODY if pair.bodies else mujoco.mjtObj.mjOBJ_GEOM
        sensor = _add(spec, pair.name, mujoco.mjtSensor.mjSENS_CONTACT)
        sensor.objtype = sensor.reftype = kind
        sensor.objname, sensor.refname = pair.sides
        sensor.intprm[:3] = [_ALL_FIELDS, _FIRST, pair.slots]
    everything = _add(spec, "contacts", mujoco.mjtSensor.mjSENS_CONTACT)
    everything.intprm[:3] = [_FOUND | _DIST, _NEAREST, 1]
    _add(spec, "kinetic", mujoco.mjtSensor.mjSENS_E_KINETIC)
    _add(spec, "potential", mujoco.mjtSensor.mjSENS_E_POTENTIAL)
    if free:
        for name, kind in (
            ("momentum", mujoco.mjtSensor.mjSENS_SUBTREELINVEL),
            ("spin", mujoco.mjtSensor.mjSENS_SUBTREEANGMOM),
        ):
            sensor = _add(spec, name, kind)
            sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_BODY, "world"


def find_layout(model: mujoco.MjModel, pairs: Sequence[Pair], *, free: bool) -> Layout:
    """Return where the added sensors' numbers lie in a compiled model's `sensordata`."""

    def address(name: str) -> int:
        return int(model.sensor(_PREFIX + name).adr[0])

    for pair in pairs:
        assert int(model.sensor(_PREFIX + pair.name).dim[0]) == pair.slots * SLOT_WIDTH
    return Layout(
        size=model.nsensordata,
        pairs=tuple(address(pair.name) for pair in pairs),
        contacts=address("contacts"),
        kinetic=address("kinetic"),
        potential=address("potential"),
        momentum=address("momentum") if free else None,
        spin=address("spin") if free else None,
    )


def _add(spec: mujoco.MjSpec, name: str, kind: mujoco.mjtSensor) -> MjsSensor:
    return spec.add_sensor(name=_PREFIX + name, type=kind)
