"""`contactlab sweep`: run a declared sweep and write a store of evidence."""

from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import (
    METAVAR,
    Address,
    AddressOption,
    ExecutorName,
    ExecutorOption,
    check_executor,
    cores,
    executing,
    store_at,
)
from contactlab.commands.stopping import (
    RESULTS,
    MujocoOption,
    rerun_with_mujoco,
    resumable,
    sweep_path,
)
from contactlab.commands.terminal import Format, FormatOption, say
from contactlab.errors import ExpectationError, RunFailedError, SweepFileError

if TYPE_CHECKING:
    from contactlab.schema import StoreManifest


def sweep(  # noqa: PLR0913 - one argument an option
    name: Annotated[str, typer.Argument(metavar="SWEEP", help="A sweep file or a shipped sweep.")],
    store: Annotated[
        Address | None,
        typer.Option(
            "-o",
            "--output",
            parser=store_at,
            metavar=METAVAR,
            help="The store: a folder or s3://BUCKET/PREFIX; results/SWEEP if left out.",
        ),
    ] = None,
    assign: Annotated[
        list[str] | None, typer.Option("--set", help="Replace an axis or a key: timestep=1e-3,2e-3")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Keep runs with a value: cone=elliptic")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Keep the first so many runs.")] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; one for each core if left out.")
    ] = None,
    *,
    executor: ExecutorOption = ExecutorName.local,
    address: AddressOption = None,
    mujoco: MujocoOption = None,
    plan: Annotated[bool, typer.Option("--plan", help="Say what would run; run nothing.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Run more than 100,000 runs.")] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Replace a store that is there.")] = False,
    retry_failed: Annotated[
        bool,
        typer.Option("--retry-failed", help="Run again what crashed, timed out or erred."),
    ] = False,
    output: FormatOption = Format.text,
) -> None:
    """Run a sweep into a store; the same command resumes one that was interrupted."""
    from contactlab.commands.show_command import print_plan, print_summary
    from contactlab.plan import Overrides
    from contactlab.run import forecast, read_request, run_sweep

    check_executor(executor, address, workers)
    path = sweep_path(name)
    rerun_with_mujoco(mujoco, None if store else RESULTS / path.stem)
    target = store or RESULTS / path.stem
    ask = read_request(
        path,
        path.stem,
        target,
        folder=path.parent,
        workers=cores() if workers is None else workers,
        overrides=Overrides(assign or (), only or (), limit),
        fresh=fresh,
        retry_failed=retry_failed,
    )
    for warning in ask.plan.warnings:
        say(str(warning))
    if plan:
        print_plan(ask.plan, forecast(ask.plan, ask.scene, ask.workers), output)
        return
    _confirm(ask.plan.count, yes=yes)
    from contactlab.commands.terminal import progress

    placed = executing(ask, executor, address, workers)
    with resumable() as stop, progress() as shown, placed as ask:
        manifest = run_sweep(ask, shown.begin, shown.advance, stop)
    for what, why in manifest.sweep.lacking.items():
        say(f"{what} is left empty: {why}")
    print_summary(target, manifest, output)
    _fail_on(manifest)


def _confirm(count: int, *, yes: bool) -> None:
    from contactlab.plan import CONFIRM_ABOVE

    if count > CONFIRM_ABOVE and not yes:
        raise SweepFileError(
            f"the sweep has {count:,} runs; look at it with --plan, then run it with --yes"
        )


def _fail_on(manifest: "StoreManifest") -> None:
    lost = manifest.statuses.get("crashed", 0) + manifest.statuses.get("timeout", 0)
    if lost:
        raise RunFailedError(f"{lost} of {manifest.runs} runs crashed or ran out of time")
    unmet = manifest.expectations.get("unmet", 0)
    if unmet:
        raise ExpectationError(f"{unmet} of {manifest.runs} runs are not as the sweep expects")
