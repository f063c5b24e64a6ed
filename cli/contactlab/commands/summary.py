"""What a sweep prints when it is done, or before it starts."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from contactlab.commands.output import Format, print_json, print_table

if TYPE_CHECKING:
    from contactlab.pipeline import Forecast
    from contactlab.plan import Plan
    from contactlab.schema import StoreManifest

_MOST_ROWS = 60
_SHOWN = ("oracle_expected", "oracle_measured", "penetration_max", "energy_gain", "mode_switches")


def print_summary(path: Path, manifest: "StoreManifest", output: Format) -> None:
    """Print what a store holds: its runs if they are few, then counts by label."""
    from contactlab.evidence import Store

    store = Store.open(path)
    if output is Format.json:
        print_json({"store": str(path), **manifest.model_dump(mode="json", exclude={"sweep"})})
        return
    rows: list[dict[str, Any]] = store.table.to_pylist() if manifest.runs <= _MOST_ROWS else []
    if rows:
        _print_runs(rows)
    print_table(("label", "runs"), Counter(manifest.labels).most_common())
    typer.echo(_expectations(manifest))
    typer.echo(f"{manifest.runs} runs, {manifest.traces} traces in {path}")
    if rows:
        worst = max(rows, key=lambda row: (row["label"] != "stable", row["index"] == 0))
        typer.echo(f"look closer: contactlab show {path} {worst['run_id']}")


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
    least, most = (size / 1e6 for size in forecast.bytes)
    typer.echo(f"disk   {least:.3g} to {most:.3g} MB of traces")
    for warning in forecast.warnings:
        typer.echo(f"warning: {warning}")


def _print_runs(rows: list[dict[str, Any]]) -> None:
    axes: list[str] = rows[0]["axis_names"]
    shown = [name for name in _SHOWN if any(row[name] is not None for row in rows)]
    header = [*axes, "label", *shown, "as expected", "run"]
    columns = [*axes, "label", *shown, "expectation_met", "run_id"]
    print_table(header, [[row[name] for name in columns] for row in rows])


def _expectations(manifest: "StoreManifest") -> str:
    met, unmet = manifest.expectations.get("met", 0), manifest.expectations.get("unmet", 0)
    if not met + unmet:
        return "nothing was expected of these runs"
    return f"{met} of {met + unmet} runs are as expected"


def _range(values: tuple[object, ...]) -> str:
    shown = values if len(values) <= 6 else (*values[:2], "...", values[-1])
    return ", ".join(_short(value) for value in shown)


def _short(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(_short(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _seconds(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 120 else f"{seconds / 60:.2g} min"
