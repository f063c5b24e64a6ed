"""`contactlab replay`: simulate a stored run again from its store alone."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import StoreArgument
from contactlab.commands.terminal import Format, FormatOption, print_json
from contactlab.errors import ExpectationError

if TYPE_CHECKING:
    from contactlab.run import ReplayResult


def replay(
    store: StoreArgument,
    run: Annotated[str, typer.Argument(help="The run's id, or the start of it.")],
    *,
    view: Annotated[bool, typer.Option("--view", help="Open MuJoCo's viewer on it.")] = False,
    output: FormatOption = Format.text,
) -> None:
    """Run a stored run again and say whether every state is equal, bit for bit."""
    from contactlab.run import prepare_replay
    from contactlab.run import replay as run_again
    from contactlab.store import Store

    opened = Store.open(store)
    if view:
        from contactlab.view import view as open_viewer

        start = prepare_replay(opened, run)
        open_viewer(start.prepared.model, start.state)
        return
    result = run_again(opened, run)
    if output is Format.json:
        print_json(asdict(result))
    else:
        typer.echo(_verdict(result))
    if not result.equal:
        raise ExpectationError("the trajectory is not the stored one")


def _verdict(result: "ReplayResult") -> str:
    if result.equal:
        return f"run {result.run_id}: bitwise equal ({result.hash})"
    if result.stored_hash is None:
        return f"run {result.run_id}: no trajectory was stored"
    lines = [
        f"run {result.run_id}: differs",
        f"  stored {result.stored_hash}",
        f"  now    {result.hash}",
    ]
    if result.step is not None:
        amount = "" if result.difference is None else f" by {result.difference:.3g}"
        lines.append(f"  first after step {result.step}{amount}")
    lines.append(f"  stored with {result.stored_engine}")
    return "\n".join(lines)
