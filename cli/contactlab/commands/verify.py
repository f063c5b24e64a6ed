"""`contactlab verify`: whether a store is sound."""

from itertools import islice
from typing import Annotated, NamedTuple

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Given, Option, command
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo, print_json
from contactlab.errors import StoreError
from contactlab.printable import in_one_line


class Soundness(NamedTuple):
    """Verdict on a store, and the extent of the check."""

    sound: bool
    problems: list[str]
    unverified: list[str]  # what could not be looked at here
    runs: int
    digest: str
    physics: str  # digest of what was computed, without clocks; empty of a store without a table


def _text(result: Soundness, given: Given) -> None:
    if not result.sound:
        for problem in result.problems:
            echo(in_one_line(problem))
        return
    from contactlab.store.finished_store import Store

    store = opt.address_of(given["store"])
    manifest = Store.unchecked(store).manifest
    left_out = " left out" if manifest.traces_left_out else ""
    echo(f"{store} is sound: {manifest.runs} runs, {manifest.traces} traces{left_out}")
    for reason in result.unverified:
        echo(f"not verified: {reason}")
    echo(f"physics {result.physics}")
    echo(f"digest {result.digest}")


def _json(result: Soundness, given: Given) -> None:
    del given
    print_json(result._asdict())


def _failure(result: Soundness, given: Given) -> StoreError | None:
    if result.sound:
        return None
    found = len(result.problems)
    count = "1 problem" if found == 1 else f"{found} problems"
    return StoreError(f"{opt.address_of(given['store'])} is not sound: {count}")


@command(
    "read",
    examples=("verify results/grasp --simulate 20",),
    formats={"text": _text, "json": _json},
    failure=_failure,
)
def verify(
    store: opt.StoreArgument,
    *,
    simulate: Annotated[int, Option("N", "Simulate N runs again, drawn at random.", least=0)] = 0,
    allow_code: opt.AllowCode = False,
) -> Soundness:
    """Check the files of a store, and recompute what they give.

    Raises:
        StoreError: there is no store to look at.
    """
    from contactlab.run.recomputed_runs import (
        recomputed_problems,
        simulated_problems,
        unplanned,
        unresolved,
    )
    from contactlab.store.finished_store import Store
    from contactlab.store.verify_store import MOST_PROBLEMS, unverified
    from contactlab.store.verify_store import verify as find_problems

    address = opt.address_of(store)
    problems = find_problems(address)
    opened = Store.unchecked(address)
    left = unverified(opened)
    if plugins := "; ".join(map(str, opened.manifest.sweep.plugins)):
        say(
            f"{address} was written with plug-ins that are not loaded: {plugins}; "
            "their values are shown as stored"
        )
    left += filter(None, (unresolved(opened), unplanned(opened)))
    if not problems and unresolved(opened) is None:
        # What is damaged need not be run, nor compiled.
        problems = list(islice(recomputed_problems(opened), MOST_PROBLEMS))
        again = simulated_problems(opened, simulate, allow_code=allow_code)
        problems += again if simulate and not problems else ()
    physics = "" if problems else opened.physics
    return Soundness(not problems, problems, left, opened.manifest.runs, opened.digest, physics)
