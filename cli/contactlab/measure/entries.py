"""Metrics, labels and oracles, and the decorators that declare them.

An entry is declared next to its computation: a decorator on its function states its properties,
and the function's docstring is its published definition. Plug-ins use the same decorators.
"""

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from inspect import cleandoc, iscoroutinefunction
from typing import Literal, NamedTuple, TypedDict, Unpack

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import PluginError, SceneError
from contactlab.measure.context import Context, runs_where
from contactlab.registry import Registry
from contactlab.schema.comparison import MetricRule
from contactlab.schema.evidence import LabelFacts

Direction = Literal["lower", "higher", "none"]
Kind = Literal["physics", "work", "check", "detail"]
Requirement = Literal["", "energy", "depth"]
MetricFunction = Callable[[Context], Floats]
OracleFunction = Callable[[Context], tuple[Floats, Floats]]

Severity = Literal["void", "bad", "poor", "noted", "good"]
SEVERITIES: Mapping[Severity, str] = {
    "void": "no measurement of the run is meaningful",
    "bad": "the run is physically wrong",
    "poor": "the run is worse than wanted",
    "noted": "the run is not as expected, or only partly known",
    "good": "no other label applies",
}
"""The bands of labels with their meanings, worst first."""
Trait = Literal["grip", "no impact", "note", "numerical", "required"]
_COLOUR_CODE = re.compile("#[0-9a-f]{6}")
_UNIT_TOLERANCES = {
    "m": 1e-4,
    "m/s": 1e-3,
    "rad": 0.01,
    "1": 0.01,
    "any": 0.01,
    "s": 0.02,
    "J": 1e-3,
}
"""By unit: 0.1 mm is the penetration that the guideline accepts; 1 mm/s is a fifth of the speed
that distinguishes sliding from sticking; ratios count to 1 %."""


@dataclass(frozen=True)
class Metric:
    """One number per run, and how to read it.

    Attributes:
        unit: its unit; `1` for counts and ratios, `any` if it depends on the scene.
        better: which direction is an improvement; `none` if it depends on the user's goal.
        resolution: smaller magnitudes count as 0, in its unit.
        definition: its definition as text, with its source.
        function: the metric of every run of a context, (n,); NaN if it does not apply.
        name: its name in sweeps, evidence and reports.
        tolerance: smaller changes, in its unit, count as no effect.
        version: grows whenever the definition changes.
        kind: `physics` for a result of the simulated physics, `work` for the solver's settings and
            work, `check` for a number that only the second pass measures, `detail` for a number
                that
            explains another metric and has no limit of its own.
        requires: data that must be recorded: energies, or distances that are depths; distances of
            speculative contacts are not.
        equivalence: whether another engine must reproduce it (`check repeat`).
        heading: its heading in the summary of a sweep; empty if it is not in it.
        rule: how `compare` judges it, if the rule of all metrics does not fit.
    """

    unit: str
    better: Direction
    resolution: float
    definition: str
    function: MetricFunction
    name: str
    tolerance: float
    version: int = 1
    kind: Kind = "physics"
    requires: Requirement = ""
    equivalence: bool = False
    heading: str = ""
    rule: MetricRule | None = None

    def of(self, context: Context) -> Floats:
        """Return (n,) values, 0 below the resolution, NaN for runs without a single step."""
        if context.trace.steps == 0:
            return context.undefined()
        returned = self.function(context)
        if np.iscomplexobj(returned):
            raise ValueError("it returns complex numbers")
        values = np.asarray(returned, dtype=np.float64)
        if values.shape != (context.trace.runs,):
            raise ValueError(f"it returns shape {values.shape} for {context.trace.runs} runs")
        return np.where(np.abs(values) < self.resolution, 0, values) if self.resolution else values


class MetricOptions(TypedDict, total=False):
    """Options of `metric` besides unit, direction and resolution; see `Metric`."""

    name: str
    tolerance: float
    version: int
    kind: Kind
    requires: Requirement
    equivalence: bool
    heading: str
    rule: MetricRule


class Onset(NamedTuple):
    """The reason why a label applies to a run, its first step, and its bodies.

    Without bodies it belongs to the whole run, and holds whatever is observed.
    """

    reason: str
    step: int
    bodies: tuple[str, ...] = ()


Onsets = dict[int, Onset]  # onsets of one label by run; runs without one are absent

OnsetIterator = Iterator[tuple[int, Onset]]
"""Onsets one by one; of several onsets of one run, the first counts, with the bodies of all."""


@dataclass(frozen=True)
class MeasuredRuns:
    """Runs that a label judges.

    Attributes:
        metrics: every metric of these runs, (n,) each.
    """

    context: Context
    metrics: Mapping[str, Floats]

    @cached_property
    def limits(self) -> dict[str, float]:
        """Thresholds by name; those without a value are absent."""
        return threshold_values(self.context.setup.thresholds)

    def over(self, metric: str, threshold: str = "") -> list[tuple[int, float, float]]:
        """Return run, value and limit if a metric exceeds a threshold, by default its own."""
        values, limit = self.metrics[metric], self.limits.get(threshold or metric, np.inf)
        return [(run, float(values[run]), limit) for run in runs_where(values > limit)]

    def only(self, run: int) -> "MeasuredRuns":
        """Return one of the runs."""
        metrics = {name: values[run : run + 1] for name, values in self.metrics.items()}
        return MeasuredRuns(self.context.only(run), metrics)


LabelRule = Callable[[MeasuredRuns], Onsets | OnsetIterator]


@dataclass(frozen=True)
class Threshold:
    """One limit of a label.

    Attributes:
        name: its name in scenes and sweeps.
        default: its value if neither sets it; None if it then limits nothing.
        unit: its unit; `1` for counts and ratios.
        source: the source of the default, and the limited quantity if not the metric of its name.
    """

    name: str
    default: float | None
    unit: str
    source: str


@dataclass(frozen=True)
class Label:
    """A named outcome of a run, with everything that is printed and drawn about it.

    Attributes:
        name: its name in sweeps, evidence and reports.
        meaning: its statement about a run, as text.
        severity: its band; the worst of a run's labels is that of the worst band.
        rank: its order within the band: the higher, the worse; of equal ones the first declared.
        advice: the recommended change; it follows "change:".
        letter: one character for it on maps; if it is taken or empty, another letter is used.
        colour: its color in pictures, `#rrggbb`; gray without one.
        thresholds: the limits that its rule reads.
        judged_on: metrics that order its runs, each with the name of its limit or ""; by default
            the metrics that its thresholds are named after.
        traits: further properties: `grip` if it says that a grip does not hold, `required` if it
            reports a violated requirement of a scene, `numerical` if its cause may be the step,
            `note` if it makes no verdict `fails`, such as a limit of the recorder,
            `no impact` if the first contact of its runs is not an impact of rigid bodies.
        rule: finds the runs that it applies to; None if it is known from outside the trace.
    """

    name: str
    meaning: str
    severity: Severity
    rank: float = 0
    advice: str = ""
    letter: str = ""
    colour: str = ""
    thresholds: tuple[Threshold, ...] = ()
    judged_on: tuple[tuple[str, str], ...] = ()
    traits: tuple[Trait, ...] = ()
    rule: LabelRule | None = None

    def __post_init__(self) -> None:
        """Raise PluginError for an invalid severity, letter or colour."""
        if self.severity not in SEVERITIES:
            bands = ", ".join(SEVERITIES)
            raise PluginError(
                f"label '{self.name}': severity must be one of {bands}; set the order "
                "within it by `rank`"
            )
        if len(self.letter) > 1:
            raise PluginError(f"label '{self.name}': letter '{self.letter}' is not one character")
        if self.colour and not _COLOUR_CODE.fullmatch(self.colour):
            raise PluginError(f"label '{self.name}': colour '{self.colour}' is not like '#1f77b4'")

    @property
    def facts(self) -> LabelFacts:
        """Its texts, letter and colour."""
        return LabelFacts(
            meaning=self.meaning, advice=self.advice, letter=self.letter, colour=self.colour
        )

    @property
    def measures(self) -> tuple[tuple[str, str], ...]:
        """Metrics that order its runs, each with the name of its limit or ""."""
        named = (threshold.name for threshold in self.thresholds)
        return self.judged_on or tuple((name, name) for name in named if name in METRICS)

    @property
    def is_severe(self) -> bool:
        """Whether the run is physically wrong, and not just worse than wanted."""
        return self.severity in {"void", "bad"}

    @property
    def is_good(self) -> bool:
        """Whether nothing is wrong with the run."""
        return self.severity == "good"

    @property
    def voids(self) -> bool:
        """Whether no measurement of the run is meaningful."""
        return self.severity == "void"

    @property
    def is_added(self) -> bool:
        """Whether a plug-in declares it."""
        return self.rule is not None and self.rule.__module__.partition(".")[0] != "contactlab"

    def of(self, runs: MeasuredRuns) -> list[Onset | None]:
        """Return the onset of the label for each run; None if it does not apply."""
        onsets = self.rule(runs) if self.rule else ()
        first: Onsets = {}
        for run, onset in onsets.items() if isinstance(onsets, dict) else onsets:
            if run not in range(runs.context.trace.runs):
                raise ValueError(f"it names run {run} of {runs.context.trace.runs}")
            earlier = first.setdefault(run, onset)
            bodies = dict.fromkeys((*earlier.bodies, *onset.bodies))
            whole = not (earlier.bodies and onset.bodies)
            first[run] = earlier._replace(bodies=() if whole else tuple(bodies))
        return [first.get(run) for run in range(runs.context.trace.runs)]


class OracleResult(NamedTuple):
    """Expected values of a closed form for n runs, measured values, and their gap, each (n,)."""

    expected: Floats
    measured: Floats
    error: Floats


@dataclass(frozen=True)
class Oracle:
    """A closed form for the behavior of a scene.

    Attributes:
        name: its name in scenes.
        unit: unit of the expected and measured values.
        relative: whether the error is a share of the expected value; otherwise it has the same
            unit.
        settings: names of the settings that it reads.
        definition: the law, with its source, and the measured quantity.
        function: expected and measured values of every run, each (n,).
    """

    name: str
    unit: str
    relative: bool
    settings: tuple[str, ...]
    definition: str
    function: OracleFunction

    def of(self, context: Context) -> OracleResult:
        """Return the expected and measured values of every run of a context, and the error."""
        with np.errstate(all="ignore"):
            expected, observed = self.function(context)
            error = np.abs(observed - expected)
            scale = np.abs(expected) if self.relative else 1
            return OracleResult(expected, observed, error / scale)


class _WorstFirst(Registry[Label]):
    """Labels in order of severity and rank, and of declaration where these are equal."""

    def add(self, entry: Label) -> Label:
        """Add a label and its thresholds."""
        for threshold in entry.thresholds:
            THRESHOLDS.add(threshold)
        super().add(entry)
        bands = list(SEVERITIES)
        worst_first = sorted(
            self.values(), key=lambda label: (bands.index(label.severity), -label.rank)
        )
        self.clear()
        self.update({label.name: label for label in worst_first})
        return entry


METRICS: Registry[Metric] = Registry("metric")  # every metric, in the order of the table's columns

LABELS: Registry[Label] = _WorstFirst("label")  # every label, worst first

THRESHOLDS: Registry[Threshold] = Registry("threshold")
ORACLES: Registry[Oracle] = Registry("oracle")


def metric(
    unit: str, better: Direction = "none", resolution: float = 0, **options: Unpack[MetricOptions]
) -> Callable[[MetricFunction], MetricFunction]:
    """Declare a metric: the function computes it, and its docstring defines it.

    Arguments are those of `Metric`; by default, the name is the function's, and the tolerance that
    of the unit. Raises a PluginError if the name is taken, or the function has no docstring.
    """

    def declare(function: MetricFunction) -> MetricFunction:
        usual = MetricOptions(name=function.__name__, tolerance=_UNIT_TOLERANCES.get(unit, 0.0))
        all_options: MetricOptions = {**usual, **options}
        METRICS.add(
            Metric(
                unit,
                better,
                resolution,
                _definition_in_docstring(function),
                function,
                **all_options,
            )
        )
        return function

    return declare


class LabelOptions(TypedDict, total=False):
    """Options of `label` besides the severity; see `Label`."""

    name: str
    rank: float
    advice: str
    letter: str
    colour: str
    thresholds: tuple[Threshold, ...]
    judged_on: tuple[tuple[str, str], ...]
    traits: tuple[Trait, ...]


def label(severity: Severity, **options: Unpack[LabelOptions]) -> Callable[[LabelRule], LabelRule]:
    """Declare a label: the function finds its runs, and its docstring is its meaning.

    Arguments are those of `Label`: a threshold may belong to several labels, and the name is the
    function's by default. Raises a PluginError if a name is taken, or there is no docstring.
    """

    def declare(rule: LabelRule) -> LabelRule:
        all_options: LabelOptions = {"name": rule.__name__, **options}
        LABELS.add(
            Label(
                meaning=_definition_in_docstring(rule), severity=severity, rule=rule, **all_options
            )
        )
        return rule

    return declare


def added_labels() -> dict[str, dict[str, str]]:
    """Return the facts of all labels that plug-ins declare, as written in a store."""
    return {name: label.facts.model_dump() for name, label in LABELS.items() if label.is_added}


def labels_with(trait: Trait) -> frozenset[str]:
    """Return the names of all labels with a trait."""
    return frozenset(name for name, label in LABELS.items() if trait in label.traits)


def oracle(
    unit: str, settings: tuple[str, ...], *, relative: bool
) -> Callable[[OracleFunction], OracleFunction]:
    """Declare an oracle: the function returns expected and measured values; see `Oracle`.

    Raises a PluginError if the name is taken, or the function has no docstring.
    """

    def declare(function: OracleFunction) -> OracleFunction:
        name, definition = function.__name__, _definition_in_docstring(function)
        ORACLES.add(Oracle(name, unit, relative, settings, definition, function))
        return function

    return declare


def _definition_in_docstring(function: Callable[..., object]) -> str:
    """Return a function's docstring in one paragraph; `python -OO` removes it."""
    if iscoroutinefunction(function):
        raise PluginError(f"'{function.__name__}' is declared by `async def`; write `def`")
    text = " ".join(cleandoc(function.__doc__ or "").split())
    if not text and sys.flags.optimize < 2:
        raise PluginError(f"'{function.__name__}' has no docstring; write its definition there")
    return text


def threshold_values(overrides: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every threshold that has one. Raises a SceneError for an unknown name."""
    rest = f"; there are {', '.join(THRESHOLDS)}"
    for name in overrides:
        SceneError.unless_known(name, THRESHOLDS, f"no threshold '{name}'", rest=rest)
    usual = {
        threshold.name: threshold.default
        for threshold in THRESHOLDS.values()
        if threshold.default is not None
    }
    return {**usual, **overrides}
