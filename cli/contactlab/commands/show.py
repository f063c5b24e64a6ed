"""`contactlab show`: the record of one run, or what a store holds."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.output import Format, FormatOption, print_json, print_table
from contactlab.commands.stores import StoreArgument

if TYPE_CHECKING:
    from contactlab.schema import EvidenceRecord
    from contactlab.store import Address


def show(
    store: StoreArgument,
    run: Annotated[
        str | None, typer.Argument(help="The run's id, or the start of it; the store if left out.")
    ] = None,
    output: FormatOption = Format.text,
) -> None:
    """Show the evidence of a run, or the summary of a store."""
    from contactlab.commands.summary import print_summary
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
