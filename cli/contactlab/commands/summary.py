"""What a sweep prints when it is done, or before it starts."""

import json
from collections import Counter
from typing import TYPE_CHECKING, Any

import typer

from contactlab.commands.output import Format, print_json, print_table

if TYPE_CHECKING:
    from contactlab.plan import Plan
    from contactlab.run import Forecast
    from contactlab.schema import StoreManifest
    from contactlab.store import Address, RunColumns

_MOST_ROWS = 60
_MOST_VALUES = 12
_ID_DIGITS = 8
# Metrics of the summary, under headings short enough for a terminal.
_SHOWN = {
    "oracle_expected": "expected",
    "oracle_measured": "measured",
    "penetration_max": "depth [m]",
    "energy_gain": "gain",
    "mode_switches": "switches/s",
}


def print_summary(path: "Address", manifest: "StoreManifest", output: Format) -> None:
    """Print what a store holds: its runs if they are few, then counts by label."""
    from contactlab.store import Store

    store = Store.open(path)
    if output is Format.json:
        print_json({"store": str(path), **manifest.model_dump(mode="json", exclude={"sweep"})})
        return
    columns = store.columns
    if manifest.runs <= _MOST_ROWS:
        _print_runs(store.table.to_pylist())
    else:
        _print_shares(columns)
    print_table(("label", "runs"), Counter(manifest.labels).most_common())
    typer.echo(_expectations(manifest))
    _print_missed(columns)
    typer.echo(f"{manifest.runs:,} runs, {manifest.traces:,} traces in {path}")
    said = columns.listed(["label", "run_id"])
    flagged = next((place for place, label in enumerate(said["label"]) if label != "stable"), 0)
    typer.echo(f"look closer: contactlab show {path} {_short_id(said['run_id'][flagged])}")


def _print_missed(columns: "RunColumns") -> None:
    """Say which effects were off in runs whose bodies called for them."""
    missed: Counter[str] = Counter()
    for text, count in Counter(columns.listed(["effects_missed"])["effects_missed"]).items():
        missed.update(dict.fromkeys(json.loads(text), count))
    for name, count in missed.most_common():
        typer.echo(f"{name} is off, and {count:,} of {columns.runs:,} runs called for it")


def print_plan(plan: "Plan", forecast: "Forecast", output: Format) -> None:
    """Print what a sweep would do."""
    axes = [(axis.name, axis.role, axis.count, _range(axis.values)) for axis in plan.axes]
    if output is Format.json:
        keys = ("name", "role", "count", "values")
        listed = [dict(zip(keys, axis, strict=True)) for axis in axes]
        print_json({"axes": listed, "seeds": len(plan.sweep.seed_values), **vars(forecast)})
        return
    print_table(("axis", "role", "values", "range"), axes)
    typer.echo(f"runs   {forecast.runs:,} (seeds {len(plan.sweep.seed_values)})")
    typer.echo(f"steps  {forecast.steps:,}")
    typer.echo(f"time   {_seconds(forecast.seconds[0])} to {_seconds(forecast.seconds[1])}")
    passes = {"accuracy": forecast.accuracy_seconds, "timing": forecast.timing_seconds}
    for name, seconds in passes.items():
        if seconds:
            typer.echo(f"       of it {_seconds(seconds)} for {name}")
    least, most = (size / 1e6 for size in forecast.bytes)
    typer.echo(f"disk   {least:.3g} to {most:.3g} MB of traces")
    for warning in forecast.warnings:
        typer.echo(f"warning: {warning}")


def _print_runs(rows: list[dict[str, Any]]) -> None:
    axes: list[str] = rows[0]["axis_names"]
    shown = [name for name in _SHOWN if any(row[name] for row in rows)]
    header = [*axes, "label", *(_SHOWN[name] for name in shown), "as asked", "run"]
    columns = [*axes, "label", *shown, "expectation_met"]
    print_table(
        header, [[*(row[name] for name in columns), _short_id(row["run_id"])] for row in rows]
    )


def _print_shares(columns: "RunColumns") -> None:
    """Print, for each value of each axis, how many of its runs are stable and what the rest are."""
    lines: list[tuple[object, ...]] = []
    for axis in columns.axis_names:
        said = columns.listed([axis, "label"])
        counts: dict[object, Counter[str]] = {}
        for (value, label), count in Counter(zip(said[axis], said["label"], strict=True)).items():
            counts.setdefault(value, Counter())[label] = count
        if len(counts) <= _MOST_VALUES:
            lines += [_share(axis, value, labels) for value, labels in counts.items()]
    print_table(("axis", "value", "runs", "stable", "most others"), lines)


def _share(axis: str, value: object, labels: Counter[str]) -> tuple[object, ...]:
    others = Counter({label: count for label, count in labels.items() if label != "stable"})
    most = ", ".join(f"{label} {count}" for label, count in others.most_common(2))
    return axis, _short(value), labels.total(), f"{labels['stable'] / labels.total():.0%}", most


def _short_id(run_id: str) -> str:
    return run_id[:_ID_DIGITS]


def _expectations(manifest: "StoreManifest") -> str:
    met, unmet = manifest.expectations.get("met", 0), manifest.expectations.get("unmet", 0)
    if not met + unmet:
        return "nothing was expected of these runs"
    return f"{met:,} of {met + unmet:,} runs are as expected"


def _range(values: tuple[object, ...]) -> str:
    shown = values if len(values) <= 6 else (*values[:2], "...", values[-1])
    return ", ".join(_short(value) for value in shown)


def _short(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(_short(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _seconds(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 120 else f"{seconds / 60:.2g} min"
