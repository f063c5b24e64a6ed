"""What was run, in a few lines: for the head of a page."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from contactlab.measure import METRICS
from contactlab.report.knob_changes import KnobChange
from contactlab.report.map_cells import label_counts
from contactlab.report.report_columns import RunLabels, with_unit
from contactlab.report.report_data import ReportData
from contactlab.schema import (
    Configuration,
    Recommendation,
    Setting,
    Settings,
    StoreManifest,
    Sweep,
    TradeoffReport,
)
from contactlab.store import Store

MOST_MISSED = 50


class HeaderLine(NamedTuple):
    """One line of the head."""

    name: str
    text: str


class UnexpectedRun(NamedTuple):
    """A run that did not come out as expected."""

    run: str
    label: str
    reason: str


def header_lines(store: Store) -> list[HeaderLine]:
    """Return what was run, by what, where and when."""
    return list(_facts(store.manifest))


def _facts(manifest: StoreManifest) -> Iterator[HeaderLine]:
    sweep, made = manifest.sweep, manifest.provenance
    revision = f", {made.git_revision[:12]}" if made.git_revision else ""
    yield HeaderLine("scene", f"{sweep.scene} ({sweep.scene_hash})")
    yield HeaderLine(
        "runs", f"{manifest.runs:,} of {sweep.runs_asked:,}, {manifest.traces:,} traces"
    )
    yield HeaderLine("engine", f"{sweep.engine.name} {sweep.engine.version}")
    yield HeaderLine("machine", f"{made.host.cpu_model}, {made.host.cores} cores, {made.host.os}")
    yield HeaderLine("written by", f"contactlab {made.contactlab}{revision}, Python {made.python}")
    yield HeaderLine("finished", manifest.finished[:16].replace("T", " ") + " UTC")
    if sweep.overrides:
        yield HeaderLine("overrides", " ".join(sweep.overrides))


def expectation_summary(manifest: StoreManifest) -> tuple[str, str]:
    """Return whether all is as expected (met, unmet or none), and that in words."""
    met, unmet = (manifest.expectations.get(name, 0) for name in ("met", "unmet"))
    if not met + unmet:
        return "none", "nothing was expected of these runs"
    if unmet:
        return "unmet", f"{unmet:,} of {met + unmet:,} runs are not as expected"
    return "met", f"{met:,} of {met:,} runs are as expected"


def expectations(store: Store) -> list[tuple[str, str, str]]:
    """Return what was expected: of which runs, what, and why."""
    sweep = Sweep.model_validate(store.manifest.sweep.resolved)
    found: list[tuple[str, str, str]] = []
    for each in sweep.expect:
        picks = [f"{name} = {value}" for name, value in each.where.settings.items()]
        picks += [each.where.where] if each.where.where else []
        wanted = [" or ".join(each.label)] if each.label else []
        wanted += [_bounds(name, bounds.min, bounds.max) for name, bounds in each.metrics.items()]
        found.append((", ".join(picks) or "all runs", "; ".join(wanted), each.reason or ""))
    return found


def _bounds(name: str, low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{low:g} ≤ {name} ≤ {high:g}"
    return f"{name} ≥ {low:g}" if low is not None else f"{name} ≤ {high:g}"


def unexpected_runs(store: Store) -> list[UnexpectedRun]:
    """Return the first runs that are not as expected."""
    if not store.manifest.expectations.get("unmet", 0):
        return []
    columns = store.columns.to_pydict(["run_id", "label", "expectation_met", "expectation_reason"])
    rows = zip(*columns.values(), strict=True)
    found = (UnexpectedRun(run, label, why or "") for run, label, met, why in rows if met is False)
    return [each for _, each in zip(range(MOST_MISSED), found, strict=False)]


_MOST_ROWS = 24
_MOST_RATIOS = 5


class LabelRow(NamedTuple):
    """One label: how it is drawn, how often it occurs, and what it means."""

    letter: str
    colour: str
    name: str
    runs: int
    share: str
    meaning: str


class TextTable(NamedTuple):
    """A table; `more` rows are left out."""

    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    more: int = 0


class MarginRow(NamedTuple):
    """What is left of one tolerance."""

    name: str
    limit: float
    worst: str
    margin: str


@dataclass(frozen=True)
class RecommendationText:
    """What to use, in words.

    Attributes:
        values: knob and value.
        error: the error, with its unit.
        time: CPU seconds per simulated second, and how many times real time that is.
        margins: of each tolerance.
        mjcf: lines that set it in a model.
        other: knobs that MJCF has no line for.
        robust: the cheapest whose margins are all 1.25, in words.
        step: what the next step of cost buys, in words.
        notes: what to know before trusting it.
        nothing: what keeps every configuration from being feasible; empty where one is.
        command: what prints and writes the same.
    """

    values: list[tuple[str, str]]
    error: str
    time: str
    margins: list[MarginRow]
    mjcf: str
    other: str
    robust: str
    step: str
    notes: tuple[str, ...]
    nothing: list[str]
    command: str


def label_table(outcomes: RunLabels) -> list[LabelRow]:
    """Return how often each label occurs, the worst first."""
    total = max(1, sum(outcomes.counts))
    columns = (outcomes.letters, outcomes.colours, outcomes.names, outcomes.counts)
    return [
        LabelRow(letter, colour, name, count, f"{count / total:.1%}", meaning)
        for letter, colour, name, count, meaning in zip(*columns, outcomes.meanings, strict=True)
    ]


def map_table(gathered: ReportData) -> TextTable | None:
    """Return the default map as a table: the counts of labels in each cell."""
    plane, outcomes = gathered.plane, gathered.outcomes
    if plane is None or plane.shape[0] * plane.shape[1] > 400:
        return None
    counts = label_counts(plane, outcomes)
    corner = f"{plane.y.title} \\ {plane.x.title}" if plane.y else plane.x.title
    rows = [
        (
            plane.y.words[row] if plane.y else "all",
            *(_counted(cell, outcomes.names) for cell in counts[row].tolist()),
        )
        for row in range(counts.shape[0] - 1, -1, -1)
    ]
    return TextTable((corner, *plane.x.words), rows)


def _counted(counts: Sequence[int], names: Sequence[str]) -> str:
    found = [f"{count} {name}" for name, count in zip(names, counts, strict=True) if count]
    return ", ".join(found) or "no run"


def recommendation_text(gathered: ReportData) -> RecommendationText | None:
    """Return what to use; None where there is nothing to weigh."""
    if gathered.weighing is None:
        return None
    report = gathered.weighing.report
    pick = report.recommendation
    varying = varying_knobs(report)
    return RecommendationText(
        values=_values(gathered, pick) if pick else [],
        error=_sized(pick.error, report.error.unit) if pick else "",
        time=_timed(pick) if pick else "",
        margins=_margins(report, pick),
        mjcf="\n".join(pick.mjcf) if pick else "",
        other=_settings_text(pick.other, tuple(pick.other)) if pick and pick.other else "",
        robust=_robust(report, varying),
        step=_step(report, varying),
        notes=report.notes,
        nothing=[] if pick else _blockers(report),
        command=f"contactlab tradeoff {gathered.store.address}",
    )


def _timed(pick: Recommendation) -> str:
    return f"{pick.time:.3g} CPU s per simulated s ({pick.real_time_factor:,.0f} x real time)"


def _values(gathered: ReportData, pick: Recommendation) -> list[tuple[str, str]]:
    titles = {axis.name: axis.title for axis in gathered.axes}
    settings = pick.configuration.items()
    return [(titles.get(name, name), _setting(value)) for name, value in settings]


def varying_knobs(report: TradeoffReport) -> list[str]:
    """Return the knobs that differ between configurations."""
    values = [each.configuration for each in report.configurations]
    return [name for name in report.knobs if len({each[name] for each in values}) > 1]


def _margins(report: TradeoffReport, pick: Recommendation | None) -> list[MarginRow]:
    worst = _worst(report, pick.configuration) if pick else {}
    return [
        MarginRow(name, limit, _number(worst.get(name)), _margin(pick, name))
        for name, limit in report.tolerances.items()
    ]


def _worst(report: TradeoffReport, values: Settings) -> dict[str, float | None]:
    return next(each.worst for each in report.configurations if each.configuration == values)


def _margin(pick: Recommendation | None, name: str) -> str:
    margin = pick.margins.get(name) if pick else None
    return "-" if margin is None else f"x {margin:.3g}"


def _robust(report: TradeoffReport, varying: Sequence[str]) -> str:
    if not report.tolerances or report.recommendation is None:
        return ""
    if report.robust is None:
        return "no configuration keeps a margin of 1.25 to every tolerance"
    if report.robust.run_id == report.recommendation.run_id:
        return "it keeps a margin of 1.25 to every tolerance"
    ratio = report.robust.time / report.recommendation.time
    values = _settings_text(report.robust.configuration, varying)
    return f"a margin of 1.25 to every tolerance costs {ratio:.3g} x the time: {values}"


def _step(report: TradeoffReport, varying: Sequence[str]) -> str:
    after = report.next_step
    if after is None:
        return ""
    gain = "no error" if after.error_ratio is None else f"{after.error_ratio:.3g} x less error"
    values = _settings_text(after.configuration, varying)
    return f"{after.time_ratio:.3g} x the time buys {gain}: {values}"


def _blockers(report: TradeoffReport) -> list[str]:
    return [
        f"{each.kind} {each.name} keeps out {each.configurations} configurations"
        + ("" if each.best is None else f"; the best has {each.best:.3g}")
        for each in report.blockers
    ]


def front_table(gathered: ReportData) -> TextTable | None:
    """Return the configurations on the feasible front, or all of few."""
    if gathered.weighing is None:
        return None
    report = gathered.weighing.report
    varying = varying_knobs(report)
    found = sorted(report.configurations, key=lambda each: (not each.feasible, each.time or 0.0))
    header = (*varying, with_unit(report.error.name, report.error.unit), "CPU s per s", "feasible")
    rows = [_configured(each, varying) for each in found[:_MOST_ROWS]]
    return TextTable(header, rows, max(0, len(found) - _MOST_ROWS))


def _configured(each: Configuration, varying: Sequence[str]) -> tuple[str, ...]:
    why = "yes" if each.feasible else "no: " + "; ".join(each.reasons)
    values = (_setting(each.configuration[name]) for name in varying)
    return (*values, _number(each.error), _number(each.time), why)


def change_table(gathered: ReportData, found: Sequence[KnobChange]) -> TextTable | None:
    """Return what changing one knob does."""
    if not found:
        return None
    names = _compared_names(gathered, found)
    header = ("knob", "from", "to", "pairs", "runs that fail", *(f"{name} x" for name in names))
    rows = [
        (
            each.axis,
            each.before,
            each.after,
            f"{each.pairs:,}",
            f"{each.failed[0]:.0%} → {each.failed[1]:.0%}",
            *(_ratio(each.ratios[name]) for name in names),
        )
        for each in found
    ]
    return TextTable(header, rows)


def _compared_names(gathered: ReportData, found: Sequence[KnobChange]) -> list[str]:
    """Return the quantities that the table has: time, error, tolerances, depth."""
    report = gathered.weighing.report if gathered.weighing else None
    wanted = [report.time.name, report.error.name, *report.tolerances] if report else []
    wanted += ["cost_cpu_per_sim_s"] if report is None else []
    wanted += [each.name for each in METRICS.values() if each.heading and each.kind == "physics"]
    known = [
        name
        for name in dict.fromkeys(wanted)
        if any(each.ratios.get(name) is not None for each in found)
    ]
    return known[:_MOST_RATIOS]


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _settings_text(values: Settings, varying: Sequence[str]) -> str:
    return ", ".join(f"{name} {_setting(values[name])}" for name in varying) or "the sweep's own"


def _setting(value: Setting) -> str:
    if value is None:
        return "the scene's own"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _sized(value: float | None, unit: str) -> str:
    return _number(value) if unit in {"", "1", "any"} else f"{_number(value)} {unit}"
