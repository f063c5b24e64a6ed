"""Creates the trade-off report of a store: fronts, recommendations, blockers and notes."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.pareto.configurations import (
    ESTIMATES,
    PASS_COLUMNS,
    STABLE,
    EvaluatedConfiguration,
    ResolvedCriteria,
    StoredNumbers,
    StoredRuns,
    bounded_magnitudes,
    evaluate_configurations,
    find_insensitive_knobs,
    fix_insensitive_knobs,
    group_runs,
    is_chaotic,
    read_runs,
)
from contactlab.pareto.convergence import find_methods, varying_knobs
from contactlab.pareto.criteria import Criteria, error_measure, time_measure, tolerances_of
from contactlab.pareto.end_states import END_COLUMNS, mark_ends
from contactlab.pareto.recommendation import (
    SAFE_MARGIN,
    equally_fast,
    feasible_front,
    front_of,
    next_more_accurate,
    recommendable_places,
    setting_text,
)
from contactlab.rendering.amounts import format_percent
from contactlab.schema.coverage import ExercisedFeatures, Feature, feature_of
from contactlab.schema.tradeoff_report import (
    Blocker,
    Configuration,
    FrontPoint,
    NextStep,
    Recommendation,
    TradeoffReport,
)
from contactlab.store.finished_store import Store

_DEFAULT_CRITERIA = Criteria()


def analyze_tradeoff(store: Store, criteria: Criteria = _DEFAULT_CRITERIA) -> TradeoffReport:
    """Return the time that accuracy costs, over the configurations of a store.

    Raises a SweepFileError if the criteria name a column that the store does not have; a StoreError
    if the store has no values of an error.
    """
    tolerances = tolerances_of(store, criteria)
    error = error_measure(store, criteria, tolerances)
    resolved = ResolvedCriteria(error, time_measure(store), tolerances)
    names = (error.name, resolved.time.name, *tolerances, *PASS_COLUMNS, *END_COLUMNS)
    runs = read_runs(store, names)
    groups = group_runs(runs)
    evaluated = evaluate_configurations(runs, resolved, groups)
    if not is_chaotic(runs):
        evaluated = mark_ends(evaluated, runs, groups)
    front = feasible_front(evaluated)
    baseline = None if runs.baseline is None else evaluated[0].summary
    own = baseline and baseline.configuration
    summaries = tuple(configuration.summary for configuration in evaluated)
    possible = [evaluated[place] for place in recommendable_places(summaries)]
    chosen, safe = (equally_fast(possible, margin, own) for margin in (0.0, SAFE_MARGIN))
    best, insensitive = (chosen[0] if chosen else None), find_insensitive_knobs(evaluated)
    alike = fix_insensitive_knobs(evaluated, insensitive, best)
    next_step = None
    after = next_more_accurate(feasible_front(possible), best) if best else None
    if best and after:
        here, there = _front_point(best.summary), _front_point(after.summary)
        next_step = NextStep(
            configuration=there.configuration,
            time_ratio=there.time / here.time,
            error_ratio=here.error / there.error if there.error else None,
        )
    identity = store.manifest.sweep
    # Such an error may remain at any timestep.
    is_modeling = error.kind != "discretization" or error.reference == "written"
    swept = varying_knobs([configuration.values for configuration in evaluated])
    units = {name: store.columns.described[name].unit for name in runs.knobs}
    report = TradeoffReport(
        store=str(store.address),
        sweep=identity.name,
        scene=identity.scene,
        knobs=tuple(runs.knobs),
        units=units,
        scenarios=tuple(runs.scenarios),
        insensitive_knobs=tuple(insensitive),
        runs_per_configuration=max(configuration.cases for configuration in evaluated),
        error=error,
        time=resolved.time,
        tolerances=tolerances,
        chaotic=is_chaotic(runs),
        baseline=baseline,
        configurations=summaries,
        front=tuple(_front_point(configuration.summary) for configuration in front),
        unconstrained_front=tuple(_front_point(summaries[index]) for index in front_of(summaries)),
        methods=tuple(find_methods(alike, units, swept, is_modeling=is_modeling)),
        recommendation=_make_recommendation(store, chosen),
        robust=_make_recommendation(store, safe),
        next_step=next_step,
        blockers=tuple(_find_blockers(evaluated)),
        notes=(),
    )
    short = sum(configuration.cases < report.runs_per_configuration for configuration in evaluated)
    notes = [*_report_notes(report, runs, best, short), *_untested_knobs(store, runs)]
    return report.model_copy(update={"notes": tuple(notes)})


_COVERAGE_COLUMNS = ("coverage", "drive")


def _untested_knobs(store: Store, runs: StoredRuns) -> Iterator[str]:
    concerned: dict[Feature, list[str]] = {}
    for name, knob in runs.knobs.items():
        if len(knob.values) > 1 and (feature := feature_of(name)):
            concerned.setdefault(feature, []).append(name)
    if not concerned:
        return
    exercised = ExercisedFeatures.of_rows(
        store.columns.iterate_distinct(_COVERAGE_COLUMNS), enough=concerned.keys()
    )
    for feature, names in concerned.items():
        if lack := exercised.describe_lacking([feature]):
            yield f"{', '.join(names)}: not tested: {lack}"


def _front_point(summary: Configuration) -> FrontPoint:
    return FrontPoint(**summary.model_dump(include={*FrontPoint.model_fields}))


def _make_recommendation(
    store: Store, near: Sequence[EvaluatedConfiguration]
) -> Recommendation | None:
    if not near:
        return None
    chosen, *others = near
    return Recommendation(
        **chosen.summary.model_dump(include={*Recommendation.model_fields}),
        equally_fast=tuple(other.values for other in others),
        run_id=store.columns.run_id(chosen.first),
    )


def _find_blockers(evaluated: Sequence[EvaluatedConfiguration]) -> Iterator[Blocker]:
    exceeded = Counter(name for configuration in evaluated for name in configuration.exceeded)
    failed = Counter(label for configuration in evaluated for label in configuration.failures)
    for name, count in (exceeded + failed).most_common():
        # The smallest worst value of a metric.
        worst = (configuration.summary.worst.get(name) for configuration in evaluated)
        best = min((value for value in worst if value is not None), default=None)
        kind = "tolerance" if name in exceeded else "label"
        yield Blocker(name=name, kind=kind, configurations=count, best=best)


def _measurement_notes(report: TradeoffReport) -> Iterator[str]:
    time, configurations = report.time, report.configurations
    noisy_spread = 0.05  # spread of the rounds of a timing pass that deserves a note
    if time.source == "recording":
        yield (
            "times are of the recorded runs on a busy machine, accurate to 10 % at best; "
            "sweep with `timing: {rounds: 3}`"
        )
    elif time.spread is not None and time.spread > noisy_spread:
        yield (
            f"rounds of the timing pass differ by {format_percent(time.spread)}, median over "
            "minimum: smaller differences between configurations are noise"
        )
    if below := sum(configuration.below_estimate for configuration in configurations):
        yield (
            f"{below} of {len(configurations)} configurations have an error below the uncertainty "
            "of the reference, which is reported instead"
        )
    if unknown := sum(configuration.error is None for configuration in configurations):
        yield (
            f"{unknown} of {len(configurations)} configurations have runs without "
            f"{report.error.name}"
        )


def _report_notes(
    report: TradeoffReport, runs: StoredRuns, chosen: EvaluatedConfiguration | None, short: int
) -> Iterator[str]:
    yield from _measurement_notes(report)
    if "tied" in runs.solref_rules:
        yield "solref follows the timestep, so that each timestep simulates a different contact"
    if report.chaotic and report.error.against == "trajectory":
        yield (
            "the motion is chaotic, so that distances between trajectories mean little; sweep with "
            "`accuracy: {error: invariants}`"
        )
    if clamped := sum(configuration.solref_clamped for configuration in report.configurations):
        yield (
            f"{clamped} of {len(report.configurations)} configurations set a time constant below "
            "two timesteps; refsafe raises it, so that they simulate a softer contact"
        )
    elsewhere = [one.ends_elsewhere for one in report.configurations if one.ends_elsewhere]
    if elsewhere:
        yield (
            f"{len(elsewhere)} of {len(report.configurations)} configurations end elsewhere than "
            f"the most accurate one of the same model, such as {elsewhere[0]}: not recommended"
        )
    if chosen is not None and chosen.summary.solref_clamped:
        yield "the recommended configuration is one of these"
    if not report.tolerances:
        yield "no tolerances: the recommended runs only have no failure label; see --tolerance"
    if short:
        yield f"{short} configurations lack some scenario or seed, and are not feasible"
    if report.insensitive_knobs:
        yield f"these knobs change no error by more than 1 %: {', '.join(report.insensitive_knobs)}"
    for name, value in (chosen.values if chosen else {}).items():
        values = (
            setting for setting in runs.knobs[name].values if isinstance(setting, int | float)
        )
        numbers = sorted(setting for setting in values if not isinstance(setting, bool))
        if len(numbers) > 2 and value in (numbers[0], numbers[-1]):
            end = "smallest" if value == numbers[0] else "largest"
            text = setting_text(value, report.units.get(name, ""))
            yield f"{name} {text} is the {end} value of the sweep"


@dataclass(frozen=True)
class ToleranceTable:
    """The c configurations of n runs without their tolerances."""

    configuration: NDArray[np.integer]  # (n,) the configuration of each run
    # Metric to (c,) value that tolerances bound: its largest magnitude over a configuration's runs;
    # NaN if a run has no value.
    worst: Mapping[str, Floats]
    # (c,) whether a configuration is feasible without tolerances.
    otherwise_feasible: NDArray[np.bool_]


def tolerance_table(store: Store, report: TradeoffReport, names: Sequence[str]) -> ToleranceTable:
    """Return the table for evaluating other tolerances of these metrics."""
    groups, columns = group_runs(read_runs(store, ())), store.columns
    count = len(groups.starts)
    kind = np.min_scalar_type(count)
    configuration = np.empty(len(groups.order), kind)
    configuration[groups.order] = np.repeat(np.arange(count, dtype=kind), groups.counts)

    def worst(name: str) -> Floats:
        names = {name, ESTIMATES.get(name, name)} & {*columns.schema.names}
        numbers = StoredNumbers(columns, names)
        return np.maximum.reduceat(bounded_magnitudes(numbers, groups.order, name), groups.starts)

    is_sound = [
        summary.time is not None and summary.outcomes.labels.keys() <= {STABLE}
        for summary in report.configurations
    ]
    return ToleranceTable(
        configuration=configuration,
        worst={name: worst(name) for name in names},
        otherwise_feasible=np.array(is_sound) & (groups.cases == groups.every),
    )
