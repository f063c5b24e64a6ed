"""Commands that read a store: `show` it, `verify` that it is sound, `replay` a run of it."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_csv, print_json, print_table, say, tell
from contactlab.errors import ExpectationError, StoreError
from contactlab.printable import in_one_line

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contactlab.reporting.report_columns import GridAxis, RunLabels
    from contactlab.run.stored_runs import ReplayResult
    from contactlab.schema.evidence import EvidenceRecord, StoreManifest
    from contactlab.store.finished_store import Store
    from contactlab.store.run_columns import RunColumns

_MOST_ROWS = 12
_ID_DIGITS = 8
_OF_LOOPS = {"seed": "episode", "success": "success", "total_reward": "return"}


def show(
    store: opt.Address = opt.STORE,
    run: str | None = typer.Argument(
        None, help="Run id, or its first digits; the whole store by default."
    ),
    output: opt.TableFormat = opt.FORMAT,
) -> None:
    """Show the record of a run, or the summary of a store."""
    from contactlab.store.finished_store import Store

    opened = Store.open(store)
    if run is None:
        opt.mention_damage(opened)
        print_summary(opened, output)
        return
    record = opened.record(run)
    if record.trace is not None and not opened.manifest.traces_left_out:
        try:
            opened.trace(record)
        except StoreError as error:
            say(f"warning: {error}")
    if output == "json":
        print_json(record.model_dump(mode="json"))
    elif output == "csv":
        print_csv(
            ("metric", "value", "unit"),
            [(n, v, record.units.get(n)) for n, v in record.metrics.items()],
        )
    else:
        _print_record(store, record)


def _print_record(store: opt.Address, record: "EvidenceRecord") -> None:
    from contactlab.reporting.coverage_rows import coverage_rows

    echo("\n".join(map(in_one_line, _identity_lines(store, record))))
    labels = [(entry.label, entry.step, entry.reason) for entry in record.labels]
    print_table(("label", "first step", "reason"), labels)
    if record.coverage is not None:
        rows = coverage_rows(record.coverage, record.pairs)
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
            name,
            each.condim,
            *map(format_value, (each.friction, each.solref, each.solimp)),
            each.margin,
        )
        for name, each in record.pairs.items()
    ]
    print_table(("pair", "condim", "friction", "solref", "solimp", "margin"), pairs)


def _identity_lines(store: opt.Address, record: "EvidenceRecord") -> Iterator[str]:
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
        yield f"  see it     contactlab render {store} {record.run_id} -o run.mcap"
    if record.loop is None:
        yield f"  replay     contactlab replay {store} {record.run_id}"
        return
    success = "" if record.success is None else f", {'' if record.success else 'no '}success"
    reward = "" if record.total_reward is None else f", return {record.total_reward:.6g}"
    yield f"  loop       episode {record.seed}{success}{reward}"
    yield f"  unchecked  {record.loop.unchecked}"


def _as_expected(manifest: "StoreManifest") -> "Iterator[str]":
    """Yield how far a sweep went as it expects."""
    met, unmet = (manifest.expectations.get(name, 0) for name in ("met", "unmet"))
    rest = f"; {manifest.runs - met - unmet:,} have no expectation"
    as_expected = f"{met:,} of {met + unmet:,} runs are as expected"
    as_expected += rest if met + unmet < manifest.runs else ""
    yield as_expected if met + unmet else "no expectations defined"
    yield from (f"not as expected: {each}" for each in manifest.unmet_means)


def print_summary(store: "Store", output: opt.TableFormat) -> None:
    """Print the summary of a store: what it found, whether that is as expected, where runs fail."""
    path, manifest = store.address, store.manifest
    if output == "json":
        print_json({"store": str(path), **manifest.model_dump(mode="json", exclude={"sweep"})})
        return
    columns = store.columns
    if output == "csv":
        names = ["run_id", *columns.axis_names, "seed", "label", "expectation_met"]
        values = columns.to_pydict([*dict.fromkeys(names), *columns.measured])
        print_csv([*values], zip(*values.values(), strict=True))
        return
    from contactlab.reporting.finding import finding, headline
    from contactlab.reporting.map_axes import by_importance
    from contactlab.reporting.report_columns import read_axes, read_run_labels
    from contactlab.reporting.start_noise import distance_to_reality

    axes, labels = read_axes(store), read_run_labels(store)
    tell(f"{manifest.sweep.name}: {headline(labels)}")
    found = finding(axes, labels) if axes else ""
    for told in filter(None, (found, distance_to_reality(axes, columns))):
        tell(told)
    for each in _as_expected(manifest):
        tell(each)
    _print_missing_effects(columns)
    if manifest.runs <= _MOST_ROWS:
        _print_runs(columns.axis_names, store.table.to_pylist())
    elif axes:
        _print_values(by_importance(axes, labels), labels)
    echo(f"{manifest.runs:,} runs, {manifest.traces:,} traces in {path}")
    look = str(columns.run_ids[int(labels.codes.argmin())])[:_ID_DIGITS]
    echo(f"look closer: contactlab show {path} {look}")


def _print_missing_effects(columns: "RunColumns") -> None:
    """Print which effects were off in runs that needed them."""
    missing: Counter[str] = Counter()
    for each in columns.arrow(["effects_missed"])[0].value_counts().to_pylist():
        missing.update(dict.fromkeys(json.loads(each["values"]), each["counts"]))
    for name, count in missing.most_common():
        echo(f"{name} is off, but {count:,} of {columns.runs:,} runs need it")


def _print_runs(axes: Sequence[str], rows: Sequence[Mapping[str, object]]) -> None:
    from contactlab.measure import METRICS

    headed = [(each.name, each.heading) for each in METRICS.values() if each.heading]
    shown = [name for name, _ in headed if any(row.get(name) for row in rows)]
    headings = [heading for name, heading in headed if name in shown]
    said = _OF_LOOPS if "loop" in rows[0] else {"expectation_met": "as expected"}
    columns = ["label", *said, *axes, *shown]
    cells = [[str(row["run_id"])[:_ID_DIGITS], *(row[name] for name in columns)] for row in rows]
    header = ["run", "label", *said.values(), *axes, *headings]
    print_table(header, cells, droppable=len(headings))


def _print_values(axes: "Sequence[GridAxis]", labels: "RunLabels") -> None:
    """Print for values of axes, those that decide most first, how many runs have which label."""
    rows: list[tuple[object, ...]] = []
    for axis in axes:
        if len(rows) + len(axis.ticks) <= _MOST_ROWS:
            for code, tick in enumerate(axis.ticks):
                here = Counter(
                    {
                        labels.names[n]: k
                        for n, k in Counter(labels.codes[axis.codes == code].tolist()).items()
                    }
                )
                rows.append(_value_row(axis.title, tick, here))
    print_table(("axis", "value", "runs", "stable", "other labels"), rows)
    if left := [axis.name for axis in axes if not any(row[0] == axis.title for row in rows)]:
        tell(f"also swept: {', '.join(left)}")


def _value_row(axis: str, value: str, labels: Counter[str]) -> tuple[object, ...]:
    others = Counter({label: count for label, count in labels.items() if label != "stable"})
    most = ", ".join(f"{label} {count}" for label, count in others.most_common(2))
    return axis, value, labels.total(), f"{labels['stable'] / labels.total():.0%}", most


def format_value(value: object) -> str:
    """Return the value of a setting or an axis: `0.02 1`, `elliptic`."""
    if isinstance(value, tuple):
        return " ".join(format_value(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def verify(
    store: opt.Address = opt.STORE,
    simulate: int = typer.Option(
        0, min=0, metavar="N", help="Simulate N runs again, drawn at random."
    ),
    allow_code: bool = opt.ALLOW_CODE,
    output: opt.Format = opt.FORMAT,
) -> None:
    """Check every file of a store against its hash, and recompute what its content gives."""
    from contactlab.run.recomputed_runs import (
        recomputed_problems,
        simulated_problems,
        unplanned,
        unresolved,
    )
    from contactlab.store.finished_store import Store
    from contactlab.store.verify_store import MOST_PROBLEMS, unverified
    from contactlab.store.verify_store import verify as find_problems

    problems = find_problems(store)
    opened = Store.unchecked(store)
    manifest, left = opened.manifest, unverified(opened)
    if plugins := "; ".join(map(str, manifest.sweep.plugins)):
        say(
            f"{store} was written with plug-ins that are not loaded: {plugins}; "
            "their values are shown as stored"
        )
    left += filter(None, (unresolved(opened), unplanned(opened)))
    if not problems and unresolved(opened) is None:
        # What is damaged need not be run, nor compiled.
        problems = list(islice(recomputed_problems(opened), MOST_PROBLEMS))
        again = simulated_problems(opened, simulate, allow_code=allow_code)
        problems += again if simulate and not problems else ()
    if output == "json":
        found = {"sound": not problems, "problems": problems, "unverified": left}
        print_json({**found, "runs": manifest.runs, "digest": opened.digest})
    elif not problems:
        left_out = " left out" if manifest.traces_left_out else ""
        echo(f"{store} is sound: {manifest.runs} runs, {manifest.traces} traces{left_out}")
        for each in left:
            echo(f"not verified: {each}")
        echo(f"digest {opened.digest}")
    else:
        for problem in problems:
            echo(in_one_line(problem))
    if problems:
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        raise StoreError(f"{store} is not sound: {count}")


def replay(
    store: opt.Address = opt.STORE,
    run: str = opt.RUN,
    *,
    view: bool = opt.flag("--view", "Open it in MuJoCo's viewer instead."),
    plugin: list[Path] | None = opt.PLUGIN,
    allow_code: bool = opt.ALLOW_CODE,
    output: opt.Format = opt.FORMAT,
) -> None:
    """Simulate a stored run again and check that every state is bitwise equal."""
    from contactlab.run.stored_runs import prepare_replay
    from contactlab.run.stored_runs import replay as run_again
    from contactlab.store.finished_store import Store

    opt.load_plugins(plugin)
    opened = Store.open(store)
    if view:
        from contactlab.plugins import extensions

        start = prepare_replay(opened, run)
        extensions("viewer")["window"].load()(start.prepared.model, start.runs.starts)
        return
    result = run_again(opened, run, allow_code=allow_code)
    if output == "json":
        print_json(asdict(result))
    else:
        for line in _replay_lines(result):
            echo(line)
    if not result.equal:
        raise ExpectationError("the trajectory is not the stored one")


def _replay_lines(result: "ReplayResult") -> Iterator[str]:
    if result.equal:
        yield f"run {result.run_id}: bitwise equal ({result.hash})"
        return
    if result.stored_hash is None:
        yield f"run {result.run_id}: no trajectory was stored"
        return
    yield f"run {result.run_id}: differs"
    yield f"  stored {result.stored_hash}"
    yield f"  now    {result.hash}"
    if result.step is not None:
        amount = "" if result.difference is None else f" by {result.difference:.3g}"
        yield f"  first after step {result.step}{amount}"
    yield f"  stored with {result.stored_engine}"
