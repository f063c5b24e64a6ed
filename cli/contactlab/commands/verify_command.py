"""`contactlab verify` and `replay`: whether a store is sound, and whether its runs repeat."""

from collections.abc import Iterator
from dataclasses import asdict
from itertools import islice
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_json
from contactlab.errors import ExpectationError, StoreError
from contactlab.printable import in_one_line

if TYPE_CHECKING:
    from contactlab.run.stored_runs import ReplayResult


def verify(
    store: opt.StoreArgument,
    simulate: Annotated[
        int, typer.Option(min=0, metavar="N", help="Simulate N runs again, drawn at random.")
    ] = 0,
    output: opt.FormatOption = "text",
) -> None:
    """Check every file of a store against its hash, and recompute what its content gives."""
    from contactlab.run.recomputed_runs import recomputed_problems, simulated_problems, unresolved
    from contactlab.store.finished_store import Store
    from contactlab.store.verify_store import MOST_PROBLEMS, unverified
    from contactlab.store.verify_store import verify as find_problems

    problems = find_problems(store)
    opened = Store.unchecked(store)
    manifest, left = opened.manifest, unverified(opened)
    opt.mention_plugins(store, manifest.sweep.plugins)
    if why := unresolved(opened):
        left.append(why)
    elif not problems:
        # What is damaged need not be run, nor compiled.
        problems = list(islice(recomputed_problems(opened), MOST_PROBLEMS))
        problems += simulated_problems(opened, simulate) if simulate and not problems else ()
    if output == "json":
        print_json(
            {
                "sound": not problems,
                "problems": problems,
                "unverified": left,
                "runs": manifest.runs,
                "digest": opened.digest,
            }
        )
    elif not problems:
        left_out = " left out" if manifest.traces_left_out else ""
        echo(f"{store} is sound: {manifest.runs} runs, {manifest.traces} traces{left_out}")
        for each in left:
            echo(f"not verified: {each}")
        echo(f"digest {opened.digest}")
    else:
        for problem in problems:
            echo(in_one_line(problem))
    if problems:
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        raise StoreError(f"{store} is not sound: {count}")


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
