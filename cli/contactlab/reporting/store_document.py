"""Describes a store: its labels and expectations, and the axis values that fail."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import itemgetter, methodcaller

import numpy as np
from numpy.typing import NDArray

from contactlab.judge.expectations import EXPECTED, expectation_findings
from contactlab.measure import METRICS
from contactlab.mjcf import is_condition, is_setting
from contactlab.printable import shell_word
from contactlab.rendering.amounts import format_amount
from contactlab.rendering.document import (
    Block,
    Code,
    Document,
    Headline,
    Section,
    Sentence,
    document_of,
    table_of,
)
from contactlab.reporting.equal_runs import describe_equal_runs
from contactlab.reporting.finding import write_finding, write_headline
from contactlab.reporting.label_shares import ShareWords, share_words, stable_share
from contactlab.reporting.map_axes import by_importance
from contactlab.reporting.report_columns import (
    GridAxis,
    RunLabels,
    exact_codes,
    read_accepted_overlap,
    read_axes,
    read_run_labels,
)
from contactlab.reporting.start_noise import distance_to_reality
from contactlab.schema.drive import describe_drive, parse_drive
from contactlab.store.finished_store import Store
from contactlab.store.store_files import is_slice, shard_of

_MOST_ROWS = 12
_ID_DIGITS = 8
_CHOOSING = ("refine", "limit", "until", "search", "sample")
_OF_LOOPS = {"seed": "episode", "success": "success", "total_reward": "return"}


def describe_store(store: Store) -> Document:
    """Describe the result of a store: sentences, and the table of the axes that matter most."""
    manifest, columns = store.manifest, store.columns
    axes, labels, share = read_axes(store), read_run_labels(store), share_words(store)
    blocks: list[Block] = [Headline(f"{manifest.sweep.name}: {write_headline(labels)}")]
    blocks += map(Sentence, filter(None, _result_sentences(store, axes, labels, share)))

    if chosen := [*_chosen_runs(store)]:
        blocks += map(Sentence, chosen)
    elif manifest.runs <= _MOST_ROWS:
        # A table of all runs, with the metrics that any of them has.
        rows = store.table.to_pylist()
        headed = [(metric.name, metric.heading) for metric in METRICS.values() if metric.heading]
        shown_names = [name for name, _ in headed if any(map(methodcaller("get", name), rows))]
        headings = [heading for name, heading in headed if name in shown_names]
        column_titles = _OF_LOOPS if "loop" in rows[0] else {"expectation_met": "as expected"}
        of_columns = itemgetter("label", *column_titles, *columns.axis_names, *shown_names)
        cells = [[str(row["run_id"])[:_ID_DIGITS], *of_columns(row)] for row in rows]
        header = ["run", "label", *column_titles.values(), *columns.axis_names, *headings]
        blocks.append(table_of(header, cells, droppable=len(headings)))
    elif axes and labels.failed.any():  # otherwise all values are alike, as the headline says
        blocks += tabulate_axis_values(by_importance(axes, labels), labels, share)

    drives = [
        describe_drive(parse_drive(json.loads(word))) for word in columns.read_codes("drive")[1]
    ]
    blocks.append(Sentence(f"driven by: {'; '.join(dict.fromkeys(drives))}"))
    sweep, runs = manifest.sweep, f"{manifest.runs:,} runs"
    if sweep.whole is not None and is_slice(sweep):
        part = f"shard {shard}" if (shard := shard_of(sweep)) else "a part of the sweep"
        runs = f"{manifest.runs:,} of {sweep.whole.runs:,} runs ({part})"
    path = store.address
    blocks.append(Sentence(f"{runs}, {manifest.traces:,} traces in {path}"))
    look = columns.run_id(int(labels.worst_rows(store, int(labels.codes.min()))[0]))[:_ID_DIGITS]
    closer = f"look closer: contactlab show {shell_word(path)} {look}"
    blocks.append(Code((closer, f"one page: contactlab report {shell_word(path)}"), indent=0))
    return document_of(Section(tuple(blocks), "summary"))


def has_stable_start(axes: Sequence[GridAxis], labels: RunLabels) -> NDArray[np.bool_]:
    """Return (n,) whether other settings of the model make a run with the same start stable."""
    starts = [axis for axis in axes if is_condition(axis.name) or not is_setting(axis.name)]
    codes = exact_codes(starts, len(labels.codes))
    return np.isin(codes, np.unique(codes[~labels.failed]))


def _result_sentences(
    store: Store, axes: Sequence[GridAxis], labels: RunLabels, share: ShareWords
) -> Iterator[str]:
    columns = store.columns
    invalid = np.array([name == "invalid" for name in labels.names], np.bool_)[labels.codes]
    steps = columns.numbers("label_step")
    began = labels.failed & steps.valid & (steps.values <= 1) & ~invalid
    if began.any():
        began &= ~has_stable_start(axes, labels)
    yield stable_share(labels, share)
    if not labels.failed.any():
        # A sweep without a failure still shows how near its runs come to one.
        phrases = list[str]()
        for name, what, unit in (
            ("penetration_max", "contact depth", "mm"),
            ("backward_error", "numerical error", "%"),
        ):
            if name in columns.metric_columns and columns.has_finite(name):
                values = columns.numbers(name).values
                row = int(np.nanargmax(values))
                phrases.append(f"{what} at most {format_amount(float(values[row]), unit)}")
                when = f"{name}_time"
                if when in columns.metric_columns:
                    (stored,) = columns.select_values([when], [row])
                    phrases[-1] += f" at {stored[when]:.3g} s"
                if name == "penetration_max":
                    phrases.append(read_accepted_overlap(columns, row))
        yield "; ".join(filter(None, phrases))
    if invalid.any():
        reasons = columns.read_arrow(["label_reason"])["label_reason"]
        most = Counter(reasons.take(np.flatnonzero(invalid)).to_pylist()).most_common(1)[0][0]
        yield f"{invalid.sum():,} runs are invalid: {most}"
    if began.any():
        code = Counter(labels.codes[began].tolist()).most_common(1)[0][0]
        yield (
            f"{began.sum():,} of {labels.failed.sum():,} failures begin with the first step, most "
            f"as {labels.names[code]}: look at the start (another keyframe or height) before any "
            "setting"
        )

    # The axes explain the failures of the other runs.
    rest = np.flatnonzero(~began)
    others = [replace(axis, codes=axis.codes[rest]) for axis in axes]
    unexplained = replace(labels, codes=labels.codes[rest], masks=labels.masks[rest])
    yield write_finding(others, unexplained, share) if axes and unexplained.failed.any() else ""
    yield from describe_equal_runs(axes, columns)
    yield distance_to_reality(axes, columns)

    yield from (
        finding.message for finding in expectation_findings(store) if finding.name == EXPECTED
    )
    yield from (f"not as expected: {mean}" for mean in store.manifest.unmet_means)
    missing: Counter[str] = Counter()
    for entry in columns.read_arrow(["effects_missed"])[0].value_counts().to_pylist():
        missing.update(dict.fromkeys(json.loads(entry["values"]), entry["counts"]))
    for name, count in missing.most_common():
        yield f"{name} is off, but {count:,} of {columns.runs:,} runs need it"
    if "ungraded_contacts" in columns.schema.names and (
        count := int((columns.numbers("ungraded_contacts").values > 0).sum())
    ):
        yield (
            f"in {count:,} of {columns.runs:,} runs some contacts are not judged, because their "
            "pairs are not monitored: ungraded_contacts has their steps, `pairs` of the scene's "
            "manifest choose pairs"
        )


def _chosen_runs(store: Store) -> Iterator[str]:
    """Yield the results of a sweep that chose its runs by the results of others."""
    if not any(map(store.manifest.sweep.resolved.get, _CHOOSING)):
        return
    # These load the reader of sweep files, which other summaries do not need.
    # ruff: noqa: PLC0415 - as above
    from contactlab.reporting.boundaries import boundary_lines, describe_coverage, find_boundaries
    from contactlab.reporting.chosen_runs import known_shares, share_lines, worst_lines
    from contactlab.reporting.sensitivity import (
        budget_lines,
        find_sensitivities,
        sensitivity_lines,
    )

    if shares := known_shares(store):
        yield from share_lines(*shares)
    yield from worst_lines(store)
    for sensitivity in find_sensitivities(store):
        yield from sensitivity_lines(sensitivity)
    yield from budget_lines(store)
    if boundaries := find_boundaries(store):
        yield describe_coverage(boundaries)
        yield from boundary_lines(boundaries)


def tabulate_axis_values(
    axes: Sequence[GridAxis], labels: RunLabels, share: ShareWords
) -> Iterator[Block]:
    """Yield the numbers of runs by label for each axis value, the most important axes first."""
    rows: list[tuple[object, ...]] = []
    alike: list[str] = []
    for axis in axes:
        if len(rows) + len(axis.ticks) > _MOST_ROWS:
            continue
        first = len(rows)
        for code, tick in enumerate(axis.ticks):
            codes = Counter(labels.codes[axis.codes == code].tolist())
            here = Counter({labels.names[label]: count for label, count in codes.items()})
            # Labels with equal counts are named in the order of the alphabet.
            others = Counter({label: here[label] for label in sorted(here) if label != "stable"})
            most = ", ".join(f"{label} {count}" for label, count in others.most_common(2))
            stable = share(here["stable"], here.total())
            rows.append((axis.title, tick, here.total(), stable, most))
        if len(axis.ticks) > 1 and len({row[2:] for row in rows[first:]}) == 1:
            del rows[first:]
            alike.append(axis.name)
    if rows:
        yield table_of(("axis", "value", "runs", "stable", "other labels"), rows)
    if alike:
        yield Sentence(f"The same counts at each value of {', '.join(alike)}.")
    shown_axes = {
        *alike,
        *(axis.name for axis in axes if any(row[0] == axis.title for row in rows)),
    }
    if other_axes := [axis.name for axis in axes if axis.name not in shown_axes]:
        yield Sentence(f"also swept: {', '.join(other_axes)}")
