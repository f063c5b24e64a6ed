"""A recommendation in sentences: how robust it is, what more time buys, what rules others out."""

from collections.abc import Iterable

from contactlab.pareto.pareto import SAFE_MARGIN
from contactlab.schema.evidence import Setting
from contactlab.schema.tradeoff_report import Settings, TradeoffReport


def settings_text(values: Settings, names: Iterable[str]) -> str:
    """Return some settings as `timestep 0.001, cone elliptic`."""
    return ", ".join(f"{name} {setting_text(values[name])}" for name in names)


def setting_text(value: Setting) -> str:
    """Return the value of a setting in words."""
    if value is None:
        return "as in the scene"
    return f"{value:g}" if isinstance(value, float) else str(value)


def robust_text(report: TradeoffReport) -> str:
    """Return what a margin to every tolerance costs; empty without tolerances."""
    if not report.tolerances or report.recommendation is None:
        return ""
    if report.robust is None:
        return f"No configuration keeps a margin of {SAFE_MARGIN} to every tolerance."
    if report.robust.run_id == report.recommendation.run_id:
        return f"It keeps a margin of {SAFE_MARGIN} to every tolerance."
    ratio = report.robust.time / report.recommendation.time
    values = settings_text(report.robust.configuration, report.varying) or "as in the sweep"
    return f"A margin of {SAFE_MARGIN} to every tolerance costs {ratio:.3g} x the time: {values}."


def next_step_text(report: TradeoffReport) -> str:
    """Return what more time buys; empty where no feasible configuration is more accurate."""
    after = report.next_step
    if after is None:
        return ""
    gain = "no error" if after.error_ratio is None else f"{after.error_ratio:.3g} x less error"
    values = settings_text(after.configuration, report.varying) or "as in the sweep"
    return f"{after.time_ratio:.3g} x the time buys {gain}: {values}."


def blocker_texts(report: TradeoffReport) -> list[str]:
    """Return what rules out how many configurations, the most frequent first."""
    return [
        f"{each.kind} {each.name} rules out {each.configurations} configurations"
        + ("" if each.best is None else f"; the best has {each.best:.3g}")
        for each in report.blockers
    ]
