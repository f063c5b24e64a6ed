"""The distinct sets of contact parameters of a model's graded pairs."""

from collections.abc import Mapping
from dataclasses import dataclass

from contactlab.schema import PairRecord
from contactlab.studies.check.lines import written
from contactlab.studies.check.options import axis_value
from contactlab.studies.check.target import Target

_REFSAFE = 2.0
_SHARES = (1e-4, 0.9999)
_LEAST_WIDTH = 1e-15


@dataclass(frozen=True)
class ContactSet:
    """Pairs of the same contact parameters.

    Attributes:
        record: the parameters.
        solref: as the engine takes it: time constants are raised to two timesteps.
        pairs: names of the pairs.
    """

    record: PairRecord
    solref: tuple[float, ...]
    pairs: tuple[str, ...]

    @property
    def name(self) -> str:
        """Its parameters, in words."""
        record = self.record
        said = f"solref {written(record.solref)}, solimp {written(record.solimp)}"
        if record.margin:
            said += f", margin {record.margin:g}"
        return f"{said}, condim {record.condim}, friction {record.friction[0]:g}"

    @property
    def axes(self) -> Mapping[str, object]:
        """The parameters as axes take them."""
        names = ("solref", "friction", "condim", "margin", "gap")
        values = {name: axis_value(name, getattr(self.record, name)) for name in names}
        return {**values, "solimp": _proper(self.record.solimp)}


def contact_sets(target: Target) -> list[ContactSet]:
    """Return the sets in the order of the pairs."""
    pairs: dict[PairRecord, list[str]] = {}
    for name, record in target.prepared.pairs.items():
        pairs.setdefault(record, []).append(name)
    return [
        ContactSet(record, kept_solref(target, record.solref), tuple(names))
        for record, names in pairs.items()
    ]


def kept_solref(target: Target, solref: tuple[float, ...]) -> tuple[float, ...]:
    """Return a solref as the engine takes it: refsafe raises a time constant to two timesteps."""
    if solref[0] <= 0 or not target.resolved.flags["refsafe"]:
        return solref
    return max(solref[0], _REFSAFE * target.resolved.timestep), solref[1]


def _proper(solimp: tuple[float, ...]) -> tuple[float, ...]:
    """Return an impedance within the bounds that the engine holds it to."""
    low, high = _SHARES
    start, end, middle = (min(max(solimp[place], low), high) for place in (0, 1, 3))
    return start, end, max(solimp[2], _LEAST_WIDTH), middle, max(solimp[4], 1.0)
