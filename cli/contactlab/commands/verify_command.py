"""`contactlab verify`: whether a store is complete and unchanged."""

from itertools import islice
from typing import Annotated

import typer

from contactlab.commands.options import FormatOption, StoreArgument, mention_plugins
from contactlab.commands.terminal import echo, print_json
from contactlab.errors import StoreError
from contactlab.printable import in_one_line


def verify(
    store: StoreArgument,
    simulate: Annotated[
        int,
        typer.Option(min=0, metavar="N", help="Simulate N runs again, drawn at random."),
    ] = 0,
    output: FormatOption = "text",
) -> None:
    """Check every file of a store against its hash, and recompute what its content gives."""
    from contactlab.run.recomputed_runs import recomputed_problems, simulated_problems, unresolved
    from contactlab.store.finished_store import Store
    from contactlab.store.verify_store import MOST_PROBLEMS, unverified
    from contactlab.store.verify_store import verify as find_problems

    problems = find_problems(store)
    opened = Store.unchecked(store)
    manifest, left = opened.manifest, unverified(opened)
    mention_plugins(store, manifest.sweep.plugins)
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
