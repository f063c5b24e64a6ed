"""The whole answer: what accuracy costs in time, and which configuration to use."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from contactlab.schema import (
    Blocker,
    FrontPoint,
    NextStep,
    Recommendation,
    Setting,
    TradeoffReport,
)
from contactlab.store import Store
from contactlab.tradeoff.configuration_lines import mjcf_lines
from contactlab.tradeoff.configurations import (
    Evaluated,
    ResolvedCriteria,
    StoredRuns,
    evaluate,
    idle_knobs,
    is_chaotic,
    read_runs,
    typical,
)
from contactlab.tradeoff.convergence import methods
from contactlab.tradeoff.criteria import Criteria, error_measure, time_measure, tolerances_of
from contactlab.tradeoff.pareto import (
    SAFE_MARGIN,
    equally_fast,
    feasible_front,
    next_on,
    on_front,
)

_NOTHING = Criteria()


def analyse(store: Store, question: Criteria = _NOTHING) -> TradeoffReport:
    """Weigh the configurations of a store.

    Args:
        store: a finished store.
        question: which error, and tolerances beside those of its sweep.

    Raises:
        SweepFileError: the question names what the store does not have.
        StoreError: the store has no error to weigh.
    """
    tolerances = tolerances_of(store, question)
    error = error_measure(store, question, tolerances)
    weighing = ResolvedCriteria(error, time_measure(store), tolerances)
    runs = read_runs(store, (error.name, weighing.time.name, *tolerances))
    found = evaluate(runs, weighing)
    line = feasible_front(found)
    chosen, safe = equally_fast(found), equally_fast(found, SAFE_MARGIN)
    best, idle = (chosen[0] if chosen else None), idle_knobs(found)
    is_modelling = error.kind != "discretisation"
    identity = store.manifest.sweep
    return TradeoffReport(
        store=str(store.address),
        sweep=identity.name,
        scene=identity.scene,
        knobs=tuple(runs.knobs),
        scenarios=tuple(runs.scenarios),
        idle=tuple(idle),
        cases=max(len(each.group.cases) for each in found),
        error=error,
        time=weighing.time,
        tolerances=tolerances,
        chaotic=is_chaotic(runs),
        configurations=tuple(each.summary for each in found),
        front=tuple(_point(each) for each in line),
        unconstrained_front=tuple(_point(each) for each in on_front(found)),
        methods=tuple(methods(typical(found, idle, best), is_modelling=is_modelling)),
        recommendation=_recommendation(store, runs, chosen),
        robust=_recommendation(store, runs, safe),
        next_step=_next_step(line, best) if best else None,
        blockers=tuple(_blockers(found)),
        notes=tuple(notes(found, runs, weighing, best, idle)),
    )


def _point(each: Evaluated) -> FrontPoint:
    summary = each.summary
    assert summary.time is not None
    assert summary.error is not None
    return FrontPoint(
        configuration=summary.configuration,
        time=summary.time,
        error=summary.error,
        real_time_factor=1 / summary.time,
    )


def _recommendation(
    store: Store, runs: StoredRuns, near: Sequence[Evaluated]
) -> Recommendation | None:
    if not near:
        return None
    chosen, *others = near
    summary, run = chosen.summary, runs.ids[chosen.group.rows[0]]
    assert summary.time is not None
    lines = mjcf_lines(runs.knobs, store.record(run))
    return Recommendation(
        configuration=summary.configuration,
        margins=summary.margins,
        time=summary.time,
        error=summary.error,
        real_time_factor=1 / summary.time,
        equally_fast=tuple(each.summary.configuration for each in others),
        run_id=run,
        mjcf=lines.mjcf,
        other=lines.other,
    )


def _next_step(line: Sequence[Evaluated], chosen: Evaluated) -> NextStep | None:
    after = next_on(line, chosen)
    if after is None:
        return None
    here, there = _point(chosen), _point(after)
    return NextStep(
        configuration=there.configuration,
        time_ratio=there.time / here.time,
        error_ratio=here.error / there.error if there.error else None,
    )


def _blockers(found: Sequence[Evaluated]) -> Iterator[Blocker]:
    """Yield what keeps configurations from being feasible, the most frequent first."""
    missed = Counter(name for each in found for name in each.missed)
    failed = Counter(label for each in found for label in each.failures)
    blockers = [
        *(
            Blocker(name=name, kind="tolerance", configurations=count, best=_best(found, name))
            for name, count in missed.items()
        ),
        *(
            Blocker(name=name, kind="label", configurations=count, best=None)
            for name, count in failed.items()
        ),
    ]
    yield from sorted(blockers, key=lambda each: -each.configurations)


def _best(found: Sequence[Evaluated], name: str) -> float | None:
    worst = (each.summary.worst[name] for each in found)
    return min((value for value in worst if value is not None), default=None)


_NOISY = 0.05


def notes(
    found: Sequence[Evaluated],
    runs: StoredRuns,
    weighing: ResolvedCriteria,
    chosen: Evaluated | None,
    idle: Sequence[str],
) -> Iterator[str]:
    """Yield what looks wrong, or limits what the numbers say."""
    yield from _of_time(weighing)
    yield from _of_error(found, weighing)
    yield from _of_model(found, runs, weighing, chosen)
    if not weighing.tolerances:
        yield "no tolerance is given: the recommendation only has no failure label; see --tolerance"
    most = max(len(each.group.cases) for each in found)
    short = sum(len(each.group.cases) < most for each in found)
    if short:
        yield f"{short} configurations were not run in every scenario and seed: none is feasible"
    if idle:
        yield f"no error changes by more than 1 % with {', '.join(idle)}"
    if chosen is not None:
        yield from _at_edge(chosen, runs)


def _of_time(weighing: ResolvedCriteria) -> Iterator[str]:
    time = weighing.time
    if time.source == "recording":
        yield (
            "times are of the recorded runs, on a busy machine: good to 10 % at best; "
            "sweep with `timing: {rounds: 3}`"
        )
    elif time.spread is not None and time.spread > _NOISY:
        yield (
            f"rounds of the timing pass differ by {time.spread:.0%}, median over minimum: "
            "configurations nearer than that are not told apart"
        )


def _of_error(found: Sequence[Evaluated], weighing: ResolvedCriteria) -> Iterator[str]:
    below = sum(each.summary.below_estimate for each in found)
    if below:
        yield (
            f"{below} of {len(found)} configurations have an error below what the reference "
            "itself may be off by, which stands for it"
        )
    unknown = sum(each.summary.error is None for each in found)
    if unknown:
        yield f"{unknown} of {len(found)} configurations have runs without {weighing.error.name}"


def _of_model(
    found: Sequence[Evaluated],
    runs: StoredRuns,
    weighing: ResolvedCriteria,
    chosen: Evaluated | None,
) -> Iterator[str]:
    if "tied" in runs.solref_rules:
        yield "solref follows the timestep: each timestep simulates another contact"
    if is_chaotic(runs) and weighing.error.against == "trajectory":
        yield (
            "the motion is chaotic: distances of trajectories say little; sweep with "
            "`accuracy: {error: invariants}`"
        )
    clamped = sum(each.summary.solref_clamped for each in found)
    if clamped:
        yield (
            f"{clamped} of {len(found)} configurations ask for a contact faster than two "
            "timesteps; the engine's refsafe softens it, so that these simulate another contact"
        )
    if chosen is not None and chosen.summary.solref_clamped:
        yield "the recommended configuration is one of these"


def _at_edge(chosen: Evaluated, runs: StoredRuns) -> Iterator[str]:
    for name, value in chosen.group.values.items():
        numbers = _numbers(runs.knobs[name])
        if len(numbers) > 2 and value in (numbers[0], numbers[-1]):
            end = "smallest" if value == numbers[0] else "largest"
            yield f"{name} {value:g} is the {end} that was tried"


def _numbers(values: Iterable[Setting]) -> list[float]:
    """Return the different numbers among some values, in order."""
    found = {each for each in values if isinstance(each, int | float)}
    return sorted(each for each in found if not isinstance(each, bool))
