"""`contactlab replay`: simulate a stored run again from its store alone."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_json
from contactlab.errors import ExpectationError

if TYPE_CHECKING:
    from contactlab.run.stored_runs import ReplayResult


def replay(
    store: opt.StoreArgument,
    run: opt.RunArgument,
    *,
    view: Annotated[
        bool, typer.Option("--view", help="Open it in MuJoCo's viewer instead.")
    ] = False,
    plugin: opt.PluginOption = None,
    output: opt.FormatOption = "text",
) -> None:
    """Simulate a stored run again and check that every state is bitwise equal."""
    from contactlab.run.stored_runs import prepare_replay
    from contactlab.run.stored_runs import replay as run_again
    from contactlab.store.finished_store import Store

    opt.load_plugins(plugin)
    opened = Store.open(store)
    if view:
        from contactlab.view.live_viewer import open_viewer

        start = prepare_replay(opened, run)
        open_viewer(start.prepared.model, start.runs.starts)
        return
    result = run_again(opened, run)
    if output == "json":
        print_json(asdict(result))
    else:
        for line in _lines(result):
            echo(line)
    if not result.equal:
        raise ExpectationError("the trajectory is not the stored one")


def _lines(result: "ReplayResult") -> Iterator[str]:
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
    yield f"  stored with {result.stored_engine}"
