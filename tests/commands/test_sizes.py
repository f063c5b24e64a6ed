"""Sizes are printed in the unit that is said."""

import re
from pathlib import Path

import pytest

from contactlab.commands import baseline, traces


@pytest.mark.parametrize("size", [4_300, 123_456, 7_890_000, 43_000_000])
def test_megabytes_are_a_million_bytes(capsys: pytest.CaptureFixture[str], size: int) -> None:
    """Two digits are printed, so that a size is off by half of the second at most: 5 %."""
    updated = baseline.WrittenBaseline("kept", runs=3, bytes=size, digest="0" * 32)
    baseline._text(updated, {"store": "results/mine"})  # pyright: ignore[reportPrivateUsage]
    expanded = traces.ExpandedTraces(Path("messages"), traces=2, bytes=size)
    traces._text(expanded, {})  # pyright: ignore[reportPrivateUsage]
    printed = re.findall(r": (\S+) MB", capsys.readouterr().out)
    assert [1e6 * float(number) for number in printed] == pytest.approx([size] * 2, rel=0.05)
