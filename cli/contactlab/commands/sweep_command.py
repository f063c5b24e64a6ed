"""`contactlab sweep`: run a declared sweep and write a store of evidence."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from contactlab.commands import options as opt
from contactlab.commands.options import flag, option
from contactlab.commands.store_commands import format_value, print_summary
from contactlab.commands.terminal import (
    begin_workers,
    echo,
    print_json,
    print_table,
    progress_display,
    resumable,
    say,
)
from contactlab.errors import ExpectationError, RunFailedError, SweepFileError

if TYPE_CHECKING:
    from contactlab.plan.grid import Plan
    from contactlab.run.forecast import Forecast
    from contactlab.run.tasks import Executor
    from contactlab.schema.evidence import StoreManifest


def sweep(
    name: str = typer.Argument(..., metavar="SWEEP", help="Sweep file or shipped sweep."),
    store: opt.Address | None = opt.SWEEP_STORE,
    assign: list[str] | None = opt.SET,
    only: list[str] | None = option(
        "NAME=VALUE", "Keep runs with a value: cone=elliptic; may be repeated."
    ),
    limit: int | None = option("N", "Keep the first N runs.", min=1),
    workers: int | None = opt.WORKERS,
    *,
    drive: str | None = opt.DRIVE,
    executor: str = typer.Option(
        "local", metavar="NAME", help="Where jobs run: local, or ray, or another that is installed."
    ),
    address: str | None = option("HOST:PORT|auto", "Cluster to join; by default Ray starts one."),
    mujoco: str | None = opt.MUJOCO,
    plugin: list[Path] | None = opt.PLUGIN,
    allow_code: bool = opt.ALLOW_CODE,
    plan: bool = flag("--plan", "Print runs, time and disk space; run nothing."),
    yes: bool = flag("--yes", "Allow more than 100,000 runs."),
    fresh: bool = flag("--fresh", "Replace an existing store."),
    retry_failed: bool = flag("--retry-failed", "Repeat runs that crashed, timed out or failed."),
    repair: bool = flag("--repair", "Keep the sound runs of a damaged store, repeat the others."),
    output: opt.TableFormat = opt.FORMAT,
) -> None:
    """Run a sweep into a store; the same command resumes an interrupted one."""
    from contactlab import resources

    if executor == "local" and address is not None:
        raise SweepFileError("--address is for a cluster; add --executor ray")
    if executor != "local" and workers == 0:
        raise SweepFileError("--workers 0 runs all in this process; leave it out for a cluster")
    path = resources.find_sweep(name)
    target = store or resources.RESULTS / path.stem
    opt.rerun_with_mujoco(mujoco, None if store else target)
    # A finished store is unlikely to need workers. They are forked when all is planned, with what
    # that made, but before others' code, whose threads a fork would lose.
    runs_nothing = plan or (not fresh and Path(str(target), "manifest.json").exists())
    wanted = 0 if runs_nothing or executor != "local" else workers
    begin_workers(wanted if plugin or allow_code else 0)
    from contactlab.plan.grid import CONFIRM_ABOVE
    from contactlab.plan.overrides import Overrides, drive_option
    from contactlab.run.forecast import forecast
    from contactlab.run.sweep_request import read_request
    from contactlab.run.sweep_runner import run_sweep
    from contactlab.run.worker_pool import worker_count

    plugins = opt.load_plugins(plugin)
    request = read_request(
        path,
        path.stem,
        target,
        folder=path.parent,
        workers=worker_count(workers),
        overrides=Overrides(assign or (), only or (), limit),
        drive=drive_option(drive),
        allow_code=allow_code,
    )
    for warning in request.plan.warnings:
        say(str(warning))
    if plan:
        _print_plan(request.plan, forecast(request.plan, request.scene, request.workers), output)
        return
    if request.plan.count > CONFIRM_ABOVE and not yes:
        raise SweepFileError(
            f"the sweep has {request.plan.count:,} runs; look at it with --plan, then run it with "
            "--yes"
        )
    begin_workers(0 if plugins else wanted)
    with (
        resumable() as stop,
        progress_display() as display,
        _cluster(executor, address, request.workers if address is None else workers) as nodes,
    ):
        request = replace(
            request,
            cluster=nodes,
            fresh=fresh,
            retry_failed=retry_failed,
            repair=repair,
            allow_code=allow_code,
        )
        manifest = run_sweep(request, display.begin, display.advance, stop)
    _conclude(target, manifest, output)


def _cluster(
    name: str, address: str | None, workers: int | None
) -> "AbstractContextManager[Executor | None]":
    """Return what connects to an executor, which is an entry point; of this machine, nothing."""
    if name == "local":
        return nullcontext()
    from contactlab.plugins import extensions

    found = extensions("executor")
    if name not in found:
        raise SweepFileError(f"no executor '{name}'; installed are {', '.join(['local', *found])}")
    return found[name].load()(address, workers)


def _conclude(target: opt.Address, manifest: "StoreManifest", output: opt.TableFormat) -> None:
    """Print what a sweep found; fail if runs were lost, or are not as it expects."""
    from contactlab.store.finished_store import Store

    for what, why in manifest.sweep.lacking.items():
        say(f"{what} is left empty: {why}")
    store = Store.open(target)
    print_summary(store, output)
    lost = manifest.statuses.get("crashed", 0) + manifest.statuses.get("timeout", 0)
    if lost:
        raise RunFailedError(f"{lost} of {manifest.runs} runs crashed or timed out")
    unmet = manifest.expectations.get("unmet", 0)
    if unmet:
        raise ExpectationError(f"{unmet} of {manifest.runs} runs are not as the sweep expects")
    if manifest.unmet_means:
        raise ExpectationError("; ".join(manifest.unmet_means))


def _print_plan(plan: "Plan", forecast: "Forecast", output: opt.TableFormat) -> None:
    axes = [(axis.name, axis.role, axis.count, _range(axis.values)) for axis in plan.axes]
    if output == "json":
        keys = ("name", "role", "count", "values")
        listed = [dict(zip(keys, axis, strict=True)) for axis in axes]
        print_json({"axes": listed, "seeds": len(plan.sweep.seed_values), **vars(forecast)})
        return
    print_table(("axis", "role", "values", "range"), axes)
    echo(f"runs   {forecast.runs:,} (seeds {len(plan.sweep.seed_values)})")
    echo(f"steps  {forecast.steps:,}")
    echo(f"time   {_seconds(forecast.seconds[0])} to {_seconds(forecast.seconds[1])}")
    passes = {"accuracy": forecast.accuracy_seconds, "timing": forecast.timing_seconds}
    for name, seconds in passes.items():
        if seconds:
            echo(f"       {_seconds(seconds)} of it for {name}")
    echo(f"disk   {_megabytes(forecast.bytes)} of traces")
    for form, size in forecast.bytes_by_format.items():
        if form != plan.sweep.trace_format and size[1]:
            echo(f"       {_megabytes(size)} with trace_format: {form}")
    for warning in forecast.warnings:
        echo(f"warning: {warning}")


def _range(values: tuple[object, ...]) -> str:
    shown = values if len(values) <= 6 else (*values[:2], "...", values[-1])
    return ", ".join(format_value(value) for value in shown)


def _megabytes(size: tuple[float, float]) -> str:
    return f"{size[0] / 1e6:.3g} to {size[1] / 1e6:.3g} MB"


def _seconds(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 120 else f"{seconds / 60:.2g} min"
