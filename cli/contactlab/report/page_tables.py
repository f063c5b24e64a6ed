"""The text of a page: what was run, tables, and the recommendation in words."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

from contactlab.measure import METRICS
from contactlab.report.knob_changes import KnobChange
from contactlab.report.map_cells import label_counts
from contactlab.report.report_columns import RunLabels, number_with_unit, with_unit
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
from contactlab.tradeoff import SAFE_MARGIN

_MOST_UNEXPECTED = 50
_MOST_CELLS = 400
_MOST_CONFIGURATIONS = 24
_MOST_RATIOS = 5


class HeaderLine(NamedTuple):
    """One line of the page's header."""

    name: str
    text: str


class UnexpectedRun(NamedTuple):
    """A run that did not meet its expectation."""

    run: str
    label: str
    reason: str


class LabelRow(NamedTuple):
    """One label: how it is drawn, how often it occurs, and what it means."""

    letter: str
    colour: str
    name: str
    runs: int
    fraction: str
    meaning: str


class TextTable(NamedTuple):
    """A table; `more` rows are left out."""

    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    more: int = 0


class MarginRow(NamedTuple):
    """A tolerance, the worst run's value, and the margin between them."""

    name: str
    limit: float
    worst: str
    margin: str


@dataclass(frozen=True)
class RecommendationText:
    """The recommendation in words.

    Attributes:
        values: knob and value; empty where no configuration is feasible.
        error: the error with its unit.
        time: CPU seconds per simulated second, and the real-time factor.
        margins: of each tolerance.
        mjcf: lines that set it in a model.
        other: knobs without a line in MJCF.
        robust: the cheapest configuration whose margins are all 1.25.
        step: what the next step of cost buys.
        notes: what to know before trusting it.
        blockers: what keeps every configuration from being feasible; empty where one is.
        command: the command that prints and writes the same.
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
    blockers: list[str]
    command: str


def header_lines(manifest: StoreManifest) -> Iterator[HeaderLine]:
    """Yield what was run, by what, where and when."""
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
    """Return whether expectations are met (met, unmet or none), and that in words."""
    met, unmet = (manifest.expectations.get(name, 0) for name in ("met", "unmet"))
    if not met + unmet:
        return "none", "no expectations defined"
    if unmet:
        return "unmet", f"{unmet:,} of {met + unmet:,} runs are not as expected"
    return "met", f"{met:,} of {met:,} runs are as expected"


def expectations(manifest: StoreManifest) -> list[tuple[str, str, str]]:
    """Return which runs have an expectation, the expectation, and its reason."""
    sweep = Sweep.model_validate(manifest.sweep.resolved)
    rows: list[tuple[str, str, str]] = []
    for each in sweep.expect:
        conditions = [f"{name} = {value}" for name, value in each.where.settings.items()]
        conditions += [each.where.where] if each.where.where else []
        expected = [" or ".join(each.label)] if each.label else []
        expected += [_bounds(name, bounds.min, bounds.max) for name, bounds in each.metrics.items()]
        rows.append((", ".join(conditions) or "all runs", "; ".join(expected), each.reason or ""))
    return rows


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
    runs = (UnexpectedRun(run, label, why or "") for run, label, met, why in rows if met is False)
    return list(islice(runs, _MOST_UNEXPECTED))


def label_table(labels: RunLabels) -> list[LabelRow]:
    """Return how often each label occurs, the worst first."""
    total = max(1, sum(labels.counts))
    columns = (labels.letters, labels.colours, labels.names, labels.counts)
    return [
        LabelRow(letter, colour, name, count, f"{count / total:.1%}", meaning)
        for letter, colour, name, count, meaning in zip(*columns, labels.meanings, strict=True)
    ]


def map_table(data: ReportData) -> TextTable | None:
    """Return the default map as a table of label counts; None where it has too many cells."""
    axes, labels = data.map_axes, data.labels
    if axes is None or axes.size > _MOST_CELLS:
        return None
    counts = label_counts(axes, labels)
    corner = f"{axes.y.title} \\ {axes.x.title}" if axes.y else axes.x.title
    rows = [
        (
            axes.y.ticks[row] if axes.y else "all",
            *(_counts_text(cell, labels.names) for cell in counts[row].tolist()),
        )
        for row in range(counts.shape[0] - 1, -1, -1)
    ]
    return TextTable((corner, *axes.x.ticks), rows)


def _counts_text(counts: Sequence[int], names: Sequence[str]) -> str:
    parts = [f"{count} {name}" for name, count in zip(names, counts, strict=True) if count]
    return ", ".join(parts) or "no run"


def recommendation_text(data: ReportData) -> RecommendationText | None:
    """Return the recommendation in words; None without a trade-off."""
    report = data.tradeoff
    if report is None:
        return None
    chosen = report.recommendation
    varying = _varying_knobs(report)
    return RecommendationText(
        values=_values(data, chosen) if chosen else [],
        error=number_with_unit(_number(chosen.error), report.error.unit) if chosen else "",
        time=_time(chosen) if chosen else "",
        margins=_margins(report, chosen),
        mjcf="\n".join(chosen.mjcf) if chosen else "",
        other=_settings_text(chosen.other, tuple(chosen.other)) if chosen and chosen.other else "",
        robust=_robust(report, varying),
        step=_next_step(report, varying),
        notes=report.notes,
        blockers=[] if chosen else _blockers(report),
        command=f"contactlab tradeoff {data.store.address}",
    )


def _time(chosen: Recommendation) -> str:
    return f"{chosen.time:.3g} CPU s per simulated s ({chosen.real_time_factor:,.0f} x real time)"


def _values(data: ReportData, chosen: Recommendation) -> list[tuple[str, str]]:
    titles = {axis.name: axis.title for axis in data.axes}
    settings = chosen.configuration.items()
    return [(titles.get(name, name), _setting(value)) for name, value in settings]


def _varying_knobs(report: TradeoffReport) -> list[str]:
    """Return the knobs that differ between configurations."""
    values = [each.configuration for each in report.configurations]
    return [name for name in report.knobs if len({each[name] for each in values}) > 1]


def _margins(report: TradeoffReport, chosen: Recommendation | None) -> list[MarginRow]:
    worst = _worst(report, chosen.configuration) if chosen else {}
    return [
        MarginRow(name, limit, _number(worst.get(name)), _margin(chosen, name))
        for name, limit in report.tolerances.items()
    ]


def _worst(report: TradeoffReport, values: Settings) -> dict[str, float | None]:
    return next(each.worst for each in report.configurations if each.configuration == values)


def _margin(chosen: Recommendation | None, name: str) -> str:
    margin = chosen.margins.get(name) if chosen else None
    return "-" if margin is None else f"x {margin:.3g}"


def _robust(report: TradeoffReport, varying: Sequence[str]) -> str:
    if not report.tolerances or report.recommendation is None:
        return ""
    if report.robust is None:
        return f"No configuration keeps a margin of {SAFE_MARGIN} to every tolerance."
    if report.robust.run_id == report.recommendation.run_id:
        return f"It keeps a margin of {SAFE_MARGIN} to every tolerance."
    ratio = report.robust.time / report.recommendation.time
    values = _settings_text(report.robust.configuration, varying)
    return f"A margin of {SAFE_MARGIN} to every tolerance costs {ratio:.3g} x the time: {values}."


def _next_step(report: TradeoffReport, varying: Sequence[str]) -> str:
    after = report.next_step
    if after is None:
        return ""
    gain = "no error" if after.error_ratio is None else f"{after.error_ratio:.3g} x less error"
    values = _settings_text(after.configuration, varying)
    return f"{after.time_ratio:.3g} x the time buys {gain}: {values}."


def _blockers(report: TradeoffReport) -> list[str]:
    return [
        f"{each.kind} {each.name} rules out {each.configurations} configurations"
        + ("" if each.best is None else f"; the best has {each.best:.3g}")
        for each in report.blockers
    ]


def front_table(data: ReportData) -> TextTable | None:
    """Return the first configurations, the feasible before others and the cheapest first."""
    report = data.tradeoff
    if report is None:
        return None
    varying = _varying_knobs(report)
    ordered = sorted(report.configurations, key=lambda each: (not each.feasible, each.time or 0.0))
    header = (*varying, with_unit(report.error.name, report.error.unit), "CPU s per s", "feasible")
    rows = [_configuration_row(each, varying) for each in ordered[:_MOST_CONFIGURATIONS]]
    return TextTable(header, rows, max(0, len(ordered) - _MOST_CONFIGURATIONS))


def _configuration_row(each: Configuration, varying: Sequence[str]) -> tuple[str, ...]:
    feasible = "yes" if each.feasible else "no: " + "; ".join(each.reasons)
    values = (_setting(each.configuration[name]) for name in varying)
    return (*values, _number(each.error), _number(each.time), feasible)


def change_table(data: ReportData, changes: Sequence[KnobChange]) -> TextTable | None:
    """Return what changing one knob does; None without changes."""
    if not changes:
        return None
    names = _compared_names(data, changes)
    header = ("knob", "from", "to", "pairs", "runs that fail", *(f"{name} x" for name in names))
    rows = [
        (
            each.axis,
            each.before,
            each.after,
            f"{each.pairs:,}",
            f"{each.failed[0]:.0%} → {each.failed[1]:.0%}",
            *(_number(each.ratios[name]) for name in names),
        )
        for each in changes
    ]
    return TextTable(header, rows)


def _compared_names(data: ReportData, changes: Sequence[KnobChange]) -> list[str]:
    """Return the first five of: time, error, tolerated metrics, depth, energy gain, slip."""
    report = data.tradeoff
    wanted = [report.time.name, report.error.name, *report.tolerances] if report else []
    wanted += ["cost_cpu_per_sim_s"] if report is None else []
    wanted += [each.name for each in METRICS.values() if each.heading and each.kind == "physics"]
    known = [
        name
        for name in dict.fromkeys(wanted)
        if any(each.ratios.get(name) is not None for each in changes)
    ]
    return known[:_MOST_RATIOS]


def _settings_text(values: Settings, varying: Sequence[str]) -> str:
    return ", ".join(f"{name} {_setting(values[name])}" for name in varying) or "as in the sweep"


def _setting(value: Setting) -> str:
    if value is None:
        return "as in the scene"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
