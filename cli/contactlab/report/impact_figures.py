"""Bounces of a body: how high it comes, and how much of that is left after each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import altair as alt
import numpy as np

from contactlab.contact import (
    LINEAR_VELOCITY,
    STICK,
    Floats,
    damping_ratio,
    restitution_of,
    sticking_speed,
)
from contactlab.report.knob_changes import KnobChange
from contactlab.report.report_columns import GridAxis
from contactlab.report.run_series import decimated, qpos_entries
from contactlab.schema import EvidenceRecord
from contactlab.store import Store
from contactlab.store.mcap import StoredPair, StoredTrace
from contactlab.tradeoff import COLOURS, INK, SHAPES

MOST_RUNS = 6
_MOST_BOUNCING_READ = 200
_LEAST_BOUNCES = 2
# What comes less high than this share of the fall is lost in the contact's own depth.
_SEEN = 0.02


@dataclass(frozen=True)
class BouncingRun:
    """One run that bounces.

    Attributes:
        setting: what tells it from the others.
        time: (P,) [s].
        height: (P,) above where it first touches [m].
        peaks: (B + 1,) greatest height before the first bounce, and after each [m].
        restitution: what its contact is set to.
    """

    setting: str
    time: Floats
    height: Floats
    peaks: Floats
    restitution: float

    @property
    def ratios(self) -> Floats:
        """(B,) height after each bounce over that before; e^2 without loss in flight."""
        return self.peaks[1:] / self.peaks[:-1]


def bouncing_runs(store: Store, axes: Sequence[GridAxis], stable: np.ndarray) -> list[BouncingRun]:
    """Return runs that bounce at least once, one for each value of what tells them apart.

    Args:
        store: the store.
        axes: the axes that differ between its runs.
        stable: (n,) whether a run has no failure label; only these are drawn.
    """
    axis = _most_telling_axis(store, axes, stable)
    found: dict[str, BouncingRun] = {}
    for row in np.flatnonzero(stable)[:_MOST_BOUNCING_READ].tolist():
        setting = f"{axis.name} {axis.words[axis.codes[row]]}" if axis else "the scene's own"
        if setting not in found and len(found) < MOST_RUNS:
            record = store.record(store.columns.identify([row])[0]["run_id"])
            if record.trace is None:
                continue
            one = _bounces(store.trace(record), record, setting)
            if one is not None:
                found[setting] = one
    return list(found.values())


def _most_telling_axis(
    store: Store, axes: Sequence[GridAxis], stable: np.ndarray
) -> GridAxis | None:
    """Return the axis along which the measured restitution of stable runs varies most."""
    if not axes or "restitution_measured" not in store.columns.schema.names:
        return None
    values = store.columns.numbers("restitution_measured").values
    values = np.where(stable, values, np.nan)

    def spread(axis: GridAxis) -> float:
        groups = (
            values[(axis.codes == code) & np.isfinite(values)] for code in range(len(axis.words))
        )
        means = [float(np.median(group)) for group in groups if len(group)]
        return max(means, default=0.0) - min(means, default=0.0)

    return max(axes, key=spread)


def _bounces(trace: StoredTrace, record: EvidenceRecord, setting: str) -> BouncingRun | None:
    heights = [
        each for each in qpos_entries(trace.model_xml, trace.qpos.shape[1]) if each.is_height
    ]
    if not heights or not trace.pairs or not len(trace.pairs[0].steps):
        return None
    pair = trace.pairs[0]
    height = trace.qpos[:, heights[0].place] - trace.qpos[pair.steps[0], heights[0].place]
    peaks = np.array(list(_peaks(height, pair)))
    low = np.flatnonzero(peaks < _SEEN * peaks[0])
    peaks = peaks[: low[0]] if len(low) else peaks
    if len(peaks) < _LEAST_BOUNCES:
        return None
    places = decimated(height)
    solref = record.pairs[pair.name].solref
    return BouncingRun(
        setting,
        trace.time[places],
        height[places],
        peaks,
        float(restitution_of(damping_ratio(solref))),
    )


def _peaks(height: Floats, pair: StoredPair) -> Iterator[float]:
    """Yield the greatest height of each flight that has an end; the last one may be cut short."""
    gaps = np.flatnonzero(np.diff(pair.steps) > 1)
    yield float(height[: pair.steps[0] + 1].max())
    for gap in gaps.tolist():
        yield float(height[pair.steps[gap] : pair.steps[gap + 1] + 1].max())


_MOST_READ = 600
_FEWEST = 3
# Slower than this two bodies rest on each other; it is no impact.
_APPROACH = 0.05


@dataclass(frozen=True)
class FirstImpact:
    """The first impact of a run.

    Attributes:
        engine: what computed it.
        slip: tangential speed before it [m/s].
        bound: the largest one that Coulomb's law stops, mu (1 + e) v_n [m/s].
        sticks: whether the contact stuck at any time in it.
    """

    engine: str
    slip: float
    bound: float
    sticks: bool


def first_impacts(store: Store) -> list[FirstImpact]:
    """Return the first impacts of runs whose traces are kept; none if they are too few.

    There has to be slip in them, since without it friction has nothing to decide.
    """
    found = list(_read_first_impacts(store))
    slipping = [each for each in found if each.slip > 0]
    return found if len(slipping) >= _FEWEST else []


def _read_first_impacts(store: Store) -> Iterator[FirstImpact]:
    if store.manifest.traces_left_out or store.manifest.traces < _FEWEST:
        return
    records = (record for record in store.records() if record.trace is not None)
    for _, record in zip(range(_MOST_READ), records, strict=False):
        for pair in store.trace(record).pairs[:1]:
            yield from _of(pair, record)


def _of(pair: StoredPair, record: EvidenceRecord) -> Iterator[FirstImpact]:
    if not len(pair.points):
        return
    velocity = pair.points[0, LINEAR_VELOCITY]
    normal, slip = abs(float(velocity[0])), float(np.linalg.norm(velocity[1:]))
    contact = record.pairs[pair.name]
    if normal < _APPROACH or contact.condim < 3:
        return
    restitution = restitution_of(damping_ratio(contact.solref))
    bound = float(sticking_speed(normal, restitution, contact.friction[0]))
    # Contacts of the first touch only: another one follows after a flight.
    breaks = np.flatnonzero(np.diff(pair.steps) > 1)
    first = pair.mode[: breaks[0] + 1] if len(breaks) else pair.mode
    yield FirstImpact(str(record.settings["engine"]), slip, bound, bool((first == STICK).any()))


Rows = list[dict[str, Any]]
_ROOM = 3.0


def bounce_panels(found: Sequence[BouncingRun]) -> dict[str, Any]:
    """Return height over time, and the ratio of heights at each bounce against e^2."""
    names = [each.setting for each in found]
    colour = (
        alt.Color("setting:N")
        .scale(domain=names, range=list(COLOURS[: len(names)]))
        .legend(title=None)
    )
    heights: Rows = [
        {"time": time, "height": height, "setting": each.setting}
        for each in found
        for time, height in zip(each.time.tolist(), each.height.tolist(), strict=True)
    ]
    left = (
        _chart("heights", heights)
        .mark_line(strokeWidth=1.4)
        .encode(
            alt.X("time:Q").scale(nice=False).axis(title="time [s]"),
            alt.Y("height:Q").axis(title="height above first contact [m]"),
            colour,
        )
        .properties(width=420, height=260)
    )
    return alt.hconcat(left, _ratios(found, colour), spacing=30).to_dict()


def _ratios(found: Sequence[BouncingRun], colour: alt.Color) -> alt.LayerChart | alt.FacetChart:
    names = [each.setting for each in found]
    ratios: Rows = [
        {"bounce": index + 1, "ratio": ratio, "setting": each.setting}
        for each in found
        for index, ratio in enumerate(each.ratios.tolist())
    ]
    rules: Rows = [{"ratio": each.restitution**2, "setting": each.setting} for each in found]
    y = alt.Y("ratio:Q").scale(zero=True).axis(title="height after a bounce / before")
    shape = alt.Shape("setting:N").scale(domain=names, range=list(SHAPES[: len(names)]))
    points = (
        _chart("ratios", ratios)
        .mark_point(size=55, filled=True, opacity=1)
        .encode(
            alt.X("bounce:Q").axis(title="bounce", tickMinStep=1), y, colour, shape.legend(None)
        )
    )
    lines = _chart("squares", rules).mark_rule(strokeDash=[5, 4], strokeWidth=1.3)
    title = alt.TitleParams("dashed: e² of the contact", fontSize=11, fontWeight="normal")
    return alt.layer(lines.encode(y, colour), points).properties(width=260, height=260, title=title)


def cone_panel(found: Sequence[FirstImpact]) -> dict[str, Any]:
    """Return impacts in velocity space, with the boundary of Coulomb's cone."""
    rows: Rows = [
        {
            "bound": each.bound,
            "slip": each.slip,
            "engine": each.engine,
            "contact": "sticks" if each.sticks else "slides throughout",
        }
        for each in found
    ]
    most = max(each.bound for each in found) * 1.08
    highest = max(each.slip for each in found) * 1.05
    x = alt.X("bound:Q").scale(domain=[0, most], nice=False)
    y = alt.Y("slip:Q").scale(domain=[0, highest], nice=False)
    x = x.axis(title="μ (1 + e) · normal speed before the impact [m/s]")
    y = y.axis(title="tangential speed before the impact [m/s]")
    names = ["sticks", "slides throughout"]
    colour = alt.Color("contact:N").scale(domain=names, range=list(COLOURS[:2])).legend(title=None)
    shape = alt.Shape("contact:N").scale(domain=names, range=["circle", "triangle-up"])
    end = min(most, highest)
    rows += [
        {"bound": value, "slip": value, "line": True, "engine": engine}
        for engine in dict.fromkeys(each.engine for each in found)
        for value in (0.0, end)
    ]
    base = alt.Chart(alt.InlineData(values=rows, name="impacts"))
    points = (
        base.transform_filter("!datum.line")
        .mark_point(size=60, filled=True, opacity=0.75)
        .encode(x, y, colour, shape.legend(title=None))
    )
    line = base.transform_filter("datum.line").mark_line(color=INK, strokeDash=[6, 4])
    chart = alt.layer(line.encode(x, y), points).properties(width=300, height=300)
    title = alt.Header(title="dashed: the cone's boundary; engine", titleFontWeight="normal")
    return chart.facet(column=alt.Column("engine:N").header(title)).to_dict()


def change_panels(found: Sequence[KnobChange], names: Sequence[str]) -> dict[str, Any]:
    """Return bars of how many times more each change costs, and errs."""
    rows: Rows = [
        {
            "change": f"{each.axis}  {each.before} → {each.after}",
            "name": name,
            "ratio": ratio,
            "one": 1.0,
            "text": f"x {ratio:.3g}",
            "align": "left" if ratio >= 1 else "right",
            "dx": 5 if ratio >= 1 else -5,
        }
        for each in found
        for name in names
        if (ratio := each.ratios.get(name)) is not None
    ]
    order = list(dict.fromkeys(row["change"] for row in rows))
    panels = [
        _bars([row for row in rows if row["name"] == name], name, order, is_first=not index)
        for index, name in enumerate(names)
        if any(row["name"] == name for row in rows)
    ]
    return alt.hconcat(*panels, spacing=26).to_dict()


def _bars(
    rows: Rows, name: str, order: list[str], *, is_first: bool
) -> alt.LayerChart | alt.FacetChart:
    sizes = [row["ratio"] for row in rows]
    domain = [min(*sizes, 1.0) / _ROOM, max(*sizes, 1.0) * _ROOM]
    x = alt.X("ratio:Q").scale(type="log", domain=domain, nice=False)
    x = x.axis(title=f"{name}, after / before", format="~g", tickCount=5)
    y = alt.Y("change:N").scale(domain=order).axis(title=None, labelLimit=260, labels=is_first)
    colour = alt.condition("datum.ratio >= 1", alt.value(COLOURS[1]), alt.value(COLOURS[0]))
    data = _chart(f"changes {name}", rows)
    bars = data.mark_bar(height=13).encode(x, y, x2="one:Q", color=colour)
    align, dx = alt.ExprRef("datum.align"), alt.ExprRef("datum.dx")
    words = data.mark_text(fontSize=11, color=INK, align=align, dx=dx)
    words = words.encode(x, y, text="text:N")
    one = data.mark_rule(color=INK).encode(alt.X("one:Q").scale(type="log", domain=domain))
    return alt.layer(bars, one, words).properties(width=240, height={"step": 22})


def _chart(name: str, rows: Rows) -> alt.Chart:
    return alt.Chart(alt.InlineData(values=rows, name=name))
