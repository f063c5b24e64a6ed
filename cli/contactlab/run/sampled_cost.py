"""Measures the cost of a sweep's runs, by recording some of them into a temporary store."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from contactlab.engines.closed_loop import allowed_policy
from contactlab.run.planned_runs import RunIndex, pack_jobs
from contactlab.run.sweep_request import SweepRequest
from contactlab.run.sweep_runner import identity_of, make_task
from contactlab.run.worker import Worker
from contactlab.scene.run_spec import RunSpec
from contactlab.store.store_files import TRACES
from contactlab.store.store_writer import StoreWriter, open_writer


@dataclass(frozen=True)
class SampledCost:
    """The cost of recorded runs, per step: stepping, measures, checks and traces included.

    Attributes:
        cpu_seconds: of a step.
        trace_bytes: of a step, by `trace_format`.
        checks_share: of the time that checks take.
        first_seconds: of a worker's first run, to compile its model and load its modules.
    """

    cpu_seconds: float
    trace_bytes: dict[str, float]
    checks_share: float = 0.0
    first_seconds: float = 0.0


def sample_cost(request: SweepRequest, index: RunIndex, runs: Sequence[RunSpec]) -> SampledCost:
    """Record some runs of a sweep as its workers would, and return the cost of a step.

    Runs are shortened, and some are left out, if all of them would take longer than two seconds of
    CPU time.
    """
    runs = [replace(run, run_id=f"{place:016x}", index=place) for place, run in enumerate(runs)]
    with TemporaryDirectory() as folder:
        worker = _open_worker(request, index, Path(folder) / "own")
        warm_up_steps = 100  # compile the model, and load everything that a first run needs
        warm_up = _shorten_runs([runs[0]], warm_up_steps)
        ((first_seconds, _),) = _record_jobs(worker, request, warm_up)
        trial_steps = 500  # of one run, to find how many steps can be sampled
        trial = _shorten_runs([runs[0]], trial_steps)
        ((seconds, steps),) = _record_jobs(worker, request, trial)
        # Runs are chosen evenly, since costs differ between settings, and shortened if needed.
        sample_cpu_seconds = 2.0  # about as long as a person waits for a plan
        most_steps = sample_cpu_seconds * steps / max(seconds, 1e-9)
        part = min(1.0, most_steps / sum(run.steps for run in runs))
        fewest_runs = 4  # settings differ between runs, so fewer tell nothing of the others
        count = min(len(runs), max(fewest_runs, round(part * len(runs))))
        places = np.linspace(0, len(runs) - 1, count).round().astype(int)
        chosen = _shorten_runs(
            [runs[place] for place in places], max(warm_up_steps, int(most_steps / count))
        )
        seconds, steps = np.sum(_record_jobs(worker, request, chosen), axis=0).tolist()
        forms, share = dict[str, float](), 0.0
        if request.plan.sweep.checks != "none":
            unchecked = _open_unchecked(request, index, Path(folder) / "unchecked", {})
            alone, own = np.sum(_record_jobs(unchecked, request, chosen), axis=0).tolist()
            share = max(0.0, 1 - alone / own * steps / seconds)
        if request.plan.sweep.trace != "none":
            form_runs = 3  # runs that are encoded in each form of traces
            few = chosen[:: max(1, len(chosen) // form_runs)]
            for form in ("messages", "compact"):
                store = Path(folder) / form
                changes = {"trace": "all", "trace_format": form}
                _record_jobs(_open_unchecked(request, index, store, changes), request, few)
                size = sum(file.stat().st_size for file in (store / TRACES).rglob("*.mcap"))
                forms[form] = size / sum(run.steps for run in few)
    return SampledCost(seconds / steps, forms, share, first_seconds)


def _shorten_runs(runs: Sequence[RunSpec], most_steps: int) -> list[RunSpec]:
    return [
        replace(run, duration=run.timestep * most_steps) if run.steps > most_steps else run
        for run in runs
    ]


def _record_jobs(
    worker: Worker, request: SweepRequest, runs: Sequence[RunSpec]
) -> list[tuple[float, int]]:
    # Each job has its CPU time [s] and its steps.
    costs = list[tuple[float, int]]()
    for job in pack_jobs(runs, len(runs), request.scene, 1):
        begin = time.process_time()
        worker.run(job)
        costs.append((time.process_time() - begin, sum(run.steps for run in job)))
    return costs


def _open_unchecked(
    request: SweepRequest, index: RunIndex, store: Path, changes: Mapping[str, str]
) -> Worker:
    sweep = request.plan.sweep.model_copy(update={"checks": "none", **changes})
    return _open_worker(replace(request, plan=replace(request.plan, sweep=sweep)), index, store)


def _open_worker(request: SweepRequest, index: RunIndex, store: Path) -> Worker:
    # The worker writes into its own store, not into that of the sweep.
    policy = allowed_policy(request.scene.drive, allowed=request.allow_code)
    request = replace(request, store=store, fresh=False, shard=None)
    identity, drive = identity_of(request, index), request.scene.drive
    drive_files = {drive.hash: drive} if request.plan.sweep.drive and drive.hash else {}
    with open_writer(
        store, identity, request.scene.source.content, fresh=False, more_files=drive_files
    ) as writer:
        assert isinstance(writer, StoreWriter)
        return Worker(make_task(request, identity, writer, policy), None)
