"""Tables of a page, as words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from contactlab.report.cells import label_counts
from contactlab.report.changes import Change
from contactlab.report.gathering import Gathered
from contactlab.report.grid import titled
from contactlab.report.outcomes import Outcomes
from contactlab.schema import Configuration, Recommendation, Setting, Settings, TradeoffReport

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


class Table(NamedTuple):
    """A table; `more` rows are left out."""

    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    more: int = 0


class Margin(NamedTuple):
    """What is left of one tolerance."""

    name: str
    limit: float
    worst: str
    margin: str


@dataclass(frozen=True)
class Advice:
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
    margins: list[Margin]
    mjcf: str
    other: str
    robust: str
    step: str
    notes: tuple[str, ...]
    nothing: list[str]
    command: str


def label_table(outcomes: Outcomes) -> list[LabelRow]:
    """Return how often each label occurs, the worst first."""
    total = max(1, sum(outcomes.counts))
    columns = (outcomes.letters, outcomes.colours, outcomes.names, outcomes.counts)
    return [
        LabelRow(letter, colour, name, count, f"{count / total:.1%}", meaning)
        for letter, colour, name, count, meaning in zip(*columns, outcomes.meanings, strict=True)
    ]


def map_table(gathered: Gathered) -> Table | None:
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
    return Table((corner, *plane.x.words), rows)


def _counted(counts: Sequence[int], names: Sequence[str]) -> str:
    found = [f"{count} {name}" for name, count in zip(names, counts, strict=True) if count]
    return ", ".join(found) or "no run"


def recommended(gathered: Gathered) -> Advice | None:
    """Return what to use; None where there is nothing to weigh."""
    if gathered.weighing is None:
        return None
    report = gathered.weighing.report
    pick = report.recommendation
    varying = varying_knobs(report)
    return Advice(
        values=_values(gathered, pick) if pick else [],
        error=_sized(pick.error, report.error.unit) if pick else "",
        time=_timed(pick) if pick else "",
        margins=_margins(report, pick),
        mjcf="\n".join(pick.mjcf) if pick else "",
        other=_worded(pick.other, tuple(pick.other)) if pick and pick.other else "",
        robust=_robust(report, varying),
        step=_step(report, varying),
        notes=report.notes,
        nothing=[] if pick else _blockers(report),
        command=f"contactlab tradeoff {gathered.store.address}",
    )


def _timed(pick: Recommendation) -> str:
    return f"{pick.time:.3g} CPU s per simulated s ({pick.real_time_factor:,.0f} x real time)"


def _values(gathered: Gathered, pick: Recommendation) -> list[tuple[str, str]]:
    titles = {axis.name: axis.title for axis in gathered.axes}
    settings = pick.configuration.items()
    return [(titles.get(name, name), _setting(value)) for name, value in settings]


def varying_knobs(report: TradeoffReport) -> list[str]:
    """Return the knobs that differ between configurations."""
    values = [each.configuration for each in report.configurations]
    return [name for name in report.knobs if len({each[name] for each in values}) > 1]


def _margins(report: TradeoffReport, pick: Recommendation | None) -> list[Margin]:
    worst = _worst(report, pick.configuration) if pick else {}
    return [
        Margin(name, limit, _number(worst.get(name)), _margin(pick, name))
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
    values = _worded(report.robust.configuration, varying)
    return f"a margin of 1.25 to every tolerance costs {ratio:.3g} x the time: {values}"


def _step(report: TradeoffReport, varying: Sequence[str]) -> str:
    after = report.next_step
    if after is None:
        return ""
    gain = "no error" if after.error_ratio is None else f"{after.error_ratio:.3g} x less error"
    values = _worded(after.configuration, varying)
    return f"{after.time_ratio:.3g} x the time buys {gain}: {values}"


def _blockers(report: TradeoffReport) -> list[str]:
    return [
        f"{each.kind} {each.name} keeps out {each.configurations} configurations"
        + ("" if each.best is None else f"; the best has {each.best:.3g}")
        for each in report.blockers
    ]


def front_table(gathered: Gathered) -> Table | None:
    """Return the configurations on the feasible front, or all of few."""
    if gathered.weighing is None:
        return None
    report = gathered.weighing.report
    varying = varying_knobs(report)
    found = sorted(report.configurations, key=lambda each: (not each.feasible, each.time or 0.0))
    header = (*varying, titled(report.error.name, report.error.unit), "CPU s per s", "feasible")
    rows = [_configured(each, varying) for each in found[:_MOST_ROWS]]
    return Table(header, rows, max(0, len(found) - _MOST_ROWS))


def _configured(each: Configuration, varying: Sequence[str]) -> tuple[str, ...]:
    why = "yes" if each.feasible else "no: " + "; ".join(each.reasons)
    values = (_setting(each.configuration[name]) for name in varying)
    return (*values, _number(each.error), _number(each.time), why)


def change_table(gathered: Gathered, found: Sequence[Change]) -> Table | None:
    """Return what changing one knob does."""
    if not found:
        return None
    names = _told(gathered, found)
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
    return Table(header, rows)


def _told(gathered: Gathered, found: Sequence[Change]) -> list[str]:
    """Return the quantities that the table has: time, error, tolerances, depth."""
    report = gathered.weighing.report if gathered.weighing else None
    wanted = [report.time.name, report.error.name, *report.tolerances] if report else []
    wanted += ["cost_cpu_per_sim_s"] if report is None else []
    wanted += ["penetration_max", "energy_gain", "slip_distance"]
    known = [
        name
        for name in dict.fromkeys(wanted)
        if any(each.ratios.get(name) is not None for each in found)
    ]
    return known[:_MOST_RATIOS]


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _worded(values: Settings, varying: Sequence[str]) -> str:
    return ", ".join(f"{name} {_setting(values[name])}" for name in varying) or "the sweep's own"


def _setting(value: Setting) -> str:
    if value is None:
        return "the scene's own"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _sized(value: float | None, unit: str) -> str:
    return _number(value) if unit in {"", "1", "any"} else f"{_number(value)} {unit}"
