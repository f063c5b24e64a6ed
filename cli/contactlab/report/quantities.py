"""What was measured of a store's runs."""

from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.report.grid import titled
from contactlab.store import Measured, Store


@dataclass(frozen=True)
class Quantity:
    """One measured column of n runs.

    Attributes:
        told: its name, unit, direction and resolution.
        description: what it is.
        values: (n,), NaN where there is no finite one.
    """

    told: Measured
    description: str
    values: Floats

    @property
    def name(self) -> str:
        """Its name."""
        return self.told.name

    @property
    def title(self) -> str:
        """Its name with its unit."""
        return titled(self.told.name, self.told.unit)


def read_quantities(store: Store) -> tuple[Quantity, ...]:
    """Return the columns of measured values that any run has a value of."""
    found = (_quantity(store, told) for told in store.columns.measured.values())
    return tuple(each for each in found if np.isfinite(each.values).any())


def _quantity(store: Store, told: Measured) -> Quantity:
    values = store.columns.numbers(told.name).values
    metadata = store.columns.schema.field(told.name).metadata or {}
    finite = np.where(np.isfinite(values), values, np.nan)
    return Quantity(told, metadata.get(b"description", b"").decode(), finite)
