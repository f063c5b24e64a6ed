"""The runs with the worst metric that a search found."""

from collections.abc import Iterator

from contactlab.plan.search import searched_axes
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.finished_store import Store

_ID_DIGITS = 8


def worst_lines(store: Store) -> Iterator[str]:
    """Yield the worst of each search in a line; no line for a sweep without `search`."""
    sweep = Sweep.model_validate(store.manifest.sweep.resolved)
    if sweep.search is None:
        return
    metric = sweep.search.metric
    axes, columns = searched_axes(sweep), store.columns
    others = [name for name in (*columns.axis_names, "seed") if name not in axes]
    worst = dict[object, dict[str, object]]()
    trials = dict[object, int]()
    for row in columns.arrow([*dict.fromkeys(["run_id", metric, *axes, *others])]).to_pylist():
        key = tuple(row[name] for name in others)
        trials[key] = trials.get(key, 0) + 1
        if row[metric] is not None and (
            key not in worst or _is_worse(row[metric], worst[key][metric], sweep)
        ):
            worst[key] = row
    if not worst:
        yield f"{metric} could not be measured in any of {columns.runs:,} trials"
    unit = columns.described[metric].unit
    most_lines = 12
    for key, row in [*worst.items()][:most_lines]:
        at = ", ".join(f"{name} {_format_value(row[name])}" for name in axes)
        of = ", ".join(
            f"{name} {_format_value(row[name])}" for name in others if columns.varies(name)
        )
        sought = f"{'largest' if sweep.search.maximise else 'least'} {metric}"
        value = f"{_format_value(row[metric])}{f' {unit}' if unit != '1' else ''}"
        run = str(row["run_id"])[:_ID_DIGITS]
        of = f" of {of}" if of else ""
        yield f"{sought}{of}: {value} at {at}, run {run}, in {trials[key]:,} trials"
    if len(worst) > most_lines:
        yield f"and {len(worst) - most_lines:,} more searches"


def _is_worse(value: float, other: object, sweep: Sweep) -> bool:
    assert sweep.search is not None
    assert isinstance(other, float | int)
    return value > other if sweep.search.maximise else value < other


def _format_value(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
