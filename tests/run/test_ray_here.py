"""A Ray of our own, on this machine: it calls nobody, and ends with the sweep."""

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("ray", reason="contactlab[ray] is not installed")
pytestmark = pytest.mark.night

Until = Callable[[Callable[[], bool]], None]

SILENCE = {"RAY_USAGE_STATS_ENABLED=0", "RAY_USAGE_STATS_REPORT_URL=http://127.0.0.1:9/"}


def started_with(mark: str) -> dict[int, tuple[str, set[str]]]:
    """Return command lines and environments of the processes that have a variable."""
    found: dict[int, tuple[str, set[str]]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            environment = set((folder / "environ").read_text().split("\0"))
            line = (folder / "cmdline").read_text().replace("\0", " ")
        except (OSError, UnicodeDecodeError):
            continue
        if mark in environment and line:
            found[int(folder.name)] = line, environment
    return found


def ours(line: str) -> bool:
    """Whether a process must end at once; Ray's agents look for their node for a minute more."""
    return not line.startswith(("ray::DashboardAgent", "ray::RuntimeEnvAgent"))


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_calls_nobody_and_leaves_nothing(
    command: Any, tmp_path: Path, ball: str, until: Until, monkeypatch: pytest.MonkeyPatch, end: int
) -> None:
    monkeypatch.setenv("MARK", str(tmp_path))
    for name in ("RAY_USAGE_STATS_ENABLED", "RAY_USAGE_STATS_REPORT_URL"):
        monkeypatch.delenv(name, raising=False)
    mark = f"MARK={tmp_path}"
    (tmp_path / "small.yaml").write_text(ball.replace("seeds: 3", "seeds: 300"))
    journal = tmp_path / "store" / "journal.jsonl"
    process = command.start(
        *("sweep", "small.yaml", "-o", "store", "--executor", "ray", "--workers", "2")
    )
    until(lambda: journal.exists() and journal.stat().st_size > 0)
    living = started_with(mark)
    servers = [environment for line, environment in living.values() if "gcs_server" in line]
    assert len(servers) == 1
    # A fork that does not run its own program yet shows the command's environment, and a process
    # that has given itself a title has written it over its own; that is its parent's, the raylet's.
    command_line, _ = living[process.pid]
    plain = [
        (line, environment)
        for line, environment in living.values()
        if line != command_line and not line.startswith("ray::")
    ]
    assert any("raylet" in line for line, _ in plain)
    for line, environment in plain:
        assert environment >= SILENCE, line
    process.send_signal(end)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130 if end == signal.SIGINT else -end, ""), err
    assert "Traceback" not in err
    until(lambda: not any(ours(line) for line, _ in started_with(mark).values()))
