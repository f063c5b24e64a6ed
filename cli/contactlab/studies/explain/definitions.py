"""Published definitions of labels, metrics, thresholds, effects and axes."""

from collections.abc import Callable, Iterator

from contactlab.errors import SweepFileError
from contactlab.measure import LABELS, METRICS, THRESHOLDS, Label, Metric, Threshold
from contactlab.mjcf import CONTACT, OPTIONS
from contactlab.plan.mistakes import MISTAKES
from contactlab.scene.effects.effect import Effect
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.parameters import PARAMETERS, Parameter


def is_defined(name: str) -> bool:
    """Return whether something has this name."""
    return name in _definitions()


def define(name: str) -> str:
    """Return what a word means, in lines; a SweepFileError if nothing has this name."""
    known = _definitions()
    SweepFileError.unless_known(
        name,
        known,
        f"nothing is called '{name}'",
        "; `contactlab list` says where names are listed",
    )
    return "\n".join(known[name](name))


def _definitions() -> dict[str, Callable[[str], Iterator[str]]]:
    """Return what says what a name means; a label's name counts more than a threshold's."""
    return {
        **dict.fromkeys(MISTAKES, _of_mistake),
        **dict.fromkeys(PARAMETERS, _of_axis),
        **dict.fromkeys([effect for effect in EFFECTS if effect not in PARAMETERS], _of_effect),
        **dict.fromkeys(THRESHOLDS, _of_threshold),
        **dict.fromkeys(METRICS, _of_metric),
        **dict.fromkeys(LABELS, _of_label),
    }


def _of_mistake(name: str) -> Iterator[str]:
    yield f"{name}: a mistake in a sweep file or an option"
    yield MISTAKES[name]


def _of_label(name: str) -> Iterator[str]:
    label: Label = LABELS[name]
    place = list(LABELS).index(name) + 1
    yield f"{name}: a label, {place} of {len(LABELS)} from the worst"
    yield label.meaning
    for threshold in label.thresholds:
        yield from _limit(threshold)
    yield f"change: {label.advice or 'see the reason in the run'}"
    yield "tried on your model: contactlab check MODEL"


def _limit(threshold: Threshold) -> Iterator[str]:
    default = "none" if threshold.default is None else f"{threshold.default:g} {threshold.unit}"
    yield f"limit {threshold.name}: {default.removesuffix(' 1')}. {threshold.source}"


def _of_metric(name: str) -> Iterator[str]:
    metric: Metric = METRICS[name]
    better = {"none": "neither way is better"}.get(metric.better, f"{metric.better} is better")
    yield f"{name} [{metric.unit}]: a metric, version {metric.version}; {better}"
    yield metric.definition
    for label in LABELS.values():
        for threshold in label.thresholds:
            if threshold.name == name:
                yield from _limit(threshold)
                yield f"over it, a run is {label.name}: {label.advice or label.meaning}"


def _of_threshold(name: str) -> Iterator[str]:
    labels = [label.name for label in LABELS.values() if THRESHOLDS[name] in label.thresholds]
    yield f"{name}: a threshold of {', '.join(labels)}"
    yield from _limit(THRESHOLDS[name])


def _of_axis(name: str) -> Iterator[str]:
    axis: Parameter = PARAMETERS[name]
    yield f"{name}{f' [{axis.unit}]' if axis.unit else ''}: an axis, {axis.description}"
    if axis.choices:
        yield f"values: {', '.join(axis.choices)}"
    if axis.parts:
        yield f"its numbers, as axes of their own: {', '.join(axis.parts)}"
    if axis.conflicts:
        yield f"not beside: {', '.join(axis.conflicts)}"
    where = "<option>" if axis.sets in OPTIONS else "<geom> and <pair>"
    if axis.sets in {*OPTIONS, *CONTACT}:
        yield f"in MJCF: {axis.sets} of {where}"


def _of_effect(name: str) -> Iterator[str]:
    effect: Effect = EFFECTS[name]
    yield f"{name}: an effect, {effect.kind}: {effect.what}"
    if effect.called_by:
        yield f"called for by {effect.called_by}"
    yield f"switch: true or false as an axis; contactlab effects MODEL says whether {name} matters"
