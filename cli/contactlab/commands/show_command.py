"""`contactlab show`: the record of one run, or what a store holds."""

import json
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from contactlab.commands.options import StoreArgument
from contactlab.commands.terminal import Format, FormatOption, print_json, print_table

if TYPE_CHECKING:
    from contactlab.plan import Plan
    from contactlab.run import Forecast
    from contactlab.schema import EvidenceRecord, StoreManifest
    from contactlab.store import Address, RunColumns


def show(
    store: StoreArgument,
    run: Annotated[
        str | None, typer.Argument(help="The run's id, or the start of it; the store if left out.")
    ] = None,
    output: FormatOption = Format.text,
) -> None:
    """Show the evidence of a run, or the summary of a store."""
    from contactlab.store import Store

    opened = Store.open(store)
    if run is None:
        print_summary(store, opened.manifest, output)
        return
    record = opened.record(run)
    if output is Format.json:
        print_json(record.model_dump(mode="json"))
    else:
        _print_record(store, record)


def _print_record(store: "Address", record: "EvidenceRecord") -> None:
    typer.echo("\n".join(_identity(store, record)))
    print_table(
        ("label", "first step", "reason"),
        [(entry.label, entry.step, entry.reason) for entry in record.labels],
    )
    measured = {name: value for name, value in record.metrics.items() if value is not None}
    print_table(
        ("metric", "value", "unit"),
        [(name, f"{value:.6g}", record.units[name]) for name, value in measured.items()],
    )
    print_table(
        ("setting", "value", ""),
        [
            (name, _value(value), "swept" if name in record.axes else "")
            for name, value in {**record.settings, **record.axes}.items()
        ],
    )
    print_table(
        ("pair", "condim", "friction", "solref", "solimp", "margin"),
        [
            (
                name,
                pair.condim,
                *map(_value, (pair.friction, pair.solref, pair.solimp)),
                pair.margin,
            )
            for name, pair in record.pairs.items()
        ],
    )


def _identity(store: "Address", record: "EvidenceRecord") -> Iterator[str]:
    yield f"run {record.run_id}: {record.label}"
    yield f"  scene      {record.scene} ({record.scene_hash}), seed {record.seed}"
    yield f"  engine     {record.engine.name} {record.engine.version}"
    yield f"  steps      {record.steps} of {record.steps_asked}, status {record.status}"
    if record.expectation_met is not None:
        missed = f": {record.expectation_reason}" if record.expectation_reason else ""
        yield f"  expected   {'met' if record.expectation_met else 'not met'}{missed}"
    if record.cost is not None:
        yield f"  cost       {record.cost.cpu_per_sim_s:.3g} CPU seconds per simulated second"
    if record.cost is not None and record.cost.latency_used is not None:
        yield f"  latency    {record.cost.latency_used:.1%} of the budget, on average"
    if record.edited_geoms:
        yield f"  edited     {', '.join(record.edited_geoms)}"
    yield f"  trajectory {record.trajectory_hash}"
    if record.trace is not None:
        yield f"  trace      {store / record.trace.file}"
        yield f"  see it     contactlab render {store} {record.run_id} -o run.mcap"
    yield f"  replay     contactlab replay {store} {record.run_id}"


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{each:g}" for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


_MOST_ROWS = 60
_MOST_VALUES = 12
_ID_DIGITS = 8


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
    said = columns.to_pydict(["label", "run_id"])
    flagged = next((place for place, label in enumerate(said["label"]) if label != "stable"), 0)
    typer.echo(f"look closer: contactlab show {path} {_short_id(said['run_id'][flagged])}")


def _print_missed(columns: "RunColumns") -> None:
    """Say which effects were off in runs whose bodies called for them."""
    missed: Counter[str] = Counter()
    for text, count in Counter(columns.to_pydict(["effects_missed"])["effects_missed"]).items():
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
    from contactlab.measure import METRICS

    axes: list[str] = rows[0]["axis_names"]
    headed = [(each.name, each.heading) for each in METRICS.values() if each.heading]
    shown = [name for name, _ in headed if any(row.get(name) for row in rows)]
    headings = [heading for name, heading in headed if name in shown]
    header = [*axes, "label", *headings, "as asked", "run"]
    columns = [*axes, "label", *shown, "expectation_met"]
    print_table(
        header, [[*(row[name] for name in columns), _short_id(row["run_id"])] for row in rows]
    )


def _print_shares(columns: "RunColumns") -> None:
    """Print, for each value of each axis, how many of its runs are stable and what the rest are."""
    lines: list[tuple[object, ...]] = []
    for axis in columns.axis_names:
        said = columns.to_pydict([axis, "label"])
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
