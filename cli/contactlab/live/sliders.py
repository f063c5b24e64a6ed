"""Which values a reader can give the axes of a run: those that were swept, and the usual ones."""

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

_FEWEST = 9  # numbers of a slider, where the sweep has fewer
_MOST = 33
_DIGITS = 4
_WIDE = 8.0  # numbers that are so many times each other are halved as ratios are
_SCALES = (0.25, 0.5, 1.0, 2.0, 4.0)


def _scaled(own: object) -> Sequence[object]:
    return [as_number(own) * scale for scale in _SCALES]


# Settings that any contact hangs on: which number of a setting each is, and what it can be.
_USUAL: Mapping[str, tuple[int | None, Callable[[object], Sequence[object]]]] = {
    "timestep": (None, _scaled),
    "integrator": (None, lambda _: WORDS["integrator"]),
    "cone": (None, lambda _: WORDS["cone"]),
    "impratio": (None, lambda _: (1.0, 3.0, 10.0, 30.0, 100.0)),
    "friction.slide": (0, _scaled),
    "solref.timeconst": (0, _scaled),
    "solimp.dmax": (1, lambda _: (0.9, 0.95, 0.99, 0.999)),
    "noslip_iterations": (None, lambda _: (0, 5, 20)),
}


def offered_values(
    scene: Scene, columns: RunColumns, record: EvidenceRecord, axes: Mapping[str, object]
) -> Iterator[tuple[AxisSpec, object, list[object]]]:
    """Yield axes of a stored run, each with the run's own value and all values, it among them.

    `axes` are the canonical values of the axes that the run was given. Between numbers that were
    swept there are others, but of the structure, which takes a compiled model for each.
    """
    given = [spec for spec in map(scene.catalogue.find, axes) if spec is not None]
    structure = scene.resolve({}, 0, None).structure
    for spec in given:
        own, stored = axes[spec.name], columns.coded(spec.name).values
        swept = [spec.parse(value) for value in stored if value is not None]
        finer = [] if spec.name in structure else _between(swept)
        yield spec, own, _listed(spec, own, [*swept, *finer])
    for name, (place, offered) in _USUAL.items():
        spec, setting = scene.catalogue.find(name), record.settings.get(attribute_of(name))
        if spec is None or setting is None or any(_same_thing(spec, other) for other in given):
            continue
        own = setting if place is None else as_vector(setting)[place]
        # A solref in direct form has no time constant.
        if spec.accepts(own):
            yield spec, spec.parse(own), _listed(spec, spec.parse(own), offered(own))


def value_text(value: object) -> str:
    """Return a canonical value as a reader reads it."""
    if isinstance(value, tuple):
        return " ".join(map(value_text, cast("tuple[object, ...]", value)))
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:.{_DIGITS}g}" if isinstance(value, float) else str(value)


def _same_thing(one: AxisSpec, other: AxisSpec) -> bool:
    return one.name == other.name or one.name in other.conflicts or other.name in one.conflicts


def _between(values: Sequence[object]) -> list[object]:
    """Return numbers between those that were swept, each neighbours' mean, or finer."""
    if len(values) < 2 or not all(type(value) is float for value in values):
        return []
    swept = sorted({cast("float", value) for value in values})
    parts = -(-(_FEWEST - 1) // max(1, len(swept) - 1))
    wide = swept[0] > 0 and swept[-1] / swept[0] >= _WIDE
    spread = np.geomspace if wide else np.linspace
    inner = [spread(low, high, parts + 1)[1:-1] for low, high in pairwise(swept)]
    return [float(f"{number:.{_DIGITS}g}") for part in inner for number in part.tolist()]


def _listed(spec: AxisSpec, own: object, values: Sequence[object]) -> list[object]:
    """Return the values that an axis takes, once each, numbers in order; the own one is kept."""
    taken = list(dict.fromkeys([own, *filter(spec.accepts, values)]))
    if all(isinstance(value, (int, float)) for value in taken):
        taken.sort(key=as_number)
    elif spec.choices:
        taken.sort(key=lambda value: spec.choices.index(str(value)))
    if len(taken) <= _MOST:
        return taken
    kept = {*np.linspace(0, len(taken) - 1, _MOST).astype(int).tolist(), taken.index(own)}
    return [taken[place] for place in sorted(kept)]
