"""A lock: outcomes of a sweep, frozen in a small file with one line for each group of runs.

The runs of a group have the same axis values; they differ by seed, or are a loop's episodes.
"""

import hashlib
import io
import json
import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from contactlab.comparison.pairing import engine_of
from contactlab.errors import SweepFileError
from contactlab.judge.policies import effective_rule, kind_of
from contactlab.measure import METRICS
from contactlab.numerical_tolerance import ROUNDING
from contactlab.plan.sweep_file import read_yaml_as
from contactlab.schema.comparison import ComparePolicy
from contactlab.store.atomic_files import atomic_write, write_errors
from contactlab.store.finished_store import Store
from contactlab.store.table_layout import REAL, Column
from contactlab.studies.lock.lock_model import Group, Lock, key_of, round_value

_OF_LOOPS = (
    Column("total_reward", REAL, "", "sum of the rewards of an episode", "none"),
    Column("steps", REAL, "1", "steps that were made", "none"),
)
_COUNTED = {"success": "success", "expectation_met": "as expected"}
_HEAD = """\
# What `contactlab lock` froze; `contactlab lock {source} --check` fails where it changed.
# A line for each group of runs: how many had each outcome; and of each metric the mean, the
# standard deviation if it is not 0, and the number of values where not all runs have one.
"""


def lock_of(store: Store, metrics: Sequence[str], *, chaotic: bool = False) -> Lock:
    """Return the outcomes of a store, by these metrics; runs on a knife edge are left out."""
    column_names = store.columns.schema.names
    always = ["seed", "labels", "trajectory_hash", "initial_qpos", "initial_qvel"]
    rows = store.columns.to_pydict(
        [*always, *(column for column in _COUNTED if column in column_names), *metrics]
    )
    grouped = group_members(store).values()
    groups = [_lock_group(axes, rows, metrics, own) for axes, own in grouped]
    starts = [rows["initial_qpos"], rows["initial_qvel"]]
    if not is_recorded(store) and (is_loop(store) or _differ_besides(starts, rows, grouped)):
        starts.append(rows["seed"])
    identity = store.manifest.sweep
    versions = identity.metric_versions
    return Lock(
        sweep=identity.name,
        scene_hash=identity.scene_hash,
        engine=engine_of(store),
        seeds=tuple(sorted(set(rows["seed"]))),
        starts=_digest_text(starts),
        chaotic=chaotic,
        metric_versions={name: versions[name] for name in metrics if name in versions},
        groups=tuple(groups),
    )


def group_members(store: Store) -> dict[str, tuple[dict[str, Any], list[int]]]:
    """Return the values of the axes that differ, and the rows of each group, by its key."""
    columns, members = store.columns, dict[str, tuple[dict[str, Any], list[int]]]()
    names = [
        name
        for name in columns.axis_names
        if len(set(map(str, columns.to_pydict([name])[name]))) > 1
    ]
    axes = columns.read_arrow(names).to_pylist() if names else [dict[str, Any]()] * columns.runs
    for row in np.flatnonzero(columns.numbers("knife_edge").values != 1).tolist():
        own_axes = {
            name: round_value(value) for name, value in axes[row].items() if value is not None
        }
        members.setdefault(key_of(own_axes), (own_axes, []))[1].append(row)
    return members


def is_loop(store: Store) -> bool:
    """Return whether a store has the episodes of a loop, or of an environment."""
    return "loop" in store.columns.schema.names


def is_recorded(store: Store) -> bool:
    """Return whether a store has recorded episodes, where seeds are only their numbers."""
    return is_loop(store) and not store.manifest.sweep.source


def _differ_besides(
    starts: Sequence[Sequence[object]],
    rows: Mapping[str, list[Any]],
    groups: Iterable[tuple[object, list[int]]],
) -> bool:
    """Return whether seeds decide more than starts, as the noise of a drive."""
    for _, own in groups:
        first: dict[str, object] = {}
        for row in own:
            start, moved = str([column[row] for column in starts]), rows["trajectory_hash"][row]
            if first.setdefault(start, moved) != moved:
                return True
    return False


def metric_columns(store: Store) -> dict[str, Column]:
    """Return the values that may be locked, by name: all results of the physics."""
    return {
        **{
            name: column
            for name, column in store.columns.metric_columns.items()
            if _is_physical(name)
        },
        **({loop.name: loop for loop in _OF_LOOPS} if is_loop(store) else {}),
    }


def gated_metrics(store: Store, policy: ComparePolicy) -> list[str]:
    """Return the metrics that a policy gates, where a run has a value."""
    stored_metrics = metric_columns(store).items()
    gated = [
        name for name, metric in stored_metrics if effective_rule(metric, policy).level == "gate"
    ]
    return [name for name in gated if store.columns.numbers(name).valid.any()]


def write_lock(path: Path, lock: Lock, source: str) -> None:
    """Write the lock of a sweep or a store in one step; an OutputError says that it cannot be."""
    data = lock.model_dump(mode="json")
    groups = "".join(f"- {_write_yaml(group, in_one_line=True)}" for group in data.pop("groups"))
    text = f"{_HEAD.format(source=source)}{_write_yaml(data)}groups:\n{groups}"
    with write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_lock(path: Path) -> Lock:
    """Read a lock; a SweepFileError lists its mistakes, or says that it is missing."""
    if not path.is_file():
        raise SweepFileError(f"there is no lock {path}; write it by `contactlab lock` first")
    return read_yaml_as(path, Lock)


def _is_physical(name: str) -> bool:
    """Return whether a metric is neither a time nor a count of work, and explains no other."""
    physical = METRICS[name].kind == "physics" if name in METRICS else not name.startswith("work_")
    return physical and kind_of(name) == "metrics"


def _lock_group(
    axes: dict[str, Any], rows: Mapping[str, list[Any]], metrics: Sequence[str], own: list[int]
) -> Group:
    outcomes = Counter(label for row in own for label in rows["labels"][row])
    outcome_flags = {
        word: [rows[name][row] for row in own] for name, word in _COUNTED.items() if name in rows
    }
    outcomes.update(
        {
            word: sum(map(bool, flags))
            for word, flags in outcome_flags.items()
            if set(flags) != {None}
        }
    )
    values_by_metric = {name: _measure_runs([rows[name][row] for row in own]) for name in metrics}
    return Group(
        at=axes,
        runs=len(own),
        trajectories=_digest_text([rows["trajectory_hash"][row] for row in own]),
        outcomes=dict(outcomes),
        metrics={name: values for name, values in values_by_metric.items() if values},
    )


def _measure_runs(values: Sequence[float | None]) -> tuple[float, ...]:
    """Return mean, spread and number of values, as far as they say something."""
    finite = [value for value in values if value is not None and math.isfinite(value)]
    if not finite:
        return ()
    spread = statistics.stdev(finite) if len(finite) > 1 else 0.0
    digits = 7  # of a number that is written; compare accepts changes of 1 %
    rounded_numbers = [
        float(f"{number:.{digits}g}") for number in (statistics.fmean(finite), spread)
    ]
    return (
        (*rounded_numbers, len(finite))
        if len(finite) < len(values)
        else tuple(rounded_numbers[: 1 + (spread > ROUNDING * abs(rounded_numbers[0]))])
    )


def _digest_text(data: object) -> str:
    return hashlib.sha256(json.dumps(data).encode()).hexdigest()[:16]


def _write_yaml(data: Mapping[str, object], *, in_one_line: bool = False) -> str:
    yaml, text = YAML(typ="safe", pure=True), io.StringIO()
    yaml.default_flow_style = in_one_line or None
    yaml.width = 1 << 30
    yaml.sort_base_mapping_type_on_output = False  # pyright: ignore[reportAttributeAccessIssue]
    yaml.dump(data, text)
    return text.getvalue()
