"""`contactlab replay`: a stored run, simulated again."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Given, command, flag
from contactlab.command_line.terminal import echo, print_json
from contactlab.errors import ContactlabError, ExpectationError, StoreError

if TYPE_CHECKING:
    from contactlab.run.stored_runs import ReplayResult


def _text(result: "ReplayResult | None", given: Given) -> None:
    del given
    for line in _replay_lines(result) if result else ():
        echo(line)


def _json(result: "ReplayResult | None", given: Given) -> None:
    del given
    if result is not None:
        print_json(asdict(result))


def _failure(result: "ReplayResult | None", given: Given) -> ContactlabError | None:
    del given
    if result is None or (result.equal and result.damage is None):
        return None
    if result.equal:
        return StoreError(f"the stored trace is damaged: {result.damage}")
    return ExpectationError("the trajectory differs from the stored one")


@command(
    "read",
    examples=("replay results/grasp 3ead3115", "replay results/grasp 3ead3115 --view"),
    formats={"text": _text, "json": _json},
    failure=_failure,
)
def replay(
    store: opt.StoreArgument,
    run: opt.Run,
    *,
    view: Annotated[bool, flag("Open it in MuJoCo's viewer instead.")] = False,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "ReplayResult | None":
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


def _replay_lines(result: "ReplayResult") -> Iterator[str]:
    if result.equal:
        yield f"run {result.run_id}: bitwise equal ({result.hash})"
        return
    if result.stored_hash is None:
        yield f"run {result.run_id}: no trajectory was stored"
        return
    yield f"run {result.run_id}: differs"
    yield f"  stored {result.stored_hash}"
    yield f"  now    {result.hash}"
    if result.step is not None:
        amount = "" if result.difference is None else f" by {result.difference:.3g}"
        yield f"  first after step {result.step}{amount}"
    if result.damage is not None:
        yield f"  its stored trace is damaged: {result.damage}"
    yield f"  stored with {result.stored_engine}"
