"""`contactlab show`: the record of a run, or the summary of a store."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, command
from contactlab.command_line.store_summary import (
    format_value,
    summary_csv,
    summary_json,
    summary_text,
)
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo, print_csv, print_json, print_table
from contactlab.errors import StoreError
from contactlab.printable import in_one_line, shell_word

if TYPE_CHECKING:
    from contactlab.schema.evidence import EvidenceRecord
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


def _text(result: "Store | EvidenceRecord", given: Given) -> None:
    from contactlab.store.finished_store import Store

    if isinstance(result, Store):
        summary_text(result, given)
    else:
        _print_record(opt.address_of(given["store"]), result)


def _json(result: "Store | EvidenceRecord", given: Given) -> None:
    from contactlab.store.finished_store import Store

    if isinstance(result, Store):
        summary_json(result, given)
    else:
        print_json(result.model_dump(mode="json"))


def _csv(result: "Store | EvidenceRecord", given: Given) -> None:
    from contactlab.store.finished_store import Store

    if isinstance(result, Store):
        summary_csv(result, given)
    else:
        rows = [(name, x, result.units.get(name)) for name, x in result.metrics.items()]
        print_csv(("metric", "value", "unit"), rows)


@command(
    "read",
    examples=(
        "show results/grasp",
        "show results/grasp 3ead3115",
        "show results/grasp --format csv",
    ),
    formats={"text": _text, "json": _json, "csv": _csv},
)
def show(
    store: opt.StoreArgument,
    run: Annotated[
        str | None, Argument("RUN", "Run id, or its first digits; the whole store by default.")
    ] = None,
) -> "Store | EvidenceRecord":
    """Show the record of a run, or the summary of a store.

    It is returned: the record, or the open store.

    Raises:
        StoreError: there is no such store or run, or it is damaged.
    """
    from contactlab.store.finished_store import Store

    opened = Store.open(opt.address_of(store))
    if run is None:
        opt.mention_damage(opened)
        return opened
    record = opened.record(run)
    if record.trace is not None and not opened.manifest.traces_left_out:
        try:
            opened.trace(record)
        except StoreError as error:
            say(f"warning: {error}")
    return record


def _print_record(store: "Address", record: "EvidenceRecord") -> None:
    from contactlab.reporting.coverage_rows import coverage_rows
    from contactlab.reporting.told_geoms import told_geoms
    from contactlab.store.finished_store import Store

    told = told_geoms(Store.open(store), {0: record})[0]
    echo("\n".join(map(in_one_line, _identity_lines(store, record))))
    labels = [(entry.label, entry.step, told(entry.reason)) for entry in record.labels]
    print_table(("label", "first step", "reason"), labels)
    if record.coverage is not None:
        rows = [tuple(map(told, row)) for row in coverage_rows(record.coverage, record.pairs)]
        print_table(("exercised", "not at all", "share of range or time"), rows)
    measured = {name: value for name, value in record.metrics.items() if value is not None}
    metrics = [(name, f"{value:.6g}", record.units[name]) for name, value in measured.items()]
    print_table(("metric", "value", "unit"), metrics)
    settings = [
        (name, format_value(value), "swept" if name in record.axes else "")
        for name, value in {**record.settings, **record.axes}.items()
    ]
    print_table(("setting", "value", ""), settings)
    pairs = [
        (
            told(name),
            each.condim,
            *map(format_value, (each.friction, each.solref, each.solimp)),
            each.margin,
        )
        for name, each in record.pairs.items()
    ]
    print_table(("pair", "condim", "friction", "solref", "solimp", "margin"), pairs)


def _identity_lines(store: "Address", record: "EvidenceRecord") -> Iterator[str]:
    yield f"run {record.run_id}: {record.label}"
    yield f"  scene      {record.scene} ({record.scene_hash}), seed {record.seed}"
    yield f"  engine     {record.engine.name} {record.engine.version}"
    yield f"  steps      {record.steps} of {record.steps_asked}, status {record.status}"
    if record.expectation_met is not None:
        reason = f": {record.expectation_reason}" if record.expectation_reason else ""
        yield f"  expected   {'met' if record.expectation_met else 'not met'}{reason}"
    if record.cost is not None:
        yield f"  cost       {record.cost.cpu_per_sim_s:.3g} CPU seconds per simulated second"
    if record.cost is not None and record.cost.latency_used is not None:
        yield f"  latency    {record.cost.latency_used:.1%} of the budget, on average"
    if record.edited_geoms:
        yield f"  edited     {', '.join(record.edited_geoms)}"
    yield f"  trajectory {record.trajectory_hash}"
    if record.trace is not None:
        yield f"  trace      {store / record.trace.file}"
        yield f"  see it     contactlab render {shell_word(store)} {record.run_id} -o run.mcap"
    if record.loop is None:
        yield f"  replay     contactlab replay {shell_word(store)} {record.run_id}"
        return
    success = "" if record.success is None else f", {'' if record.success else 'no '}success"
    reward = "" if record.total_reward is None else f", return {record.total_reward:.6g}"
    yield f"  loop       episode {record.seed}{success}{reward}"
    yield f"  unchecked  {record.loop.unchecked}"
