"""The chart shows what the report says, and never loses a point to a logarithmic axis."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.charts import save_figure
from contactlab.command_line.options import check_figure
from contactlab.errors import OutputError
from contactlab.pareto.tradeoff_chart import chart_data, chart_specification
from contactlab.schema.tradeoff_report import TradeoffReport

Written = Callable[..., Any]
Vary = Callable[..., TradeoffReport]


def draw(report: TradeoffReport, path: Path) -> None:
    """Draw a report as the command does."""
    check_figure(path)
    save_figure(chart_specification(report), path)


def points(report: TradeoffReport) -> list[dict[str, Any]]:
    return chart_data(report).points


def changed(report: TradeoffReport, index: int, **changes: Any) -> TradeoffReport:
    """Return a report with one configuration changed."""
    configurations = list(report.configurations)
    configurations[index] = configurations[index].model_copy(update=changes)
    return report.model_copy(update={"configurations": tuple(configurations)})


@pytest.mark.long
def test_every_configuration_has_its_point_within_the_frame(report: TradeoffReport) -> None:
    shown = chart_data(report)
    assert len(shown.points) == len(report.configurations)
    for each in shown.points:
        assert shown.frame.time[0] <= each["time"] <= shown.frame.time[1]
        assert shown.frame.error[0] <= each["error"] <= shown.frame.error[1]


@pytest.mark.parametrize("error", [0.0, 1e-300, None])
def test_no_error_falls_off_the_axis(report: TradeoffReport, error: float | None) -> None:
    found = chart_data(changed(report, 0, error=error))
    assert 0 < found.frame.error[0] <= found.points[0]["error"] <= found.frame.error[1]


def test_failures_are_at_the_edge(report: TradeoffReport) -> None:
    outcomes = report.configurations[2].outcomes
    failed = outcomes.model_copy(update={"labels": {"stable": 5, "chatter": 1}})
    found = chart_data(changed(report, 2, outcomes=failed, feasible=False))
    assert found.points[2]["state"] == "failed"
    assert found.points[2]["error"] == found.frame.error[1]


def test_what_is_recommended_is_ringed(report: TradeoffReport) -> None:
    assert report.recommendation is not None
    ringed = [each for each in points(report) if each["chosen"].startswith("recommended")]
    assert [each["time"] for each in ringed] == [report.recommendation.time]


def crowded(report: TradeoffReport) -> TradeoffReport:
    """Return a report of six times as many methods, each six times slower than the one before."""

    def values(each: Any, number: int) -> dict[str, Any]:
        return {"configuration": {**each.configuration, "cone": str(number)}}

    many = tuple(
        each.model_copy(update={**values(each, number), "time": (each.time or 0) * 6**number})
        for number in range(6)
        for each in report.configurations
    )
    methods = tuple(
        each.model_copy(update=values(each, number))
        for number in range(6)
        for each in report.methods
    )
    none = {"front": (), "unconstrained_front": (), "recommendation": None, "robust": None}
    return report.model_copy(update={"configurations": many, "methods": methods, **none})


def test_of_more_than_four_methods_each_integrator_has_its_front(report: TradeoffReport) -> None:
    shown = chart_data(crowded(report))
    assert sorted(name.split()[-1] for name in shown.methods) == ["Euler", "RK4"]
    for method in shown.methods:
        mine = [each for each in shown.points if each["method"] == method]
        for each in mine:
            beaten = any(
                other["time"] < each["time"] and other["error"] <= each["error"] for other in mine
            )
            assert each["drawn"] != beaten


def test_methods_beyond_four_without_integrators_share_one_grey(report: TradeoffReport) -> None:
    many = crowded(report)
    alike = many.model_copy(update={"knobs": tuple(set(many.knobs) - {"integrator"})})
    assert len(chart_data(alike).methods) == 4
    assert "others" in {each["method"] for each in points(alike)}


def test_names_cover_neither_each_other_nor_points(report: TradeoffReport) -> None:
    """Boxes of texts, with a letter of .6 of the size of its font, are apart."""
    layers = chart_specification(report).to_dict()["layer"]
    shown = chart_data(report)
    boxes = list[tuple[float, float, float, float]]()
    markers = list[tuple[float, float, float, float]]()
    (low, high), (least, most) = shown.frame
    for point in shown.points:
        x = 640 * math.log(point["time"] / low) / math.log(high / low)
        y = 440 * math.log(most / point["error"]) / math.log(most / least)
        markers.append((x - 4, x + 4, y - 4, y + 4))
    for layer in layers:
        mark, data = layer["mark"], layer["data"]["values"]
        if mark["type"] != "text" or layer["encoding"].get("text", {}).get("field") not in {
            "chosen",
            "label",
        }:
            continue
        if "stroke" in mark:  # the halo of the same text
            continue
        field, size = layer["encoding"]["text"]["field"], mark["fontSize"]
        for row in data:
            place = {key: row.get(key, mark.get(key)) for key in ("align", "dx", "dy")}
            x = 640 * math.log(row["time"] / low) / math.log(high / low) + place["dx"]
            y = 440 * math.log(most / row["error"]) / math.log(most / least) + place["dy"]
            length = 0.6 * size * len(row[field])
            left = x - length if place["align"] == "right" else x
            boxes.append((left, left + length, y - size / 2, y + size / 2))
    assert boxes
    for place, one in enumerate(boxes):
        for other in (*boxes[:place], *markers):
            assert (
                one[0] >= other[1] or other[0] >= one[1] or one[2] >= other[3] or other[2] >= one[3]
            )


@pytest.mark.long
@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_file_is_drawn(report: TradeoffReport, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"chart{suffix}"
    draw(report, path)
    head = path.read_bytes()[:8]
    assert head == b"\x89PNG\r\n\x1a\n" if suffix == ".png" else head.startswith(b"<svg")


def test_the_specification_has_data_only_and_no_address(report: TradeoffReport) -> None:
    text = str({**chart_specification(report).to_dict(), "$schema": ""})
    assert "http" not in text
    assert "NaN" not in text


def test_another_suffix_is_refused(report: TradeoffReport, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"ends in \.png or \.svg"):
        draw(report, tmp_path / "chart.bmp")


def test_a_folder_that_is_not_there(report: TradeoffReport, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        draw(report, tmp_path / "nowhere" / "chart.png")


@pytest.mark.long
def test_a_report_without_a_feasible_configuration_is_drawn(
    report: TradeoffReport, tmp_path: Path
) -> None:
    empty = report.model_copy(
        update={"recommendation": None, "robust": None, "front": (), "next_step": None}
    )
    draw(empty, tmp_path / "chart.svg")
    assert (tmp_path / "chart.svg").stat().st_size > 1000
