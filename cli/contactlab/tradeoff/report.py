"""The whole answer: what accuracy costs in time, and which configuration to use."""

from collections import Counter
from collections.abc import Iterator, Sequence

from contactlab.schema import (
    Blocker,
    FrontPoint,
    NextStep,
    Recommendation,
    TradeoffReport,
)
from contactlab.store import Store
from contactlab.tradeoff.choice import (
    SAFE_MARGIN,
    equally_fast,
    feasible_front,
    next_on,
    on_front,
)
from contactlab.tradeoff.configurations import Weighed, Weighing, weigh
from contactlab.tradeoff.idle import idle_knobs, typical
from contactlab.tradeoff.methods import methods
from contactlab.tradeoff.mjcf import mjcf_lines
from contactlab.tradeoff.notes import notes
from contactlab.tradeoff.question import Question, error_measure, time_measure, tolerances_of
from contactlab.tradeoff.runs import Runs, is_chaotic, read_runs

_NOTHING = Question()


def tradeoff(store: Store, question: Question = _NOTHING) -> TradeoffReport:
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
    weighing = Weighing(error, time_measure(store), tolerances)
    runs = read_runs(store, (error.name, weighing.time.name, *tolerances))
    found = weigh(runs, weighing)
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


def _point(each: Weighed) -> FrontPoint:
    summary = each.summary
    assert summary.time is not None
    assert summary.error is not None
    return FrontPoint(
        configuration=summary.configuration,
        time=summary.time,
        error=summary.error,
        real_time_factor=1 / summary.time,
    )


def _recommendation(store: Store, runs: Runs, near: Sequence[Weighed]) -> Recommendation | None:
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


def _next_step(line: Sequence[Weighed], chosen: Weighed) -> NextStep | None:
    after = next_on(line, chosen)
    if after is None:
        return None
    here, there = _point(chosen), _point(after)
    return NextStep(
        configuration=there.configuration,
        time_ratio=there.time / here.time,
        error_ratio=here.error / there.error if there.error else None,
    )


def _blockers(found: Sequence[Weighed]) -> Iterator[Blocker]:
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


def _best(found: Sequence[Weighed], name: str) -> float | None:
    worst = (each.summary.worst[name] for each in found)
    return min((value for value in worst if value is not None), default=None)
