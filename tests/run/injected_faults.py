"""Faults that workers meet at single runs, as `faults.json` beside this file says.

Workers import a copy of it before their first job.
"""

import copy
import ctypes
import json
import os
import resource
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

from contactlab.engines import contact_kernel, mujoco_batch
from contactlab.engines.mujoco_batch import Batch
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.run import worker as working
from contactlab.run.planned_runs import Preparer
from contactlab.run.worker import Worker

FAR = 50_000_000
HUGE = 2 << 20
IN_CHECKS = "hang in checks"
PLAN = json.loads(Path(__file__).with_name("faults.json").read_text())
FAULTS: dict[int, str] = {int(index): fault for index, fault in PLAN["runs"].items()}
# Models that a rollout must not survive, by the address of each.
doomed: dict[int, str] = {}

plans = Preparer.plan_job
run_job = Worker.run
begin = Worker.__init__
check_runs = MujocoEngine.check_runs


def meet(fault: str, model: Any) -> None:
    """Let a fault happen where the engine begins to step."""
    match fault:
        case "segfault":
            model.jnt_qposadr[:] = FAR  # where the engine then writes
        case "engine error":
            model.opt.integrator = 99
        case "hang":
            ctypes.PyDLL(None).pause()  # which keeps the interpreter's lock
        case "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        case "abort":
            os.abort()
        case "exit 0" | "exit 3":
            os._exit(int(fault[-1]))
        case "memory":
            bytearray(1 << 60)
        case _:
            assert fault in {"huge", IN_CHECKS}, fault


class Doomed(Batch):
    """A batch in which a fault happens when its run begins."""

    def set_models(self, models: Any) -> None:
        self.known = models
        super().set_models(models)

    def rollout(self, *args: Any, **kwargs: Any) -> Any:
        for run in kwargs.get("ids", range(len(self.known))):
            if fault := doomed.get(id(self.known[run])):
                meet(fault, self.known[run])
        return super().rollout(*args, **kwargs)


kernel: Any = contact_kernel.KernelStepper
step_by_kernel = kernel.step_run


def doomed_step(self: Any, run: int, *args: Any) -> Any:
    """Step by the kernel; a fault happens when its run begins."""
    if fault := doomed.get(id(self._models[run])):
        meet(fault, self._models[run])
    return step_by_kernel(self, run, *args)


def doomed_checks(runs: Any, *args: Any) -> Any:
    """Check runs; a fault that waited for that happens first."""
    for model in runs.models:
        if doomed.get(id(model)) == IN_CHECKS:
            meet("hang", model)
    return check_runs(runs, *args)


def spoiled_plans(self: Preparer, job: Any) -> Any:
    """Give each run with a fault a model of its own; others may share theirs."""
    made = plans(self, job)
    doomed.clear()
    for place, plan in enumerate(made):
        if fault := FAULTS.get(plan.run.index):
            model = copy.copy(plan.prepared.model)
            made[place] = replace(plan, prepared=replace(plan.prepared, model=model))
            doomed[id(model)] = fault
    return made


def inflated_run(self: Worker, job: Any) -> Any:
    """Make results of some runs larger than what a pipe holds; they stay valid JSON."""
    done = run_job(self, job)
    for place, each in enumerate(job[: len(done)]):
        if FAULTS.get(each.index) == "huge":
            done[place] = done[place]._replace(row=b" " * HUGE + done[place].row)
    return done


def bounded_begin(self: Worker, *args: Any) -> None:
    """Leave a worker so many bytes of addresses beyond what it begins with."""
    begin(self, *args)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + PLAN["spare_bytes"]
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


inner: Any = mujoco_batch
inner.Batch = Doomed
kernel.step_run = doomed_step
engine: Any = MujocoEngine
engine.check_runs = staticmethod(doomed_checks)
Preparer.plan_job = spoiled_plans
module: Any = working
# What hangs in checks keeps nobody waiting for ten time limits.
module._SECOND_PASS_LIMITS = 2
worker: Any = Worker
worker.run = inflated_run
if PLAN["spare_bytes"] is not None:
    worker.__init__ = bounded_begin
