"""Engines beside each other on tasks whose closed form is known: error over the cost of a step.

Run: python -m bench.engine_panel [FOLDER [ITEM ...]]

Each file of `sweeps/engines` is a task, run by every engine that is installed, at three steps, into
a store of its own; stores that are complete are read, the rest is run or resumed. Runs that an
engine refuses are left out, with its reason. Written are `panel.md` and `panel.svg`, of each task
error and CPU time of stepping alone, as ratios of one machine.
"""

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import altair as alt
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines import ENGINES
from contactlab.errors import ContactlabError
from contactlab.measure.oracle_error import middle_axis_flip
from contactlab.plan.overrides import Overrides
from contactlab.resources import SWEEPS
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace

ITEMS = sorted((SWEEPS / "engines").glob("*.yaml"))
_ENGINES = ("mujoco", "impulse", "drake", "pinocchio", "bullet", "sapien")
_WORD = {"bounce": "restitution", "slide": "way", "stick": "way that slides", "slope": "way",
         "roll": "acceleration", "spin": "braking", "oblique": "velocity", "billiards": "direction",
         "stack": "load of the lowest", "grasp": "fall", "pendulum": "period",
         "gyroscope": "time of a turn"}  # fmt: skip
_LEAST = 1e-9  # error that the picture shows


@dataclass(frozen=True)
class Point:
    """One run of an engine."""

    item: str
    engine: str
    version: str
    step: float  # [s]
    error: float | None
    energy: float | None  # gained or lost over what it had
    depth: float | None  # [m]
    cost: float | None  # CPU time of stepping for a second of the task [s]
    label: str


def period(angles: Floats, step: float) -> float:
    """Return the error of the period of a rod that swings by .2 at first, of (N + 1,) angles.

    Expected is that of a physical pendulum over Gauss' mean of 1 and the cosine of half of .2.
    """
    crossings = np.flatnonzero((angles[:-1] > 0) & (angles[1:] <= 0))
    exact = crossings + angles[crossings] / (angles[crossings] - angles[crossings + 1])
    inertia, centre = rod(1.0, 0.02)
    small = 2 * math.pi * math.sqrt(inertia / (9.81 * centre))
    one, other = 1.0, math.cos(0.1)
    for _ in range(8):
        one, other = (one + other) / 2, math.sqrt(one * other)
    return float(np.diff(exact).mean()) * step * one / small - 1


def rod(length: float, radius: float) -> tuple[float, float]:
    """Return inertia about its end and centre of a capsule of 1 kg, of a length between centres."""
    tube, ends = math.pi * radius**2 * length, 4 / 3 * math.pi * radius**3
    tube, ends = tube / (tube + ends), ends / (tube + ends)
    across = tube * (length**2 / 12 + radius**2 / 4)
    across += ends * (2 / 5 * radius**2 + length**2 / 4 + 3 / 8 * length * radius)
    return across + (length / 2) ** 2, length / 2


def _swung(trace: StoredTrace, record: EvidenceRecord) -> float:
    del record
    return period(trace.qpos[:, 0], float(trace.time[1] - trace.time[0]))


def _turned(trace: StoredTrace, record: EvidenceRecord) -> float:
    """Return the error of the time at which a free box turns over."""
    del record
    start = trace.qvel[:1, 3:6]
    edges = np.array([0.1, 0.2, 0.3])
    inertia = ((edges**2).sum() - edges**2)[None] / 3
    expected = float(middle_axis_flip(inertia, start)[0])
    about = trace.qvel[:, 4]
    turns = np.flatnonzero(np.sign(about[:-1]) != np.sign(about[1:]))
    if not len(turns):
        return math.inf
    at = int(turns[0])
    share = about[at] / (about[at] - about[at + 1])
    return float(trace.time[at] + share * (trace.time[1] - trace.time[0])) / expected - 1


def _fallen(trace: StoredTrace, record: EvidenceRecord) -> float:
    """Return how far a held block falls [m]."""
    del record
    return float(trace.qpos[0, 4] - trace.qpos[-1, 4])


def _borne(trace: StoredTrace, record: EvidenceRecord) -> float:
    """Return the error of the load of a stack's lowest contact; of one that has fallen, all."""
    if trace.qpos[-1, -5] < 0.9 * trace.qpos[0, -5]:
        return math.inf
    return float(record.metrics["weights_borne"] or 0) / 10 - 1


_MEASURES: dict[str, Callable[[StoredTrace, EvidenceRecord], float]] = {
    "pendulum": _swung, "gyroscope": _turned, "grasp": _fallen, "stack": _borne,
}  # fmt: skip


def _points(folder: Path, items: Sequence[Path], left_out: list[str]) -> Iterator[Point]:
    for path in items:
        for name in _ENGINES:
            try:
                store = _store(path, name, folder / path.stem / name)
            except ContactlabError as error:
                left_out.append(f"{path.stem}, {name}: {' '.join(str(error).split())}")
                continue
            for record in store.records():
                yield _point(path.stem, name, store, record)


def _store(path: Path, engine: str, folder: Path) -> Store:
    """Return the store of a task by an engine, which is run if it is not complete."""
    if not (folder / "manifest.json").is_file():
        request = read_request(
            path, path.stem, folder, folder=path.parent, workers=0,
            overrides=Overrides(assign=[f"engine={engine}"]),
        )  # fmt: skip
        run_sweep(request, lambda _total, _done: None, lambda _finished: None)
    return Store.open(folder)


def _point(item: str, engine: str, store: Store, record: EvidenceRecord) -> Point:
    step = float(str(record.axes["timestep"]))
    if record.status != "ok":
        return Point(item, engine, record.engine.version, step, None, None, None, None,
                     record.status_reason or "")  # fmt: skip
    trace, metrics = store.trace(record), record.metrics
    measure = _MEASURES.get(item)
    error = measure(trace, record) if measure else metrics["oracle_error"]
    seconds = record.steps * step
    cost = record.cost.cpu_s if record.cost else None
    return Point(
        item, engine, record.engine.version, step,
        None if error is None else abs(float(error)), metrics.get("energy_drift"),
        metrics.get("penetration_max"), None if cost is None else cost / seconds, record.label,
    )  # fmt: skip


def _table(points: Sequence[Point]) -> list[str]:
    rows = ["| task | engine | step, ms | error | deepest, mm | CPU of a step, us | label |",
            "|---|---|---|---|---|---|---|"]  # fmt: skip
    for point in points:
        shown = (
            f"{_WORD.get(point.item, '')}, {point.item}", point.engine, f"{1e3 * point.step:g}",
            _number(point.error), _number(point.depth and 1e3 * point.depth),
            _number(point.cost and 1e6 * point.cost * point.step), point.label,
        )  # fmt: skip
        rows.append(f"| {' | '.join(shown)} |")
    return rows


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"


def _picture(points: Sequence[Point]) -> alt.FacetChart:
    """Return errors over the cost of a second, a panel a task."""
    rows = [
        {"task": point.item, "engine": point.engine, "cost": point.cost,
         "error": max(point.error, _LEAST)}
        for point in points
        if point.cost and point.error is not None and math.isfinite(point.error)
    ]  # fmt: skip
    few = alt.Axis(format="~e", tickCount=4, grid=False, labelOverlap=True)
    chart = alt.Chart(alt.Data(values=rows)).mark_line(point=True).encode(
        x=alt.X("cost:Q", scale=alt.Scale(type="log"), title="CPU s for 1 s", axis=few),
        y=alt.Y("error:Q", scale=alt.Scale(type="log"), title="error", axis=few),
        color=alt.Color("engine:N", sort=list(_ENGINES)),
    )  # fmt: skip
    return (
        chart.properties(width=190, height=130)
        .facet(alt.Facet("task:N", title=None), columns=4)
        .resolve_scale(x="independent", y="independent")
    )


def best(points: Sequence[Point]) -> list[str]:
    """Return for each task the engine with the least error, and MuJoCo's beside it."""
    told: list[str] = []
    for item in dict.fromkeys(point.item for point in points):
        least: dict[str, float] = {}
        for point in points:
            if point.item == item and point.error is not None:
                least[point.engine] = min(point.error, least.get(point.engine, math.inf))
        first = min(least, key=lambda name: least[name])
        if first != "mujoco" and "mujoco" in least:
            ours = _number(least["mujoco"])
            told.append(f"- {item}: {first} {_number(least[first])}, mujoco {ours}")
    return told


def main() -> None:
    """Run what is missing, and write the table and the picture."""
    folder, *wanted = sys.argv[1:] or ["results/engines"]
    items = [path for path in ITEMS if not wanted or path.stem in wanted]
    left_out: list[str] = []
    points = list(_points(Path(folder), items, left_out))
    names = {point.engine: point.version for point in points}
    versions = ", ".join(f"{name} {version}" for name, version in names.items())
    absent = [name for name in _ENGINES if not ENGINES[name].version]
    lines = [versions, "", *_table(points), "", "MuJoCo is not the best:", *best(points), ""]
    lines += [f"- {why}" for why in left_out] + [f"- {name} is not installed" for name in absent]
    (Path(folder) / "panel.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    _picture(points).save(str(Path(folder) / "panel.svg"))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
