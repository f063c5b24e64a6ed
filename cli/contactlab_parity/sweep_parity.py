"""A whole panel by MuJoCo and by another engine: its runs, its checks, and what they amount to."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from statistics import fmean
from typing import Any

import numpy as np

from contactlab.comparison.checks import (
    NOT_COMPARABLE,
    SAME,
    WORSE,
    CheckSubject,
    format_percent,
    out_of,
    plural,
)
from contactlab.comparison.policies import apply_acceptances
from contactlab.engines import ENGINES
from contactlab.engines.engine import PreparedRuns, SimulationEngine
from contactlab.errors import ExpectationError, PolicyError, StoreError
from contactlab.measure import METRICS
from contactlab.mjcf import MODEL_ENGINE
from contactlab.run.evidence_record import as_written
from contactlab.scene.scene import Scene
from contactlab.schema.comparison import Check, ComparePolicy, MetricRule, RunPair
from contactlab.schema.evidence import Setting
from contactlab_parity.panel import Panel, PanelRun
from contactlab_parity.parity_report import ClosedForm, Measured, ParityReport, RunParity
from contactlab_parity.run_parity import Comparison, judge

Metrics = Mapping[str, float | str]
SUCCESS, PENETRATION, ENERGY = "success", "penetration_mean", "energy"
_REL = 0.05  # the practice's gate
_STABLE = "stable"
_RULE = MetricRule(rel=_REL, level="gate")
_LEAST = 1e-6  # of any metric in its own unit: about what noise makes of 0
_ORACLE = "oracle_error"


@dataclass(frozen=True)
class ParityRequest:
    """A panel, the engine that is judged, what is changed for it alone, and by what policy."""

    panel: Panel
    engine: SimulationEngine
    device: str
    changes: Sequence[str]
    policy: ComparePolicy


def run(
    request: ParityRequest, begin: Callable[[int], None], done: Callable[[RunParity], None]
) -> ParityReport:
    """Compare an engine with MuJoCo in all runs of a panel, telling how many, then each."""
    panel, engine, policy = request.panel, request.engine, request.policy
    rules = _rules(policy)
    refused = panel.refused(engine.refusal)
    told = {
        each.run_id: _described(each, verdict="refused", reason=refused[each.run_id])
        for each in panel.runs
        if each.run_id in refused
    }
    begin(len(panel.runs) - len(told))
    closed: list[tuple[float, float]] = []
    for group in panel.groups(refused):
        comparison = Comparison.of(
            engine,
            PreparedRuns.of(panel.scene, *[each.ours for each in group]),
            PreparedRuns.of(panel.scene, *[each.theirs for each in group]),
        )
        metrics = _metrics(panel, comparison)
        for place, each in enumerate(group):
            ours, *_, theirs = values = [side[place] for side in metrics]
            told[each.run_id] = _judged(each, comparison, place, values, rules)
            closed.append((_number(ours, _ORACLE), _number(theirs, _ORACLE)))
            done(told[each.run_id])
    runs = [told[each.run_id] for each in panel.runs]
    checks = list(_checks(runs, rules))
    checks = apply_acceptances(checks, policy.accept, date.today())  # noqa: DTZ011
    exit_code, headline = _conclusion(checks, runs, engine.name)
    return ParityReport(
        sweep=panel.request.name,
        scene=panel.scene.name,
        engine=engine.name,
        version=engine.version,
        mujoco=ENGINES[MODEL_ENGINE].version,
        device=request.device,
        changes=tuple(request.changes),
        exit_code=exit_code,
        headline=headline,
        verdicts=dict(Counter(each.verdict for each in runs)),
        checks=tuple(checks),
        closed_form=_closed_form(closed, panel.scene),
        runs=tuple(runs),
    )


def _rules(policy: ComparePolicy) -> dict[str, MetricRule]:
    """Return how each judged quantity is judged: three of the practice, and those of the policy."""
    known = (SUCCESS, PENETRATION, ENERGY, *METRICS)
    for name in policy.metrics:
        PolicyError.unless_known(name, known, f"the policy has a rule for '{name}', which is none")
    rules = dict.fromkeys((SUCCESS, PENETRATION, ENERGY), _RULE)
    given = {name: each.model_dump(exclude_none=True) for name, each in policy.metrics.items()}
    return rules | {name: _RULE.model_copy(update=each) for name, each in given.items()}


def _metrics(panel: Panel, comparison: Comparison) -> Sequence[Sequence[Metrics]]:
    """Return the metrics of each run by MuJoCo, of rounded states, and by the engine."""
    # What is changed for the engine alone is its mistake: it is measured as if it were not.
    return [panel.metrics(comparison.both[0], each) for each in comparison.rollouts[:3]]


def _described(each: PanelRun, **rest: Any) -> RunParity:  # noqa: ANN401 - fields of the report
    axes: dict[str, Setting] = {
        name: as_written(value) for name, value in each.run.values.items() if name != "engine"
    }
    return RunParity(run_id=each.run_id, axes=axes, seed=each.run.seed, **rest)


def _judged(
    each: PanelRun,
    comparison: Comparison,
    place: int,
    metrics: Sequence[Metrics],
    rules: Mapping[str, MetricRule],
) -> RunParity:
    """Return how one run of a group compares."""
    error = comparison.rollouts[2].errors[place] or comparison.rollouts[3].errors[place]
    if error is not None:
        return _described(each, verdict="failed", reason=error)
    verdict, first, numbers = judge(comparison, place)
    measured = {name: _measured(name, rule, metrics) for name, rule in rules.items()}
    if verdict == "ambiguous":
        measured = {
            name: each.model_copy(update={"beyond": False}) for name, each in measured.items()
        }
    labels = str(metrics[0].get("label")), str(metrics[2].get("label"))
    return _described(
        each, verdict=verdict, first=first, labels=labels, measured=measured, **numbers
    )


def _measured(name: str, rule: MetricRule, metrics: Sequence[Metrics]) -> Measured:
    """Return a quantity of a run by MuJoCo, of rounded states, and by the engine."""
    ours, rounded, theirs = (_number(each, name) for each in metrics)
    scale = {SUCCESS: 1.0, ENERGY: _number(metrics[0], "energy_range")}.get(name, abs(ours))
    change, noise = abs(theirs - ours), abs(rounded - ours)
    allowed = max(_LEAST, rule.abs or 0) + (rule.rel or 0) * scale
    allowed += noise if math.isfinite(noise) else 0
    both_lack = not (math.isfinite(ours) or math.isfinite(theirs))
    return Measured(
        mujoco=_finite(ours),
        engine=_finite(theirs),
        rounded=_finite(rounded),
        difference=_finite(change / scale if scale else change and math.inf),
        beyond=not both_lack and not change <= allowed,
    )


def _number(metrics: Metrics, name: str) -> float:
    if name == SUCCESS:
        return float(metrics.get("label") == _STABLE)
    value = metrics.get("energy_end" if name == ENERGY else name, math.nan)
    assert isinstance(value, float)
    return value


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


_CODES = {"different": WORSE, "failed": NOT_COMPARABLE}


def _checks(runs: Sequence[RunParity], rules: Mapping[str, MetricRule]) -> Iterator[Check]:
    """Yield the checks of a panel: that its runs can be compared, their stages, each quantity."""
    refused = [each for each in runs if each.verdict == "refused"]
    compared = [each for each in runs if each.verdict not in {"refused", "failed"}]
    reasons = ", ".join(dict.fromkeys(each.reason for each in runs if each.reason))
    able = CheckSubject("runs can be simulated", "evidence", "gate" if not compared else "warn")
    if not compared:
        yield able.skipped(reasons)
        return
    codes = np.array([WORSE if each in refused else SAME for each in runs], np.int8)
    yield able.check(
        codes, f"{out_of(len(refused), len(runs))} refused: {reasons}" if refused else "all can"
    )
    others = [each for each in runs if each.verdict != "refused"]
    codes = np.array([_CODES.get(each.verdict, SAME) for each in others], np.int8)
    message = _told(Counter(each.verdict for each in others))
    yield CheckSubject("stages agree", "runs", "gate").check(codes, message, _worst(others))
    for name, rule in rules.items():
        yield from _quantity(name, rule, compared)


def _quantity(name: str, rule: MetricRule, runs: Sequence[RunParity]) -> Iterator[Check]:
    """Yield the checks of a quantity: of its mean, and of each run."""
    told = [(run, run.measured[name]) for run in runs]
    told = [(run, each) for run, each in told if (each.mujoco, each.engine) != (None, None)]
    level, share = rule.level or "gate", rule.rel or 0.0
    mean, worst = (
        CheckSubject(f"{name} {of}", "metrics", level) for of in ("on average", "of each run")
    )
    if not told:
        yield from (each.check(np.zeros(0, np.int8), "applies to no run") for each in (mean, worst))
        return
    within = f"(within {format_percent(share)} and what rounding changes)"
    differences = [math.inf if x.difference is None else x.difference for _, x in told]
    average, beyond = fmean(differences), [each.beyond for _, each in told]
    shown = _means([each for _, each in told])
    code = WORSE if average > share and any(beyond) else SAME
    message = f"{shown}runs differ by {format_percent(average)} {within}"
    yield mean.single(code, message, runs=len(told))
    ranked = sorted(told, key=lambda each: (not each[1].beyond, -(each[1].difference or 0)))
    pairs = [_pair(run, each.mujoco, each.engine) for run, each in ranked if each.beyond]
    codes = np.where(beyond, WORSE, SAME).astype(np.int8)
    yield worst.check(codes, f"worst {format_percent(max(differences))} {within}", pairs)


def _means(measured: Sequence[Measured]) -> str:
    """Return the means by both of the runs that both measured."""
    known = [
        (x.mujoco, x.engine) for x in measured if x.mujoco is not None and x.engine is not None
    ]
    if not known:
        return ""
    ours, theirs = (fmean(each) for each in zip(*known, strict=True))
    return f"{ours:.4g} -> {theirs:.4g}; "


def _told(verdicts: Mapping[str, int]) -> str:
    return ", ".join(f"{plural(count)} {verdict}" for verdict, count in verdicts.items())


def _worst(runs: Sequence[RunParity]) -> list[RunPair]:
    return [_pair(each, "", str(each.first)) for each in runs if each.verdict == "different"]


def _pair(run: RunParity, ours: float | str | None, theirs: float | str | None) -> RunPair:
    return RunPair(
        baseline_run=run.run_id,
        candidate_run=run.run_id,
        axes=run.axes,
        baseline=ours,
        candidate=theirs,
    )


def _conclusion(checks: Sequence[Check], runs: Sequence[RunParity], name: str) -> tuple[int, str]:
    """Return the exit code and the headline."""
    counted = _told(Counter(each.verdict for each in runs))
    failed = [each for each in checks if each.outcome == "failed"]
    if any(each.verdict == "not comparable" for each in failed) or any(
        each.is_open for each in checks
    ):
        return StoreError.exit_code, f"{name} cannot be compared: {counted}"
    fail = "fails" if len(failed) == 1 else "fail"
    if failed:
        return (
            ExpectationError.exit_code,
            f"{name} differs: {plural(len(failed), 'check')} {fail}; {counted}",
        )
    return 0, f"{name} does what MuJoCo does: {counted}"


def _closed_form(errors: Sequence[tuple[float, float]], scene: Scene) -> ClosedForm | None:
    """Return how far both are from the scene's closed form; None if it has none."""
    known = [pair for pair in errors if all(map(math.isfinite, pair))]
    manifest = scene.source.manifest
    if not known or manifest is None or manifest.oracle is None:
        return None
    ours, theirs = (max(map(abs, each)) for each in zip(*known, strict=True))
    limit = manifest.oracle.tolerance
    off = ("both" if theirs > limit else "mujoco") if ours > limit else None
    return ClosedForm(
        mujoco=ours, engine=theirs, off=off or ("engine" if theirs > limit else "neither")
    )
