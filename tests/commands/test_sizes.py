"""Sizes are printed in the unit that is said."""

import re
from pathlib import Path

import pytest

from contactlab.commands import baseline, sweep, traces


@pytest.mark.parametrize("size", [4_300, 123_456, 7_890_000, 43_000_000])
def test_megabytes_are_a_million_bytes(capsys: pytest.CaptureFixture[str], size: int) -> None:
    """Two digits are printed, so that a size is off by half of the second at most: 5 %."""
    updated = baseline.WrittenBaseline("kept", runs=3, bytes=size, digest="0" * 32)
    baseline._text(updated, {"store": "results/mine"})  # pyright: ignore[reportPrivateUsage]
    expanded = traces.ExpandedTraces(Path("messages"), traces=2, bytes=size)
    traces._text(expanded, {})  # pyright: ignore[reportPrivateUsage]
    printed = re.findall(r": (\S+) MB", capsys.readouterr().out)
    assert [1e6 * float(number) for number in printed] == pytest.approx([size] * 2, rel=0.05)


@pytest.mark.parametrize(("least", "most"), [(4_300, 999e6), (123e6, 1e9), (92e9, 553e9)])
def test_a_plan_counts_gigabytes_where_there_are_any(least: float, most: float) -> None:
    read = {"MB": 1e6, "GB": 1e9}
    printed = sweep._sizes((least, most))  # pyright: ignore[reportPrivateUsage]
    numbers = [float(number) * read[unit] for number, unit in re.findall(r"(\S+) (.B)", printed)]
    assert numbers == pytest.approx([least, most], rel=5e-3)
    assert "e+" not in printed


@pytest.mark.parametrize("seconds", [0.3, 98, 119, 5930, 5950, 3e5, 4e5, 3e9])
def test_a_plan_counts_minutes_hours_and_days_where_there_are_many(seconds: float) -> None:
    number, unit = sweep._seconds(seconds).split()  # pyright: ignore[reportPrivateUsage]
    read = {"s": 1, "min": 60, "h": 3600, "days": 86_400}
    assert float(number.replace(",", "")) * read[unit] == pytest.approx(seconds, rel=0.11)
    assert "e+" not in number
