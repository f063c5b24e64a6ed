"""The summary of a store: its labels, expectations, and the axis values that fail."""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter, methodcaller
from typing import TYPE_CHECKING

from contactlab.command_line.declaration import Given
from contactlab.command_line.terminal import echo, print_csv, print_json, print_table, tell
from contactlab.errors import ContactlabError, ExpectationError, RunFailedError
from contactlab.printable import shell_word

if TYPE_CHECKING:
    from contactlab.reporting.report_columns import GridAxis, RunLabels
    from contactlab.schema.evidence import StoreManifest
    from contactlab.store.finished_store import Store
    from contactlab.writers import Report

_MOST_ROWS_SHOWN = 12
_ID_DIGITS = 8
_CHOOSING = ("refine", "limit", "until", "search", "sample")
_OF_LOOPS = {"seed": "episode", "success": "success", "total_reward": "return"}


def summary_json(store: "Store", given: Given) -> None:
    """Print the manifest of a store."""
    del given
    manifest = store.manifest.model_dump(mode="json", exclude={"sweep"})
    print_json({"store": str(store.address), **manifest})


def unexpected(store: "Store") -> ContactlabError | None:
    """Return the error of a store with lost runs, or runs that are not as its sweep expects."""
    from contactlab.judge.expectations import EXPECTED, MEANS, RUNS, expectation_findings

    failed = {finding.name: finding for finding in expectation_findings(store) if finding.failing}
    if RUNS in failed:
        return RunFailedError(failed[RUNS].message)
    if EXPECTED in failed:
        unmet = failed[EXPECTED].failing
        runs = store.manifest.runs
        return ExpectationError(f"{unmet} of {runs} runs are not as the sweep expects")
    return ExpectationError(failed[MEANS].message) if MEANS in failed else None


def summary_csv(store: "Store", given: Given) -> None:
    """Print the runs of a store: axes, label and metrics."""
    del given
    columns = store.columns
    names = ["run_id", *columns.axis_names, "seed", "label", "expectation_met"]
    values = columns.to_pydict([*dict.fromkeys(names), *columns.measured])
    print_csv([*values], zip(*values.values(), strict=True))


def summary_text(store: "Store", given: Given) -> None:
    """Print the result of a store: sentences, and the table of the axes that matter most."""
    del given
    path, manifest, columns = store.address, store.manifest, store.columns
    from contactlab.reporting.finding import finding, headline
    from contactlab.reporting.label_shares import share_words, stable_share
    from contactlab.reporting.map_axes import by_importance
    from contactlab.reporting.report_columns import read_axes, read_run_labels
    from contactlab.reporting.start_noise import distance_to_reality

    axes, labels, share = read_axes(store), read_run_labels(store), share_words(store)
    tell(f"{manifest.sweep.name}: {headline(labels)}")
    if told := stable_share(labels, share):
        tell(told)
    mixed = bool(labels.failed.any())  # otherwise all values are alike, as the headline says
    found = finding(axes, labels, share) if axes and mixed else ""
    for told in filter(None, (found, distance_to_reality(axes, columns))):
        tell(told)
    for line in _as_expected(store):
        tell(line)
    missing: Counter[str] = Counter()
    for entry in columns.arrow(["effects_missed"])[0].value_counts().to_pylist():
        missing.update(dict.fromkeys(json.loads(entry["values"]), entry["counts"]))
    for name, count in missing.most_common():
        echo(f"{name} is off, but {count:,} of {columns.runs:,} runs need it")
    if chosen := [*_of_chosen_runs(store)]:
        for told in chosen:
            tell(told)
    elif manifest.runs <= _MOST_ROWS_SHOWN:
        from contactlab.measure import METRICS

        rows = store.table.to_pylist()
        headed = [(metric.name, metric.heading) for metric in METRICS.values() if metric.heading]
        shown = [name for name, _ in headed if any(map(methodcaller("get", name), rows))]
        headings = [heading for name, heading in headed if name in shown]
        said = _OF_LOOPS if "loop" in rows[0] else {"expectation_met": "as expected"}
        of_columns = itemgetter("label", *said, *columns.axis_names, *shown)
        cells = [[str(row["run_id"])[:_ID_DIGITS], *of_columns(row)] for row in rows]
        header = ["run", "label", *said.values(), *columns.axis_names, *headings]
        print_table(header, cells, droppable=len(headings))
    elif axes and mixed:
        _print_values(by_importance(axes, labels), labels, share)
    echo(f"{_runs_of(manifest)}, {manifest.traces:,} traces in {path}")
    look = columns.run_id(int(labels.codes.argmin()))[:_ID_DIGITS]
    echo(f"look closer: contactlab show {shell_word(path)} {look}")
    echo(f"one page: contactlab report {shell_word(path)}")


def _runs_of(manifest: "StoreManifest") -> str:
    """Return the number of runs of a store, and of its sweep if it is a part of it."""
    from contactlab.store.store_files import is_slice, shard_of

    sweep, runs = manifest.sweep, f"{manifest.runs:,} runs"
    if sweep.whole is None or not is_slice(sweep):
        return runs
    part = f"shard {shard}" if (shard := shard_of(sweep)) else "a part of the sweep"
    return f"{manifest.runs:,} of {sweep.whole.runs:,} runs ({part})"


def _of_chosen_runs(store: "Store") -> "Iterator[str]":
    """Yield the results of a sweep that chose its runs by the results of others."""
    if not any(map(store.manifest.sweep.resolved.get, _CHOOSING)):
        return
    from contactlab.reporting.boundaries import boundaries, boundary_lines, coverage
    from contactlab.reporting.found_worst import worst_lines
    from contactlab.reporting.known_shares import known_shares, share_lines
    from contactlab.reporting.sensitivity import budget_lines, sensitivities, sensitivity_lines

    if known := known_shares(store):
        yield from share_lines(*known)
    yield from worst_lines(store)
    for sensitivity in sensitivities(store):
        yield from sensitivity_lines(sensitivity)
    yield from budget_lines(store)
    if found := boundaries(store):
        yield coverage(found)
        yield from boundary_lines(found)


def _print_values(
    axes: "Sequence[GridAxis]", labels: "RunLabels", share: "Callable[[int, int], str]"
) -> None:
    """Print the numbers of runs by label for each axis value, the most important axes first."""
    rows: list[tuple[object, ...]] = []
    for axis in axes:
        if len(rows) + len(axis.ticks) <= _MOST_ROWS_SHOWN:
            for code, tick in enumerate(axis.ticks):
                here = Counter(
                    {
                        labels.names[n]: k
                        for n, k in Counter(labels.codes[axis.codes == code].tolist()).items()
                    }
                )
                others = Counter(
                    {label: count for label, count in here.items() if label != "stable"}
                )
                most = ", ".join(f"{label} {count}" for label, count in others.most_common(2))
                stable = share(here["stable"], here.total())
                rows.append((axis.title, tick, here.total(), stable, most))
    print_table(("axis", "value", "runs", "stable", "other labels"), rows)
    if left := [axis.name for axis in axes if not any(row[0] == axis.title for row in rows)]:
        tell(f"also swept: {', '.join(left)}")


def format_value(value: object) -> str:
    """Return the value of a setting or an axis: `0.02 1`, `elliptic`."""
    if isinstance(value, tuple):
        return " ".join(format_value(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def expectations(store: "Store", given: Given) -> "Report":
    """Return the report of the expectations of a sweep."""
    del given
    from contactlab.judge.conclusion import exit_code
    from contactlab.judge.expectations import expectation_findings
    from contactlab.reporting.finding import headline
    from contactlab.reporting.report_columns import read_run_labels
    from contactlab.writers import Report

    findings, name = tuple(expectation_findings(store)), store.manifest.sweep.name
    return Report(
        title=f"contactlab sweep {name}",
        place=(name,),
        headline=f"{name}: {headline(read_run_labels(store))}",
        passed=exit_code(findings) == 0,
        record=store.manifest,
        findings=findings,
        commands=(("look closer", f"contactlab show {shell_word(store.address)}"),),
    )


def _as_expected(store: "Store") -> "Iterator[str]":
    """Yield how far a sweep went as it expects."""
    from contactlab.judge.expectations import EXPECTED, expectation_findings

    for finding in expectation_findings(store):
        if finding.name == EXPECTED:
            yield finding.message
    yield from (f"not as expected: {mean}" for mean in store.manifest.unmet_means)
