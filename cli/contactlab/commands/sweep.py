"""`contactlab sweep`: run a declared sweep and write a store of evidence, or join its shards."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command, flag
from contactlab.command_line.judgements import list_printers
from contactlab.command_line.report_formats import formats_by_type, report_formats
from contactlab.command_line.store_summary import (
    explain_unexpected,
    report_expectations,
    summary_csv,
    summary_json,
    summary_text,
)
from contactlab.command_line.surroundings import rerun_with_mujoco, say, surroundings
from contactlab.errors import ContactlabError, SweepFileError

if TYPE_CHECKING:
    from contactlab.run.sweep_request import SweepRequest
    from contactlab.run.tasks import Executor
    from contactlab.schema.store_reports import SweepForecast
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


def _find_failure(result: "Store | SweepForecast", arguments: Arguments) -> ContactlabError | None:
    """Return the error of lost runs, or of runs that are not as the sweep expects."""
    from contactlab.store.finished_store import Store

    del arguments
    return explain_unexpected(result) if isinstance(result, Store) else None


@command(
    "run",
    keeps=lambda given: "nothing" if given["merge"] else "finished runs",
    examples=(
        "sweep grasp",
        "sweep grid.yaml --set timestep=1e-3 --workers 4",
        "sweep shards/* --merge -o results/grid",
    ),
    formats=formats_by_type(
        {
            "Store": {
                "text": summary_text,
                "json": summary_json,
                "csv": summary_csv,
                **list_printers(report_expectations, "markdown", "junit", "github"),
            },
            "SweepForecast": report_formats(),
        }
    ),
    failure=_find_failure,
)
def sweep(
    source: Annotated[
        "str | Path | Mapping[str, object] | Sequence[Address | str]",
        Argument(
            "SWEEP",
            "Sweep file or shipped sweep; with --merge the stores of its shards.",
            kind=list[str],
        ),
    ],
    *,
    output: opt.StoreOutput = None,
    set: opt.Set = (),
    where: opt.Where = (),
    limit: opt.Limit = None,
    workers: opt.Workers = None,
    keyframe: opt.Keyframe = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    require: opt.Require = (),
    executor: Annotated[
        str, Option("NAME", "Executor of jobs: local, ray, slurm, or an installed one.")
    ] = "local",
    address: Annotated[
        str | None,
        Option("WHERE", "Ray: HOST:PORT or auto. SLURM: resources of a task, cpus=8,..."),
    ] = None,
    mujoco: opt.Mujoco = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    shard: Annotated[
        str | None, Option("N/M", "Run the N-th of M slices, as a store that `--merge` joins.")
    ] = None,
    merge: Annotated[bool, flag("Join the shards of a sweep into one store.")] = False,
    partial: Annotated[
        bool, flag("With --merge, join the existing shards, and list the missing runs.")
    ] = False,
    plan: Annotated[bool, flag("Print runs, time and disk space; run nothing.")] = False,
    yes: Annotated[bool, flag("Allow more than 100,000 runs.")] = False,
    fresh: Annotated[bool, flag("Replace an existing store.")] = False,
    retry_failed: Annotated[bool, flag("Repeat runs that crashed, timed out or failed.")] = False,
    repair: Annotated[
        bool, flag("Keep the intact runs of a damaged store, repeat the others.")
    ] = False,
) -> "Store | Any":  # noqa: ANN401 - so that a caller without `plan` has a store
    """Run a sweep into a store, or resume an interrupted one.

    The source may also be the content of a sweep file, as data. The store is `results/NAME` unless
    `output` names another, and is returned open. With `plan` nothing runs, and the result is a
    SweepForecast. With `merge` the sources are stores of `shard`, in any order.

    Raises:
        SweepFileError: the sweep or a setting has mistakes; the message lists all.
        OutputError: the store cannot be written.
        StoreError: the store is another sweep's; or a shard is unfinished, of another sweep, or has
            runs that another has.
        StoppedError: the sweep was interrupted; the same call resumes it.
    """
    from contactlab.resources import RESULTS

    places: Sequence[Any] = source if isinstance(source, list | tuple) else [source]
    if merge:
        return _merge_shards(places, output, shard=shard or plan, may_lack=partial, fresh=fresh)
    if len(places) != 1 or partial:
        raise SweepFileError("name one sweep; to join the shards of a sweep, add --merge")
    if executor == "local" and address is not None:
        raise SweepFileError("--address is for a cluster; add --executor ray or slurm")
    if shard is not None and plan:
        raise SweepFileError("--plan shows the whole sweep; leave out --shard")
    if executor != "local" and workers == 0:
        raise SweepFileError("--workers 0 runs in this process; leave it out for a cluster")
    one: Any = places[0]
    text, name, folder = _find_source(one)
    target = RESULTS / name if output is None else opt.address_of(output)
    rerun_with_mujoco(mujoco, None if output else target)
    # A finished store is unlikely to need workers. Their parent process loads during planning.
    runs_nothing = plan or (not fresh and Path(str(target), "manifest.json").exists())
    forked_workers = 0 if runs_nothing or executor != "local" else workers
    surroundings().fork_workers(forked_workers)
    from contactlab.plan.grid import CONFIRM_ABOVE
    from contactlab.plan.overrides import Overrides
    from contactlab.run.forecast import (
        check_units,
        forecast_sweep,
    )
    from contactlab.run.shards import parse_shard
    from contactlab.run.sweep_request import read_request
    from contactlab.run.worker_pool import worker_count
    from contactlab.schema.drive import PolicyDrive

    opt.load_plugins(plugin)
    task = opt.task_of(keyframe, drive, duration, require=require)
    request = read_request(
        text,
        name,
        target,
        folder=folder,
        workers=worker_count(workers),
        overrides=Overrides(
            [*opt.write_assignments(set), *task.settings], opt.write_assignments(where), limit
        ),
        drive=task.drive,
        allow_code=allow_code,
    )
    check_units(request.plan, request.scene)
    for warning in request.plan.warnings:
        say(str(warning))
    if plan:
        if isinstance(controller := request.scene.drive.drive, PolicyDrive):
            say(
                f"a {controller.noun} acts: each start is moved slightly, by the run's seed, so "
                "that an unstable balance shows; --set perturbation=0 starts exactly as written"
            )
        return forecast_sweep(replace(request, allow_code=allow_code))
    if request.plan.count > CONFIRM_ABOVE and not yes:
        raise SweepFileError(
            f"the sweep has {request.plan.count:,} runs; look at it with --plan, then run it with "
            "--yes"
        )
    request = replace(
        request,
        fresh=fresh,
        retry_failed=retry_failed,
        repair=repair,
        allow_code=allow_code,
        shard=None if shard is None else parse_shard(shard),
    )
    return _run_request(
        request, _open_cluster(executor, address, request.workers if address is None else workers)
    )


def _merge_shards(
    places: "Sequence[Address | str]",
    output: "Address | str | None",
    *,
    shard: object,
    may_lack: bool,
    fresh: bool,
) -> "Store":
    from contactlab.run.merged_stores import merge_stores
    from contactlab.store.finished_store import Store

    if shard:
        raise SweepFileError("--merge joins finished shards; leave out --shard and --plan")
    if output is None:
        raise SweepFileError("--merge needs the store to write: -o STORE")
    target = opt.address_of(output)
    addresses = [opt.address_of(place) for place in places]
    if gaps := merge_stores(addresses, target, may_lack=may_lack, fresh=fresh):
        say(gaps)
    return Store.open(target)


def _find_source(
    source: str | Path | Mapping[str, object],
) -> "tuple[Path | Mapping[str, object], str, Path]":
    """Return a sweep's file or data, its name, and the folder where its relative paths start."""
    if isinstance(source, Mapping):
        return source, "sweep", Path()
    from contactlab.resources import find_sweep

    path = find_sweep(str(source))
    return path, path.stem, path.parent


def _run_request(
    request: "SweepRequest", cluster: "AbstractContextManager[Executor | None]"
) -> "Store":
    from contactlab.run.forecast import warn_of_settings
    from contactlab.run.planned_runs import RunIndex
    from contactlab.run.sweep_runner import run_sweep
    from contactlab.store.finished_store import Store

    with surroundings().watching() as watch, cluster as nodes:
        index = RunIndex(request.plan, request.scene)
        manifest = run_sweep(
            replace(request, cluster=nodes), watch.begin, watch.advance, watch.stop, index
        )
    for warning in warn_of_settings(request, index):
        say(f"warning: {warning}")
    for what, why in manifest.sweep.lacking.items():
        say(f"{what} is left empty: {why}")
    for name in manifest.advisories:
        say(f"models of this sweep meet {name}, a known fault: `--plan` says how to avoid it")
    return Store.open(request.store)


def _open_cluster(
    name: str, address: str | None, workers: int | None
) -> "AbstractContextManager[Executor | None]":
    """Return the connection to an executor, an entry point; none for this machine."""
    if name == "local":
        return nullcontext()
    from contactlab.plugins import find_extensions

    executors = find_extensions("executor")
    if name not in executors:
        raise SweepFileError(
            f"no executor '{name}'; installed are {', '.join(['local', *executors])}"
        )
    return executors[name].load()(address, workers)
