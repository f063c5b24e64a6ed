"""A panel of runs by MuJoCo and by another engine, with checks and a conclusion."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from contactlab.engines import ENGINES
from contactlab.engines.engine import PreparedRuns, SimulationEngine
from contactlab.errors import PolicyError, StoreError
from contactlab.judge.conclusion import exit_code, failed_names
from contactlab.judge.limits import Limit
from contactlab.judge.subjects import NOT_COMPARABLE, SAME, WORSE, Subject
from contactlab.judge.waivers import apply_waivers
from contactlab.judge.wording import out_of, plural
from contactlab.measure import METRICS
from contactlab.mjcf import MODEL_ENGINE
from contactlab.rendering.amounts import format_percent
from contactlab.scene.scene import Scene
from contactlab.schema.comparison import ComparePolicy, MetricRule
from contactlab.schema.evidence import Setting
from contactlab.schema.finding import Finding, RunPair
from contactlab.store.table_layout import axis_cell
from contactlab.studies.parity.panel import Panel, PanelRun
from contactlab.studies.parity.parity_report import ClosedForm, Measured, ParityReport, RunParity
from contactlab.studies.parity.run_cache import ComparedRun, RunCache
from contactlab.studies.parity.run_parity import Comparison, judge_run

Metrics = Mapping[str, float | str]
SUCCESS, PENETRATION, ENERGY = "success", "penetration_mean", "energy"
_STABLE = "stable"
_RULE = MetricRule(rel=0.05, level="gate")  # the gate of common practice
_ORACLE = "oracle_error"


@dataclass(frozen=True)
class ParityRequest:
    """A panel, the judged engine, the changes for it alone, and the policy."""

    panel: Panel
    engine: SimulationEngine
    device: str
    changes: Sequence[str]
    policy: ComparePolicy
    folder: Path | None = None  # stores each finished run, so that the same request can be resumed


def compare_runs(
    request: ParityRequest,
    begin: Callable[[int, int], None],
    report_run: Callable[[RunParity], None],
) -> ParityReport:
    """Compare an engine with MuJoCo in all runs of a panel.

    `begin` gets the number of runs and of those in the cache; `report_run` gets each other run.
    """
    panel, engine, policy = request.panel, request.engine, request.policy
    # Three quantities have standard rules, and the policy has further ones.
    known_names = (SUCCESS, PENETRATION, ENERGY, *METRICS)
    for name in policy.metrics:
        PolicyError.unless_known(
            name, known_names, f"the policy has a rule for '{name}', which is not a metric"
        )
    rules = dict.fromkeys((SUCCESS, PENETRATION, ENERGY), _RULE)
    policy_rules = {
        name: metric.model_dump(exclude_none=True) for name, metric in policy.metrics.items()
    }
    rules |= {name: _RULE.model_copy(update=rule) for name, rule in policy_rules.items()}
    refused = panel.find_refusals(engine.refusal)
    judged_runs = {
        member.run_id: _describe_run(member, verdict="refused", reason=refused[member.run_id])
        for member in panel.runs
        if member.run_id in refused
    }
    versions = engine.name, engine.version, request.device, ENGINES[MODEL_ENGINE].version
    cache = RunCache(request.folder, (*versions, rules))
    keys = {
        member.run_id: cache.key(member.run_id, panel.scene.run_id(member.theirs))
        for member in panel.runs
    }
    cached = cache.find(keys)
    begin(len(panel.runs) - len(judged_runs), len(cached))
    judged_runs |= {run_id: compared.run for run_id, compared in cached.items()}
    closed = [compared.errors for compared in cached.values()]
    for group in panel.group_runs(judged_runs):
        comparison = Comparison.of(
            engine,
            PreparedRuns.of(panel.scene, *[member.ours for member in group]),
            PreparedRuns.of(panel.scene, *[member.theirs for member in group]),
        )
        # A change for the engine alone is a planted mistake: metrics are measured without it.
        metrics = [
            panel.measure_runs(comparison.both[0], rollout) for rollout in comparison.rollouts[:3]
        ]
        for place, member in enumerate(group):
            ours, *_, theirs = values = [side[place] for side in metrics]
            run_parity = _judge_run(member, comparison, place, values, rules)
            compared = ComparedRun(
                run_parity, (_read_number(ours, _ORACLE), _read_number(theirs, _ORACLE))
            )
            cache.add(keys[member.run_id], compared)
            judged_runs[member.run_id] = run_parity
            closed.append(compared.errors)
            report_run(run_parity)
    runs = [judged_runs[member.run_id] for member in panel.runs]
    checks = list(_make_checks(runs, rules))
    checks = apply_waivers(checks, policy.waive, date.today())  # noqa: DTZ011
    verdict_text = _verdict_counts(Counter(run_parity.verdict for run_parity in runs))
    failed, code = failed_names(checks), exit_code(checks)
    if any(check.outcome == "failed" and check.verdict == "not comparable" for check in checks):
        code = StoreError.exit_code
    if code == StoreError.exit_code:
        headline = f"{engine.name} cannot be compared: {verdict_text}"
    elif code:
        fail = "fails" if len(failed) == 1 else "fail"
        headline = f"{engine.name} differs: {plural(len(failed), 'check')} {fail}; {verdict_text}"
    else:
        headline = f"{engine.name} agrees with MuJoCo: {verdict_text}"
    return ParityReport(
        sweep=panel.request.name,
        scene=panel.scene.name,
        engine=engine.name,
        version=engine.version,
        mujoco=ENGINES[MODEL_ENGINE].version,
        device=request.device,
        changes=tuple(request.changes),
        exit_code=code,
        headline=headline,
        verdicts=dict(Counter(run_parity.verdict for run_parity in runs)),
        findings=tuple(checks),
        closed_form=_closed_form(closed, panel.scene),
        runs=tuple(runs),
    )


def _describe_run(member: PanelRun, **rest: Any) -> RunParity:  # noqa: ANN401 - fields of the report
    axes: dict[str, Setting] = {
        name: axis_cell(value) for name, value in member.run.values.items() if name != "engine"
    }
    return RunParity(run_id=member.run_id, axes=axes, seed=member.run.seed, **rest)


def _judge_run(
    member: PanelRun,
    comparison: Comparison,
    place: int,
    metrics: Sequence[Metrics],
    rules: Mapping[str, MetricRule],
) -> RunParity:
    """Return how one run of a group compares."""
    error = comparison.rollouts[2].errors[place] or comparison.rollouts[3].errors[place]
    if error is not None:
        return _describe_run(member, verdict="failed", reason=error)
    verdict, first, numbers = judge_run(comparison, place)
    readings = {name: _measure_quantity(name, rule, metrics) for name, rule in rules.items()}
    if verdict == "ambiguous":
        readings = {
            name: reading.model_copy(update={"above_tolerance": False})
            for name, reading in readings.items()
        }
    labels = str(metrics[0].get("label")), str(metrics[2].get("label"))
    return _describe_run(
        member, verdict=verdict, first_divergence=first, labels=labels, measured=readings, **numbers
    )


def _measure_quantity(name: str, rule: MetricRule, metrics: Sequence[Metrics]) -> Measured:
    """Return a quantity of a run by MuJoCo, of rounded states, and by the engine."""
    ours, rounded, theirs = (_read_number(metric, name) for metric in metrics)
    scale = {SUCCESS: 1.0, ENERGY: _read_number(metrics[0], "energy_range")}.get(name, abs(ours))
    change, noise = abs(theirs - ours), abs(rounded - ours)
    least_change = 1e-6  # of any metric in its own unit: noise about 0
    least = max(least_change, rule.abs or 0.0)
    allowed = Limit(name, "", value=least, relative=rule.rel or 0.0).allow_change(scale)
    allowed += noise if math.isfinite(noise) else 0
    both_lack = not (math.isfinite(ours) or math.isfinite(theirs))
    return Measured(
        mujoco=ours,
        engine=theirs,
        rounded_mujoco=rounded,
        difference=change / scale if scale else change and math.inf,
        above_tolerance=not both_lack and not change <= allowed,
    )


def _read_number(metrics: Metrics, name: str) -> float:
    if name == SUCCESS:
        return float(metrics.get("label") == _STABLE)
    value = metrics.get("energy_end" if name == ENERGY else name, math.nan)
    assert isinstance(value, float)
    return value


_CODES = {"different": WORSE, "failed": NOT_COMPARABLE}


def _make_checks(runs: Sequence[RunParity], rules: Mapping[str, MetricRule]) -> Iterator[Finding]:
    """Yield the checks of a panel: that its runs can be compared, their stages, each quantity."""
    refused = [run for run in runs if run.verdict == "refused"]
    compared = [run for run in runs if run.verdict not in {"refused", "failed"}]
    reasons = ", ".join(dict.fromkeys(run.reason for run in runs if run.reason))
    able = Subject("runs can be simulated", "evidence", "gate" if not compared else "warn")
    if not compared:
        yield able.make_skipped(reasons)
        return
    codes = np.array([WORSE if run in refused else SAME for run in runs], np.int8)
    yield able.make_finding(
        codes, f"{out_of(len(refused), len(runs))} refused: {reasons}" if refused else "all can"
    )
    others = [run for run in runs if run.verdict != "refused"]
    codes = np.array([_CODES.get(other.verdict, SAME) for other in others], np.int8)
    message = _verdict_counts(Counter(other.verdict for other in others))
    yield Subject("stages agree", "runs", "gate").make_finding(
        codes,
        message,
        [
            _run_pair(run, "", str(run.first_divergence))
            for run in others
            if run.verdict == "different"
        ],
    )
    for name, rule in rules.items():
        yield from _quantity_checks(name, rule, compared)


def _quantity_checks(name: str, rule: MetricRule, runs: Sequence[RunParity]) -> Iterator[Finding]:
    """Yield the checks of a quantity: of its mean, and of each run."""
    readings = [(run, run.measured[name]) for run in runs]
    readings = [
        (run, reading)
        for run, reading in readings
        if (reading.mujoco, reading.engine) != (None, None)
    ]
    level, share = rule.level or "gate", rule.rel or 0.0
    mean, worst = (
        Subject(f"{name} {of}", "metrics", level) for of in ("on average", "of each run")
    )
    if not readings:
        yield from (
            subject.make_finding(np.zeros(0, np.int8), "applies to no run")
            for subject in (mean, worst)
        )
        return
    tolerance = f"(tolerance {format_percent(share)} and the effect of rounding)"
    differences = [
        math.inf if reading.difference is None else reading.difference for _, reading in readings
    ]
    average, beyond = fmean(differences), [reading.above_tolerance for _, reading in readings]
    value_pairs = [
        (reading.mujoco, reading.engine)
        for _, reading in readings
        if reading.mujoco is not None and reading.engine is not None
    ]
    means_text = ""
    if value_pairs:
        ours, theirs = (fmean(values) for values in zip(*value_pairs, strict=True))
        means_text = f"{ours:.4g} -> {theirs:.4g}; "
    code = WORSE if average > share and any(beyond) else SAME
    message = f"{means_text}runs differ by {format_percent(average)} {tolerance}"
    yield mean.make_single(code, message, judged_count=len(readings))
    ranked = sorted(
        readings, key=lambda entry: (not entry[1].above_tolerance, -(entry[1].difference or 0))
    )
    pairs = [
        _run_pair(run, reading.mujoco, reading.engine)
        for run, reading in ranked
        if reading.above_tolerance
    ]
    codes = np.where(beyond, WORSE, SAME).astype(np.int8)
    yield worst.make_finding(codes, f"worst {format_percent(max(differences))} {tolerance}", pairs)


def _verdict_counts(verdicts: Mapping[str, int]) -> str:
    return ", ".join(f"{plural(count)} {verdict}" for verdict, count in verdicts.items())


def _run_pair(run: RunParity, ours: float | str | None, theirs: float | str | None) -> RunPair:
    return RunPair(
        baseline_run=run.run_id,
        candidate_run=run.run_id,
        axes=run.axes,
        baseline=ours,
        candidate=theirs,
    )


def _closed_form(errors: Sequence[tuple[float, float]], scene: Scene) -> ClosedForm | None:
    """Return the differences of both engines from the closed form; None without one."""
    finite_errors = [pair for pair in errors if all(map(math.isfinite, pair))]
    manifest = scene.source.manifest
    if not finite_errors or manifest is None or manifest.oracle is None:
        return None
    ours, theirs = (max(map(abs, values)) for values in zip(*finite_errors, strict=True))
    limit = manifest.oracle.tolerance
    off = ("both" if theirs > limit else "mujoco") if ours > limit else None
    return ClosedForm(
        mujoco=ours, engine=theirs, inaccurate=off or ("engine" if theirs > limit else "neither")
    )
