"""Which values a reader can give the axes of a run: those that were swept, and the usual ones."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import cast

import numpy as np

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
_RATIOS = (1.0, 3.0, 10.0, 30.0, 100.0)
_IMPEDANCES = (0.9, 0.95, 0.99, 0.999)
_ITERATIONS = (0, 5, 20)


def offered_values(
    scene: Scene, columns: RunColumns, record: EvidenceRecord, axes: Mapping[str, object]
) -> Iterator[tuple[AxisSpec, object, list[object]]]:
    """Yield axes of a stored run, each with the run's own value and all values, it among them.

    `axes` are the canonical values of the axes that the run was given. Between numbers that were
    swept there are others, but of the structure, which takes a compiled model for each.
    """
    given = [spec for spec in map(scene.catalogue.find, axes) if spec is not None]
    structure = scene.base({}).settings and scene.resolve({}, 0, None).structure
    for spec in given:
        own, stored = axes[spec.name], columns.coded(spec.name).values
        swept = [spec.parse(value) for value in stored if value is not None]
        finer = [] if spec.name in structure else _between(swept)
        yield spec, own, _listed(spec, own, [*swept, *finer])
    for name, own, values in _usual(record):
        spec = scene.catalogue.find(name)
        if spec and not any(_same_thing(spec, other) for other in given):
            yield spec, own, _listed(spec, own, values)


def value_text(value: object) -> str:
    """Return a canonical value as a reader reads it."""
    if isinstance(value, tuple):
        return " ".join(map(value_text, cast("tuple[object, ...]", value)))
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:.{_DIGITS}g}" if isinstance(value, float) else str(value)


def _usual(record: EvidenceRecord) -> Iterator[tuple[str, object, Sequence[object]]]:
    """Yield settings that any contact hangs on, with the run's own and other values."""
    settings = record.settings

    def scaled(own: float) -> list[object]:
        return [own * scale for scale in _SCALES]

    if settings.get("timestep"):
        own = as_number(settings["timestep"])
        yield "timestep", own, scaled(own)
    for name in ("integrator", "cone"):
        if name in settings:
            yield name, settings[name], WORDS[name]
    if settings.get("impratio") is not None:
        yield "impratio", as_number(settings["impratio"]), _RATIOS
    if settings.get("friction"):
        own = as_vector(settings["friction"])[0]
        yield "friction.slide", own, scaled(own)
    if settings.get("solref") and (own := as_vector(settings["solref"])[0]) > 0:
        yield "solref.timeconst", own, scaled(own)
    if settings.get("solimp"):
        yield "solimp.dmax", as_vector(settings["solimp"])[1], _IMPEDANCES
    if settings.get("noslip_iterations") is not None:
        yield "noslip_iterations", settings["noslip_iterations"], _ITERATIONS


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
