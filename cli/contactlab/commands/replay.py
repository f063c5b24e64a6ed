"""`contactlab replay`: a stored run, simulated again."""

from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Given, command, flag
from contactlab.command_line.report_formats import formats_by_type, report_formats
from contactlab.errors import ContactlabError, ExpectationError, StoreError

if TYPE_CHECKING:
    from contactlab.schema.store_reports import RunReplay


def _print_nothing(result: None, given: Given) -> None:
    # A viewer was closed.
    del result, given


def _failure(result: "RunReplay | None", given: Given) -> ContactlabError | None:
    del given
    if result is None or (result.equal and result.damage is None):
        return None
    if result.equal:
        return StoreError(f"the stored trace is damaged: {result.damage}")
    return ExpectationError("the trajectory differs from the stored one")


@command(
    "read",
    examples=("replay results/grasp 3ead3115", "replay results/grasp 3ead3115 --view"),
    formats=formats_by_type(
        {"RunReplay": report_formats(), "NoneType": dict.fromkeys(report_formats(), _print_nothing)}
    ),
    failure=_failure,
)
def replay(
    store: opt.StoreArgument,
    run: opt.Run,
    *,
    view: Annotated[bool, flag("Open it in MuJoCo's viewer instead.")] = False,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "RunReplay | None":
    """Simulate a stored run again; check that all bits are equal.

    The result has the first difference, and whether the stored trace is damaged. With `view` the
    result is None, once the viewer is closed.

    Raises:
        StoreError: there is no such store or run, or it cannot be simulated here.
    """
    from contactlab.run.stored_runs import prepare_replay
    from contactlab.run.stored_runs import replay_run as run_again
    from contactlab.store.finished_store import Store

    opt.load_plugins(plugin)
    opened = Store.open(opt.address_of(store))
    if view:
        from contactlab.plugins import extensions

        start = prepare_replay(opened, run)
        extensions("viewer")["window"].load()(start.prepared.model, start.runs.starts)
        return None
    return run_again(opened, run, allow_code=allow_code)
