"""Describes the record of a run: its label, coverage, metrics, settings and pairs."""

from collections.abc import Iterator

from contactlab.measure import METRICS
from contactlab.printable import shell_word
from contactlab.rendering.amounts import format_percent, format_setting
from contactlab.rendering.document import (
    Block,
    Column,
    Commands,
    Document,
    Facts,
    Headline,
    Row,
    Sentence,
    Table,
    document_of,
    table_of,
)
from contactlab.reporting.coverage_rows import coverage_rows, join_few
from contactlab.reporting.geom_names import load_geom_replacers
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store


def describe_run(store: Store, record: EvidenceRecord) -> Document:
    """Describe a run of a store, the reasons of its label first."""
    name_geoms = load_geom_replacers(store, {0: record})[0]
    labels = [(entry.label, entry.step, name_geoms(entry.reason)) for entry in record.labels]
    reasons = [table_of(("label", "first step", "reason"), labels)] if labels else []
    tables = list[Table]()
    if record.coverage is not None:
        rows = [tuple(map(name_geoms, row)) for row in coverage_rows(record.coverage, record.pairs)]
        tables.append(table_of(("exercised", "not at all", "share of range or time"), rows))
    # By topic: metrics of one topic are often one fact, seen in several ways.
    rows = list[Row]()
    for name, value in record.metrics.items():
        entry = METRICS.get(name)
        topic = entry.function.__module__.rpartition(".")[2] if entry else "plug-ins"
        meaning = entry.definition.partition(". ")[0].rstrip(".") if entry else ""
        if value is not None:
            cells = (name, f"{value:.6g}", record.units[name], meaning)
            rows.append(Row(cells, group=topic.replace("_", " ")))
    heads = Column("metric"), Column("value", "right"), Column("unit")
    tables.append(Table((*heads, Column("meaning", breakable=True)), tuple(rows)))
    settings = [
        (name, format_setting(value), "swept" if name in record.axes else "")
        for name, value in {**record.settings, **record.axes}.items()
    ]
    tables.append(table_of(("setting", "value", ""), settings))
    alike = dict[tuple[str, ...], list[str]]()
    for name, pair in record.pairs.items():
        values = (pair.condim, pair.friction, pair.solref, pair.solimp, pair.margin)
        alike.setdefault(tuple(map(format_setting, values)), []).append(name_geoms(name))
    pairs = [(join_few(names, ", "), *values) for values, names in alike.items()]
    tables.append(table_of(("pairs", "condim", "friction", "solref", "solimp", "margin"), pairs))

    blocks: list[Block] = [Headline(f"run {record.run_id}: {record.label}"), *reasons]
    if steps := record.metrics.get("ungraded_contacts"):
        blocks.append(
            Sentence(
                f"Not judged: contacts outside the {len(record.pairs)} monitored pairs, in "
                f"{steps:.0f} of {record.steps} steps. No label and no axis of contacts concerns "
                "them; `pairs` of the scene's manifest choose others."
            )
        )
    commands = list[tuple[str, str]]()
    stored_run = f"{shell_word(store.address)} {record.run_id}"
    if record.trace is not None:
        commands.append(("see it", f"contactlab render {stored_run} -o run.mcap"))
    if record.loop is None:
        commands.append(("replay", f"contactlab verify {stored_run}"))
    return document_of(
        blocks,
        [Facts((*_run_facts(store, record),))],
        *([table] for table in tables if table.rows),
        [Commands(tuple(commands))],
    )


def _run_facts(store: Store, record: EvidenceRecord) -> Iterator[tuple[str, str]]:
    yield "scene", f"{record.scene} ({record.scene_hash}), seed {record.seed}"
    yield "engine", f"{record.engine.name} {record.engine.version}"
    yield "steps", f"{record.steps} of {record.steps_asked}, status {record.status}"
    if record.expectation_met is not None:
        reason = f": {record.expectation_reason}" if record.expectation_reason else ""
        yield "expected", f"{'met' if record.expectation_met else 'not met'}{reason}"
    if record.cost is not None:
        yield "cost", f"{record.cost.cpu_per_sim_s:.3g} CPU seconds per simulated second"
        if record.cost.latency_used is not None:
            latency_share = format_percent(record.cost.latency_used)
            yield "latency", f"{latency_share} of the budget, on average"
    if record.edited_geoms:
        yield "edited", join_few(record.edited_geoms, ", ")
    yield "trajectory", str(record.trajectory_hash)
    if record.trace is not None:
        yield "trace", str(store.address / record.trace.file)
    if record.loop is not None:
        success = "" if record.success is None else f", {'' if record.success else 'no '}success"
        reward = "" if record.total_reward is None else f", return {record.total_reward:.6g}"
        yield "loop", f"episode {record.seed}{success}{reward}"
        yield "unchecked", str(record.loop.unchecked)
