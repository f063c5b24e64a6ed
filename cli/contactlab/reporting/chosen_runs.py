"""Results of sweeps that choose their runs: shares that became known, and the worst runs found."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from contactlab.measure import labels_with
from contactlab.plan.sampled_shares import configuration_of
from contactlab.plan.search import searched_axes
from contactlab.plan.sides import counts_for_share, fields_read_by
from contactlab.rendering.amounts import format_amount, format_percent, format_setting
from contactlab.schema.sweep_schema import Until
from contactlab.shares import anytime_interval
from contactlab.store.finished_store import Store


@dataclass(frozen=True)
class KnownShare:
    """The share of a configuration's runs that count.

    Attributes:
        configuration: the values of the axes that are not drawn.
        good: number of its runs that count.
        runs: number of its runs.
        low, high: the interval of the share, valid at any number of draws.
    """

    configuration: tuple[tuple[str, object], ...]
    good: int
    runs: int
    low: float
    high: float


def known_shares(store: Store) -> tuple[Until, list[KnownShare]] | None:
    """Return the stop condition and the shares of a sweep; None if it ran all of its draws."""
    sweep = store.sweep
    if sweep.until is None:
        return None
    counts = counts_for_share(sweep.until.share, labels_with("required"))
    names, drawn_axes = store.columns.axis_names, sweep.drawn_axes
    runs, good = (
        Counter[tuple[tuple[str, object], ...]](),
        Counter[tuple[tuple[str, object], ...]](),
    )
    columns = [*dict.fromkeys([*names, *fields_read_by(sweep.until.share)])]
    for row in store.columns.read_arrow(columns).to_pylist():
        configuration = configuration_of({name: row[name] for name in names}, drawn_axes)
        runs[configuration] += 1
        good[configuration] += counts(row) is True
    return sweep.until, [
        KnownShare(key, good[key], count, *anytime_interval(good[key], count, sweep.until.sure))
        for key, count in runs.items()
    ]


def share_lines(until: Until, shares: list[KnownShare]) -> Iterator[str]:
    """Yield each share in a line."""
    most_lines = 12
    for share in shares[:most_lines]:
        settings = ", ".join(f"{name} {value}" for name, value in share.configuration)
        good, low, high = (
            format_amount(part, "%", digits=3)
            for part in (share.good / share.runs, share.low, share.high)
        )
        wide = (share.high - share.low) / 2 > until.half_width
        yield (
            f"{until.share}: {good} of {share.runs:,} runs"
            f"{f' of {settings}' if settings else ''}, {low} to {high} with "
            f"{format_percent(until.sure)}, at any number of draws"
            + (f"; +-{format_percent(until.half_width)} would take more draws" if wide else "")
        )
    if len(shares) > most_lines:
        yield f"and {len(shares) - most_lines:,} more configurations"


def worst_lines(store: Store) -> Iterator[str]:
    """Yield the worst of each search in a line; no line for a sweep without `search`."""
    sweep = store.sweep
    if sweep.search is None:
        return
    metric = sweep.search.metric
    axes, columns = searched_axes(sweep), store.columns
    others = [name for name in (*columns.axis_names, "seed") if name not in axes]
    largest, worst_values = sweep.search.maximise, dict[object, float]()
    worst = dict[object, dict[str, object]]()
    trials = dict[object, int]()
    for row in columns.read_arrow([*dict.fromkeys(["run_id", metric, *axes, *others])]).to_pylist():
        key = tuple(row[name] for name in others)
        trials[key] = trials.get(key, 0) + 1
        value = row[metric]
        if value is not None and (
            key not in worst
            or (value > worst_values[key] if largest else value < worst_values[key])
        ):
            worst[key], worst_values[key] = row, value
    if not worst:
        yield f"{metric} could not be measured in any of {columns.runs:,} trials"
    unit = columns.described[metric].unit
    most_lines = 12
    for key, row in [*worst.items()][:most_lines]:
        at = ", ".join(f"{name} {format_setting(row[name], 4)}" for name in axes)
        of = ", ".join(
            f"{name} {format_setting(row[name], 4)}" for name in others if columns.varies(name)
        )
        sought = f"{'largest' if sweep.search.maximise else 'least'} {metric}"
        value = f"{format_setting(row[metric], 4)}{f' {unit}' if unit != '1' else ''}"
        run = str(row["run_id"])[:8]
        of = f" of {of}" if of else ""
        yield f"{sought}{of}: {value} at {at}, run {run}, in {trials[key]:,} trials"
    if len(worst) > most_lines:
        yield f"and {len(worst) - most_lines:,} more searches"
