"""Write resolved settings into a compiled model."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.mjcf import CONTACT, OPTIONS
from contactlab.scene.contact_pairs import MonitoredPair, explicit_pair
from contactlab.scene.effects import EFFECTS
from contactlab.scene.model_fields import is_field, write_field
from contactlab.scene.model_options import FLAGS, write_flags, write_option
from contactlab.scene.setting_values import Settings, as_number


@dataclass(frozen=True)
class EditTargets:
    """Where contact and mass settings go.

    Attributes:
        geoms: ids of the geoms of the monitored pairs that no <pair> element covers.
        explicit: indices of the <pair> elements of the monitored pairs.
        subject: id of the body that the setting `mass` means, if there is one.
    """

    geoms: tuple[int, ...]
    explicit: tuple[int, ...]
    subject: int | None

    def rows(self, field: str) -> list[int]:
        """Return the rows of a field of geoms, or of <pair> elements, that are theirs."""
        return list(self.geoms if field.startswith("geom") else self.explicit)


def find_targets(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], subject: int | None
) -> EditTargets:
    """Return the geoms and <pair> elements behind the monitored pairs."""
    geoms: set[int] = set()
    explicit: set[int] = set()
    for pair in pairs:
        for first in pair.geoms[0]:
            for second in pair.geoms[1]:
                index = explicit_pair(model, first, second)
                geoms |= {first, second} if index is None else set()
                explicit |= set() if index is None else {index}
    return EditTargets(tuple(sorted(geoms)), tuple(sorted(explicit)), subject)


def apply_settings(
    model: mujoco.MjModel, changed: Mapping[str, object], targets: EditTargets
) -> None:
    """Write the changed settings into a model, in place.

    Args:
        model: a copy that this call may edit.
        changed: resolved settings by name; only these are touched.
        targets: where contact and mass settings go.
    """
    write_flags(model, {name: bool(changed[name]) for name in FLAGS if name in changed})
    derived = False
    for name, value in changed.items():
        if name in OPTIONS:
            write_option(model, name, value)
        elif name in CONTACT:
            _write_contact(model, name, value, targets)
            derived |= name in ("margin", "gap")
        elif name == "mass":
            _write_mass(model, as_number(value), targets)
            derived = True
        elif name in EFFECTS and name not in FLAGS:
            EFFECTS[name].switch.write(model, bool(value))
        elif is_field(model, name):
            derived |= write_field(model, name, value)
    if derived:
        mujoco.mj_setConst(model, mujoco.MjData(model))


def geoms_written(changed: Iterable[str], targets: EditTargets) -> tuple[int, ...]:
    """Return the ids of the geoms that `apply_settings` gives contact parameters to."""
    return targets.geoms if set(changed) & set(CONTACT) else ()


def nonuniform_settings(
    model: mujoco.MjModel, settings: Settings, targets: EditTargets
) -> frozenset[str]:
    """Return the contact settings that not every target has as `settings` says."""
    return frozenset(
        name
        for name in CONTACT
        if name in settings
        for field, row in _rows(name, settings[name]).items()
        if np.any(getattr(model, field)[targets.rows(field)] != row)
    )


def _rows(name: str, value: object) -> dict[str, np.ndarray]:
    """Return the model fields of a contact setting, each with the value of its rows.

    Every monitored geom is given the pair's value, so that mixing equal values returns it.
    """
    row = np.asarray(value)
    if name == "friction":
        return {"geom_friction": row[[0, 2, 3]], "pair_friction": row}
    if name == "condim":
        return {"geom_condim": row, "pair_dim": row}
    # MuJoCo adds the margins, and the gaps, of the two geoms.
    half = row / 2 if name in ("margin", "gap") else row
    return {f"geom_{name}": half, f"pair_{name}": row}


def _write_contact(model: mujoco.MjModel, name: str, value: object, targets: EditTargets) -> None:
    for field, row in _rows(name, value).items():
        getattr(model, field)[targets.rows(field)] = row


def _write_mass(model: mujoco.MjModel, mass: float, targets: EditTargets) -> None:
    """Scale the subject's mass and inertia alike, as another density would."""
    if targets.subject is None:
        raise SceneError("`mass` needs a subject; name a body in the scene's `subject`")
    ratio = mass / float(model.body_mass[targets.subject])
    model.body_mass[targets.subject] = mass
    model.body_inertia[targets.subject] *= ratio
