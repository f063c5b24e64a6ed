"""The figure of a front names every point, spans them, and adapts to dark pages."""

import math
from itertools import combinations
from typing import Any

import pytest

from contactlab.charts import adaptive_svg, apply_theme, with_dark_colours
from contactlab.schema.task import Task
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.tune_report import (
    Candidate,
    FrontPoint,
    ParameterUncertainty,
    Target,
    TuneReport,
)
from contactlab.studies.search.search_chart import PAGE_LAYOUTS, FrontLayout, draw_front

MARKS: dict[int, tuple[str, ...]] = {4: ("as written",), 5: ("recommended",)}


def build_point(number: int, time: float, error: float) -> FrontPoint:
    ratio = TimeRatio(ratio=time, low=0.97 * time, high=1.03 * time)
    shown: dict[str, Any] = {"body": "arm", "phase": "rest", "time": 0.0, "exact": False}
    parts = ("removes_unused", "removes_far_pairs", "simplifies_hulls")
    shown |= dict.fromkeys(parts, False)
    candidate = Candidate(
        settings={"integrator": "RK4"} if number < 4 else {},
        timestep=1e-3,
        error=error,
        low=error,
        high=error,
        cost=time,
        time_ratio=ratio,
        **shown,
    )
    return FrontPoint(
        number=number,
        name=f"RK4 {number} ms",
        marks=MARKS.get(number, ()),
        candidate=candidate,
        error=error,
        error_low=0.8 * error,
        error_high=1.3 * error,
        error_seeds=9,
        real_time=10 / time,
        state="not verified",
        verification="",
        changed_settings=(),
        verified=None,
        file=None,
    )


def build_report(points: list[FrontPoint]) -> TuneReport:
    shares: dict[str, Any] = {
        "kind": "as written",
        "divergence": "",
        "error_at": None,
        "chance": 0.0,
    }
    target = Target(limit=0.01, unit="1", tolerance=0.1, real_time=None, observed=(), **shares)
    task = Task(start="qpos0", drive="none", own_controls=False, duration=1.0, phases=())
    friction = ParameterUncertainty(name="friction 10 %", error=0.002, body="arm")
    return TuneReport.model_construct(
        model="folder/robot.xml",
        task=task,
        target=target,
        front=tuple(points),
        candidates=tuple(point.candidate for point in points),
        uncertainty=(friction,),
        integrator="Euler",
        reference_integrator="RK4",
        reference_step=1e-4,
        real_time=10.0,
    )


POINTS = [build_point(each, 8 / each**1.2, 1e-5 * each**3) for each in range(1, 9)]


def list_texts(part: Any) -> list[dict[str, Any]]:
    """Return the layers of a specification that are text, with their rows."""
    layers = part.get("layer", [])
    own = [part] if part.get("mark", {}) and part["mark"].get("type") == "text" else []
    return own + [text for layer in layers for text in list_texts(layer)]


@pytest.mark.parametrize("layout", [FrontLayout(), *PAGE_LAYOUTS.values()])
def test_every_point_is_named_inside_the_axes(layout: FrontLayout) -> None:
    spec = draw_front(build_report(POINTS), layout).to_dict()
    words = str(spec)
    assert all(f"{point.number} {point.name}" in words for point in POINTS)
    assert "friction known to 10 %: 0.2 %" in words
    low, high = spec["layer"][-1]["encoding"]["y"]["scale"]["domain"]
    assert low < 0.8e-5
    assert high > 1.3 * 1e-5 * 8**3


@pytest.mark.parametrize("layout", [FrontLayout(), *PAGE_LAYOUTS.values()])
def test_names_lie_inside_the_frame(layout: FrontLayout) -> None:
    """The name of a point in a corner has room on one side only."""
    corners = [(8.0, 1e-4), (8.0, 1e-1), (0.1, 1e-4), (0.1, 1e-1)]
    points = [build_point(number, *corner) for number, corner in enumerate(corners, 1)]
    spec = draw_front(build_report(points), layout).to_dict()
    across = spec["layer"][-1]["encoding"]["x"]["scale"]["domain"]
    for text in list_texts(spec):
        if text["encoding"].get("text", {}).get("field") != "name":
            continue
        (row,) = text["data"]["values"]
        place = layout.width * math.log(row["time"] / across[0]) / math.log(across[1] / across[0])
        room = layout.letter * len(row["name"])
        share = {"left": 0.0, "center": 0.5, "right": 1.0}[text["mark"]["align"]]
        left = place + text["mark"]["dx"] - share * room
        assert left >= 0
        assert left + room <= layout.width


def test_ladders_pass_through_the_points() -> None:
    """A candidate that few seeds put beyond a point is not drawn."""
    report = build_report(POINTS)
    beyond = POINTS[1].candidate.model_copy(
        update={"timestep": 7e-3, "cost": 0.9 * 8 / 2**1.2, "error": 4e-5}
    )
    report = report.model_copy(update={"candidates": (*report.candidates, beyond)})
    spec = draw_front(report).to_dict()
    rows = next(
        layer["data"]["values"] for layer in spec["layer"] if layer["data"]["name"] == "ladders"
    )
    drawn = {(row["integrator"], row["time"], row["error"]) for row in rows}
    assert ("RK4", POINTS[1].candidate.cost, POINTS[1].error) in drawn
    assert ("RK4", beyond.cost, beyond.error) not in drawn
    assert len(drawn) == len(POINTS)


def test_names_are_in_different_places() -> None:
    texts = list_texts(draw_front(build_report(POINTS)).to_dict())
    names = [text for text in texts if text["encoding"].get("text", {}).get("field") == "name"]
    places = {(text["data"]["name"], text["mark"]["align"], text["mark"]["dy"]) for text in names}
    assert len(places) == len(POINTS)
    assert all(one != other for one, other in combinations(places, 2))


def test_the_error_of_one_seed_has_no_interval() -> None:
    alone = {"error_low": None, "error_high": None, "error_seeds": 1}
    points = [point.model_copy(update=alone) for point in POINTS]
    spec = draw_front(build_report(points)).to_dict()
    rows = next(layer for layer in spec["layer"] if layer["data"]["name"] == "points")
    assert all(row["low"] == row["high"] == row["error"] for row in rows["data"]["values"])


def test_an_error_of_zero_is_drawn() -> None:
    points = [build_point(1, 2.0, 0.0), build_point(2, 1.0, 0.0)]
    assert "2 RK4 2 ms" in str(draw_front(build_report(points)).to_dict())


@pytest.mark.long
def test_an_svg_is_dark_if_its_reader_prefers_it() -> None:
    spec = apply_theme(draw_front(build_report(POINTS)).to_dict())
    svg = adaptive_svg(spec)
    assert "@media (prefers-color-scheme:dark)" in svg
    assert '[fill="#222222"]{fill:#e8eaed}' in svg
    dark = str(with_dark_colours(spec))
    assert "#15181c" in dark
    assert "#222222" not in dark
