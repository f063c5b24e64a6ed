"""Checks advisories: each witness under each release shows its fault where it should only."""

import json
import math
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from contactlab.advisories.witness_runs import fault_share
from contactlab.errors import EngineError
from contactlab.schema.advisory import Advisory, numbers_of
from contactlab.schema.advisory_report import AdvisoriesCheck, WitnessOutcome, WitnessResult
from contactlab.step_progress import count_steps
from contactlab.studies.advisories import witness_process
from contactlab.studies.lock.versions import run_python
from contactlab.temporary_folders import temporary_folder

_PROCESS = witness_process.__name__


def check_advisories(
    advisories: Sequence[Advisory],
    releases: Sequence[str],
    notify: Callable[[str], None] = lambda _: None,
) -> AdvisoriesCheck:
    """Replay the witnesses of advisories under releases of MuJoCo.

    Raises:
        EngineError: a release cannot be installed, or replays no witness.
    """
    ordered = sorted(releases, key=numbers_of)
    results = list[WitnessResult]()
    with temporary_folder() as folder:
        files = {str(Path(folder) / f"{each.id}.yaml"): each for each in advisories}
        for file, advisory in files.items():
            # JSON is YAML.
            Path(file).write_text(advisory.model_dump_json(exclude_none=True), encoding="utf-8")
        for release in count_steps(ordered, "releases", len(ordered)):
            notify(f"MuJoCo {release}")
            lines = _replay_files(list(files), release, notify)
            results += [
                _judge_line(advisory, release, lines[file]) for file, advisory in files.items()
            ]
    results.sort(key=lambda result: result.advisory)
    return AdvisoriesCheck(releases=tuple(ordered), results=tuple(results))


def _replay_files(
    files: Sequence[str], release: str, notify: Callable[[str], None]
) -> Mapping[str, dict[str, Any]]:
    # The last line of a file counts. A crash ends the process: a new one continues behind it.
    last, remaining_files = dict[str, dict[str, Any]](), list(files)
    while remaining_files:
        arguments = ["-P", "-m", _PROCESS, *remaining_files]
        process = run_python(arguments, release, notify, stderr=subprocess.PIPE)
        texts = (text for text in process.stdout.splitlines() if text.startswith('{"file"'))
        lines = list(map(json.loads, texts))
        if not lines:
            # No witness has begun, so that none ended the process.
            messages = process.stderr.strip().splitlines()
            reason = messages[-1] if messages else f"it ended with {process.returncode}"
            raise EngineError(
                f"no witness can be replayed under MuJoCo {release}, since {process.args[0]} does "
                f"not start {_PROCESS}: {reason}; repair the packages of this Python (PYTHONPATH "
                "may name another contactlab or mujoco), or leave this release out of --mujoco"
            )
        sys.stderr.write(process.stderr)
        last |= {line["file"]: line for line in lines}
        current_file = lines[-1]["file"] if lines else remaining_files[0]
        last.setdefault(current_file, {"file": current_file})
        remaining_files = remaining_files[remaining_files.index(current_file) + 1 :]
    return last


def _judge_line(advisory: Advisory, release: str, line: Mapping[str, Any]) -> WitnessResult:
    witness = advisory.witness
    shown_share = 0.5  # of the way from the right to the wrong value; beyond, the fault shows
    outcome: WitnessOutcome
    if "measured" not in line:
        ended = advisory.severity == "crash" or "reason" not in line
        outcome = "crashed" if ended else "not run"
    else:
        result = math.nan if line["measured"] is None else float(line["measured"])
        if abs(result - witness.right) <= witness.tolerance:
            outcome = "not shown"
        else:
            shows = fault_share(witness, result) >= shown_share
            outcome = "shown" if shows else "unclear"
    return WitnessResult(
        advisory=advisory.id,
        release=release,
        affected=advisory.affects_release(release),
        outcome=outcome,
        measured=line.get("measured"),
        meets=line.get("meets", False),
        reason=line.get("reason", ""),
    )
