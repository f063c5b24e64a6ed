"""What a label, a metric, a threshold, an effect or an axis is, as it is published."""

from collections.abc import Callable, Iterator

from contactlab.errors import SweepFileError
from contactlab.measure import LABELS, METRICS, THRESHOLDS, Label, Metric, Threshold
from contactlab.mjcf import CONTACT, OPTIONS
from contactlab.scene.effects.effect import Effect
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.parameters import PARAMETERS, Parameter

CHANGES = {
    "crashed": "run it alone: contactlab replay STORE RUN; then a newer MuJoCo, with --mujoco",
    "timeout": "a shorter run, or a longer `timeout` in the sweep",
    "invalid": "read the reason: it says what the engine refuses, and what to write instead",
    "buffer_overflow": "give <size memory> more, or fewer geoms that collide",
    "diverged": "a shorter timestep; then look for light bodies on stiff joints or strong motors",
    "solver_inconsistent": "jacobian dense, solver Newton, and a smaller tolerance",
    "solver_nonconvergence": "solver Newton, more iterations; or softer contacts (solref)",
    "broken": "a shorter time constant of solref, solimp nearer 1, or less grip force",
    "tunneling": "a shorter timestep, thicker geoms, a shorter time constant of solref",
    "missed_contact": "contype, conaffinity and exclude: let the pair collide; multiccd for meshes",
    "constraint_violated": "a shorter time constant of limit or equality, or less load",
    "phantom_contact": "margin 0, or a convex shape that is nearer to what is seen",
    "asleep_unsupported": "sleep off, or a lower sleep_tolerance",
    "contact_at_distance": "margin 0, or gap as large as margin",
    "energy_injection": "a timestep of at most 0.8 times timeconst times dampratio of solref",
    "energy_loss": "a shorter timestep, or integrator RK4 for free motion",
    "penetration_growth": "more load than solref carries: a shorter time constant, or less force",
    "exploited": "a shorter time constant of solref, and impratio 10 with an elliptic cone",
    "squeezed": "start bodies apart: they overlap in the keyframe, or are closed onto each other",
    "deep_penetration": "another solref: contactlab explain depth_at_rest='.1 mm' MODEL",
    "drift": "impratio 10 and an elliptic cone, or a shorter time constant of solref",
    "chatter": "solimp 0.99 0.999 0.001, or a shorter timestep where solref is underdamped",
    "constraint_gain": "timestep at most half the shortest time constant, or a longer constant",
    "step_dependent": "shorten the timestep until the outcome stays: contactlab tune MODEL",
    "slipping": "more friction or grip; if it creeps, an elliptic cone with impratio 10",
    "unsettled": "a longer run, or more damping",
    "creep": "an elliptic cone with impratio 10, or a shorter time constant of solref",
    "pair_expectation": "the scene's `pairs` say what is expected: mend the scene, or the model",
    "unexpected_slide": "more friction; or priority, if the other geom's should count",
    "unexpected_stick": "less friction on both geoms, since the larger counts; or priority",
    "oracle_miss": "a shorter timestep; what then stays is the model's, as of pyramidal cones",
    "contacts_cut": "more `slots` of the pair in the scene",
    "stable": "nothing",
}


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
        rest="; contactlab metrics, labels and scenes MODEL list names",
    )
    return "\n".join(known[name](name))


def _definitions() -> dict[str, Callable[[str], Iterator[str]]]:
    """Return what says what a name means; a label's name counts more than a threshold's."""
    return {
        **dict.fromkeys(PARAMETERS, _of_axis),
        **dict.fromkeys([each for each in EFFECTS if each not in PARAMETERS], _of_effect),
        **dict.fromkeys(THRESHOLDS, _of_threshold),
        **dict.fromkeys(METRICS, _of_metric),
        **dict.fromkeys(LABELS, _of_label),
    }


def _of_label(name: str) -> Iterator[str]:
    label: Label = LABELS[name]
    worse = sum(each.severity > label.severity for each in LABELS.values())
    yield f"{name}: a label, {worse + 1} of {len(LABELS)} from the worst"
    yield label.meaning
    for each in label.thresholds:
        yield from _limit(each)
    # Labels of plug-ins have no advice here.
    yield f"change: {CHANGES.get(name, 'see the reason in the run')}"
    yield "tried on your model: contactlab check MODEL"


def _limit(each: Threshold) -> Iterator[str]:
    default = "none" if each.default is None else f"{each.default:g} {each.unit}"
    yield f"limit {each.name}: {default.removesuffix(' 1')}. {each.source}"


def _of_metric(name: str) -> Iterator[str]:
    metric: Metric = METRICS[name]
    better = {"none": "neither way is better"}.get(metric.better, f"{metric.better} is better")
    yield f"{name} [{metric.unit}]: a metric, version {metric.version}; {better}"
    yield metric.definition
    for label in LABELS.values():
        for each in label.thresholds:
            if each.name == name:
                yield from _limit(each)
                yield f"over it, a run is {label.name}: {CHANGES.get(label.name, label.meaning)}"


def _of_threshold(name: str) -> Iterator[str]:
    labels = [each.name for each in LABELS.values() if THRESHOLDS[name] in each.thresholds]
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
