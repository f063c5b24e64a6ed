"""Runs that bring down the engine, or the process around it: told as such, and nobody else."""

import json
import re
from collections.abc import Callable, Mapping
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from contactlab.store.verify_store import find_problems

SWEEP = """
version: 1
scene: ball_drop
duration: 0.1
seeds: 3
timeout: 1
axes:
  timestep: [1.0e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.1]
"""
RUNS = 18
CULPRIT = 7
# The innermost frame of what hung comes first.
HUNG = r"over 1 s: Stack \(most recent call first\): / File \"\S+injected_faults.py\", line \d+ in "


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory, make_sweeper: Callable[[Path], Any]) -> Any:
    """What comes of the sweep without faults."""
    sweeper = make_sweeper(tmp_path_factory.mktemp("quiet"))
    with chdir(sweeper.folder):
        sweeper.run(SWEEP)
    return sweeper.outcome()


@pytest.fixture
def sweep(command: Any, inject: Any, tmp_path: Path) -> Callable[..., tuple[int, str, str]]:
    """Return what runs the sweep with faults, by the place of their runs in the plan."""
    (tmp_path / "small.yaml").write_text(SWEEP)

    def run(faults: Mapping[int, str], *options: str) -> tuple[int, str, str]:
        arguments = ("sweep", "small.yaml", "-o", "store", "--format", "json", *options)
        return command.run(*arguments, first=inject(faults))

    return run


FAULTS = {
    2: ("segfault", "crashed", "the worker was ended by SIGSEGV"),
    7: ("exit 0", "crashed", "the worker exited with code 0"),
    11: ("memory", "crashed", "out of memory: the worker cannot get more"),
    16: ("hang", "timeout", HUNG),
}


@pytest.mark.long
def test_only_the_culprits_are_lost(sweep: Any, quiet: Any, sweeper: Any, but: Any) -> None:
    faults = {place: fault for place, (fault, _, _) in FAULTS.items()}
    code, out, err = sweep(faults, "--workers", "2")
    assert (code, err) == (4, "error: 4 of 18 runs crashed or timed out\n")
    assert json.loads(out)["statuses"] == {"ok": RUNS - 4, "crashed": 3, "timeout": 1}
    table, _ = sweeper.outcome()
    assert table["index"] == list(range(RUNS))
    for place, (_, label, reason) in FAULTS.items():
        assert table["label"][place] == table["status"][place] == label
        assert re.match(reason, table["status_reason"][place])
        assert table["label_reason"][place] == table["status_reason"][place]
        assert table["trajectory_hash"][place] is table["trace_file"][place] is None
    assert but(sweeper.outcome(), FAULTS) == but(quiet, FAULTS)
    assert find_problems(sweeper.folder / "store") == []


@pytest.mark.night
def test_what_hangs_while_it_is_checked_is_a_timeout(
    sweep: Any, sweeper: Any, but: Any, tmp_path: Path
) -> None:
    """Its second pass hangs, in which all runs of its job go on from the first."""
    checked = SWEEP + "checks: all\n"
    (tmp_path / "small.yaml").write_text(checked)
    code, _, err = sweep({CULPRIT: "hang in checks"}, "--workers", "1")
    assert (code, err) == (4, "error: 1 of 18 runs crashed or timed out\n")
    table, _ = sweeper.outcome()
    assert table["label"][CULPRIT] == table["status"][CULPRIT] == "timeout"
    assert re.match(HUNG, table["status_reason"][CULPRIT])
    faulty = sweeper.outcome()
    sweeper.run(checked, "quiet")
    assert but(faulty, {CULPRIT}) == but(sweeper.outcome("quiet"), {CULPRIT})
    assert find_problems(sweeper.folder / "store") == []


@pytest.mark.night
def test_an_error_of_the_engine_is_its_runs_own(
    sweep: Any, quiet: Any, sweeper: Any, but: Any
) -> None:
    code, out, err = sweep({CULPRIT: "engine error"}, "--workers", "1")
    assert (code, err) == (0, "")
    assert json.loads(out)["statuses"] == {"ok": RUNS - 1, "error": 1}
    table, _ = sweeper.outcome()
    assert (table["label"][CULPRIT], table["status"][CULPRIT]) == ("invalid", "error")
    assert table["status_reason"][CULPRIT] == "mj_step: invalid integrator"
    assert but(sweeper.outcome(), {CULPRIT}) == but(quiet, {CULPRIT})
    assert find_problems(sweeper.folder / "store") == []


@pytest.mark.night
def test_a_result_larger_than_a_pipe_arrives(sweep: Any, quiet: Any, sweeper: Any) -> None:
    code, _, err = sweep({CULPRIT: "huge", CULPRIT + 1: "huge"}, "--workers", "1")
    assert (code, err) == (0, "")
    assert sweeper.outcome() == quiet


@pytest.mark.night
@pytest.mark.parametrize("fault", ["segfault", "kill", "exit 3"])
def test_a_sweep_of_nothing_but_culprits_ends(sweep: Any, sweeper: Any, fault: str) -> None:
    code, out, _ = sweep(dict.fromkeys(range(RUNS), fault), "--workers", "2")
    assert code == 4
    assert json.loads(out)["statuses"] == {"crashed": RUNS}
    assert sweeper.outcome()[0]["index"] == list(range(RUNS))
    assert find_problems(sweeper.folder / "store") == []
