"""The columns of a store that a trade-off is made of, grouped into configurations."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from contactlab.contact import Floats
from contactlab.schema import Role, Setting, Sweep, role
from contactlab.store import Store

# What runs carry beside errors and times, where the sweep asked for it.
BESIDE = ("step_p99", "impacts")
# How far the reference of each error may be off.
ESTIMATES = {
    "error_final": "error_final_estimate",
    "error_mean": "error_mean_estimate",
    "error_peak": "error_estimate",
}
FLAGS = ("chaotic", "solref_clamped")
_RULE = "solref_rule"


@dataclass(frozen=True)
class Runs:
    """The runs of a store, n of them.

    Attributes:
        ids: run ids.
        knobs: axis to its (n) values, of the axes that one may choose.
        scenarios: the same of those that the world chooses.
        seeds: of each run.
        labels: worst label of each run.
        numbers: column to (n,) values, in their units; NaN where there is none.
        solref_rules: whether solref is absolute or tied to the timestep, as far as is known.
    """

    ids: list[str]
    knobs: Mapping[str, Sequence[Setting]]
    scenarios: Mapping[str, Sequence[Setting]]
    seeds: Sequence[int]
    labels: list[str]
    numbers: Mapping[str, Floats]
    solref_rules: tuple[str, ...] = ()


@dataclass(frozen=True)
class Group:
    """The runs of one configuration.

    Attributes:
        values: knob to value.
        rows: places of its runs in `Runs`.
        cases: scenario and seed of each of them.
    """

    values: dict[str, Setting]
    rows: list[int]
    cases: frozenset[tuple[Setting, ...]]


def read_runs(store: Store, names: Iterable[str]) -> Runs:
    """Read the runs of a store.

    Args:
        store: the store.
        names: columns of numbers beside those that every trade-off reads.
    """
    columns = store.columns
    axes = columns.axis_names
    roles = _roles(Sweep.model_validate(store.manifest.sweep.resolved))
    known = {*names, *BESIDE, *ESTIMATES.values(), *FLAGS}
    wanted = [name for name in known if name in columns.schema.names]
    fixed = ["run_id", "seed", "label"]
    values = columns.listed(list(dict.fromkeys((*fixed, *axes))))

    def of(kind: Role) -> dict[str, list[Setting]]:
        return {name: values[name] for name in axes if roles.get(name, "knob") == kind}

    return Runs(
        ids=values["run_id"],
        knobs=of("knob"),
        scenarios=of("scenario"),
        seeds=values["seed"],
        labels=values["label"],
        numbers={name: columns.numbers(name).values for name in wanted},
        solref_rules=columns.words(_RULE).words if _RULE in columns.schema.names else (),
    )


def group(runs: Runs) -> list[Group]:
    """Return the configurations, in the order in which the plan first has them."""
    found: dict[tuple[Setting, ...], list[int]] = {}
    for row, key in enumerate(_rows(runs.knobs, len(runs.ids))):
        found.setdefault(key, []).append(row)
    cases = list(_rows({**runs.scenarios, "seed": runs.seeds}, len(runs.ids)))
    return [
        Group(
            dict(zip(runs.knobs, key, strict=True)),
            rows,
            frozenset(cases[row] for row in rows),
        )
        for key, rows in found.items()
    ]


def is_chaotic(runs: Runs) -> bool:
    """Say whether any run is known to part from a run that starts beside it."""
    return bool((runs.numbers["chaotic"] > 0).any()) if "chaotic" in runs.numbers else False


def _rows(columns: Mapping[str, Sequence[Setting]], count: int) -> Iterable[tuple[Setting, ...]]:
    return zip(*columns.values(), strict=True) if columns else [()] * count


def _roles(sweep: Sweep) -> dict[str, Role]:
    named = [*sweep.axes.items(), *(pair for block in sweep.zip for pair in block.items())]
    return {name: role(axis) for name, axis in named}
