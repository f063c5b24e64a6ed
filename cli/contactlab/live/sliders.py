"""Chooses values of a run's axes for its reader: the swept ones, and usual ones."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import cast

import numpy as np

from contactlab.mjcf import attribute_of
from contactlab.scene.parameters import WORDS
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.setting_values import as_number, as_vector
from contactlab.schema.vocabulary import AxisSpec
from contactlab.store.run_columns import RunColumns

_TEXT_DIGITS = 4


def _scaled_values(own: object) -> Sequence[object]:
    factors = (0.25, 0.5, 1.0, 2.0, 4.0)
    return [as_number(own) * scale for scale in factors]


# Settings that affect any contact: index of a number in its setting, and its values.
_USUAL_VALUES: Mapping[str, tuple[int | None, Callable[[object], Sequence[object]]]] = {
    "timestep": (None, _scaled_values),
    "integrator": (None, lambda _: WORDS["integrator"]),
    "cone": (None, lambda _: WORDS["cone"]),
    "impratio": (None, lambda _: (1.0, 3.0, 10.0, 30.0, 100.0)),
    "friction.slide": (0, _scaled_values),
    "solref.timeconst": (0, _scaled_values),
    "solimp.dmax": (1, lambda _: (0.9, 0.95, 0.99, 0.999)),
    "noslip_iterations": (None, lambda _: (0, 5, 20)),
}


def offered_values(
    scene: Scene, columns: RunColumns, record: EvidenceRecord, axes: Mapping[str, object]
) -> Iterator[tuple[AxisSpec, object, list[object]]]:
    """Yield axes of a stored run, each with the run's own value and all values, including it.

    `axes` are the canonical values of the axes that the run was given. Further numbers are offered
    between swept ones, except for the structure, since each of its values needs a compiled model.
    """
    swept_axes = [spec for spec in map(scene.catalogue.find_axis, axes) if spec is not None]
    structure = scene.resolve({}, 0, None).structure
    for spec in swept_axes:
        own, stored = axes[spec.name], columns.read_codes(spec.name).values
        swept = [spec.parse(value) for value in stored if value is not None]
        finer = [] if spec.name in structure else _values_between(swept)
        yield spec, own, _accepted_values(spec, own, [*swept, *finer])
    for name, (place, offered) in _USUAL_VALUES.items():
        spec, setting = scene.catalogue.find_axis(name), record.settings.get(attribute_of(name))
        if (
            spec is None
            or setting is None
            or any(_same_setting(spec, other) for other in swept_axes)
        ):
            continue
        own = setting if place is None else as_vector(setting)[place]
        # A solref in direct form has no time constant.
        if spec.accepts_value(own):
            yield spec, spec.parse(own), _accepted_values(spec, spec.parse(own), offered(own))


def value_text(value: object) -> str:
    """Return a canonical value as text for a reader."""
    if isinstance(value, tuple):
        return " ".join(map(value_text, cast("tuple[object, ...]", value)))
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:.{_TEXT_DIGITS}g}" if isinstance(value, float) else str(value)


def _same_setting(one: AxisSpec, other: AxisSpec) -> bool:
    return one.name == other.name or one.name in other.conflicts or other.name in one.conflicts


def _values_between(values: Sequence[object]) -> list[object]:
    if len(values) < 2 or not all(type(value) is float for value in values):
        return []
    swept = sorted({cast("float", value) for value in values})
    least_values = 9  # smallest number of values on a slider, if the sweep has fewer
    parts = -(-(least_values - 1) // max(1, len(swept) - 1))
    ratio_spacing_from = 8.0  # smallest ratio of largest to smallest value for spacing by ratios
    wide = swept[0] > 0 and swept[-1] / swept[0] >= ratio_spacing_from
    spread = np.geomspace if wide else np.linspace
    inner = [spread(low, high, parts + 1)[1:-1] for low, high in pairwise(swept)]
    return [float(f"{number:.{_TEXT_DIGITS}g}") for part in inner for number in part.tolist()]


def _accepted_values(spec: AxisSpec, own: object, values: Sequence[object]) -> list[object]:
    """Return the accepted values of an axis, once each, numbers in order, always with its own."""
    accepted = list(dict.fromkeys([own, *filter(spec.accepts_value, values)]))
    if all(isinstance(value, (int, float)) for value in accepted):
        accepted.sort(key=as_number)
    elif spec.choices:
        accepted.sort(key=lambda value: spec.choices.index(str(value)))
    most_values = 33
    if len(accepted) <= most_values:
        return accepted
    kept_places = {
        *np.linspace(0, len(accepted) - 1, most_values).astype(int).tolist(),
        accepted.index(own),
    }
    return [accepted[place] for place in sorted(kept_places)]
