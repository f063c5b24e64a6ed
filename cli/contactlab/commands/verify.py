"""`contactlab verify`: check that a store is intact, or that a run repeats to the bit."""

from itertools import islice
from typing import TYPE_CHECKING, Annotated, Any

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command
from contactlab.command_line.report_formats import formats_by_type, report_formats
from contactlab.command_line.surroundings import say
from contactlab.errors import CommandLineError, ContactlabError, ExpectationError, StoreError
from contactlab.printable import in_one_line

if TYPE_CHECKING:
    from contactlab.schema.store_reports import RunReplay, StoreVerification


def _find_failure(
    result: "StoreVerification | RunReplay", arguments: Arguments
) -> ContactlabError | None:
    from contactlab.schema.store_reports import RunReplay

    del arguments
    if isinstance(result, RunReplay):
        if not result.equal:
            return ExpectationError("the trajectory differs from the stored one")
        return (
            StoreError(f"the stored trace is damaged: {result.damage}") if result.damage else None
        )
    if result.sound:
        return None
    problem_count = len(result.problems)
    count = "1 problem" if problem_count == 1 else f"{problem_count} problems"
    return StoreError(f"{result.store} is not sound: {count}")


@command(
    "read",
    keeps="nothing",
    examples=("verify results/grasp --simulate 20", "verify results/grasp 3ead3115"),
    formats=formats_by_type({"StoreVerification": report_formats(), "RunReplay": report_formats()}),
    failure=_find_failure,
)
def verify(
    store: opt.StoreArgument,
    run: Annotated[
        str | None, Argument("RUN", "Run to simulate again; the whole store by default.")
    ] = None,
    *,
    simulate: Annotated[int, Option("N", "Simulate N runs again, drawn at random.", least=0)] = 0,
    sample: Annotated[
        str | None, Option("SHARE", "Check a random sample of this size: 1%.")
    ] = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "StoreVerification | Any":  # noqa: ANN401 - so that a caller without a run has a verification
    """Check the files and results of a store, or repeat a run of it.

    With `sample`, records and traces are checked for this share of the runs, drawn again each time.
    Files, counts and columns are checked completely. For a run, the result has the first difference
    from its stored trajectory, and any damage of its trace.

    Raises:
        CommandLineError: the sample is not a share, or belongs to a whole store.
        StoreError: there is no store or run, or it cannot be simulated here.
    """
    from contactlab.plugins import loaded_plugins
    from contactlab.schema.store_reports import StoreVerification
    from contactlab.store.finished_store import Store
    from contactlab.store.verify_store import MOST_PROBLEMS, find_problems, unverifiable_parts

    address = opt.address_of(store)
    opt.load_plugins(plugin)
    if run is not None:
        from contactlab.run.stored_runs import replay_run

        if simulate or sample is not None:
            raise CommandLineError("--simulate and --sample check a whole store; leave out the run")
        return replay_run(Store.open(address), run, allow_code=allow_code)
    opened = Store.open_unchecked(address)
    chosen = None
    if sample is not None:
        import numpy as np

        runs = opened.columns.runs
        chosen = np.zeros(runs, bool)
        count = int(np.ceil(_read_share(sample) * runs))
        chosen[np.random.default_rng().permutation(runs)[:count]] = True
    problems = find_problems(address, chosen=chosen)
    # Later, so that the engine and the reader of the whole table are not in memory at once.
    from contactlab.run.recomputed_runs import (
        Resimulation,
        recomputed_problems,
        simulate_again,
        uncompared_parts,
        why_ids_unverifiable,
        why_plan_unverifiable,
    )

    unverified = unverifiable_parts(opened)
    if chosen is not None:
        drawn_count = int(chosen.sum())
        unverified.append(
            f"records and traces of {len(chosen) - drawn_count:,} runs: {drawn_count:,} were drawn"
        )
    loaded_hashes = {each.sha256 for each in loaded_plugins()}
    if plugins := "; ".join(
        str(each) for each in opened.manifest.sweep.plugins if each.sha256 not in loaded_hashes
    ):
        say(
            f"{address} was written with plug-ins that are not loaded: {plugins}; "
            "their values are shown as stored"
        )
    unverified += filter(None, (why_ids_unverifiable(opened), why_plan_unverifiable(opened)))
    if not problems and why_ids_unverifiable(opened) is None:
        # A damaged store need not be run or compiled.
        problems = list(islice(recomputed_problems(opened, chosen), MOST_PROBLEMS))
    again = Resimulation(min(simulate, opened.manifest.runs))
    if simulate and not problems:
        again = simulate_again(opened, simulate, allow_code=allow_code)
        problems += again.problems[:MOST_PROBLEMS]
        unverified += uncompared_parts(opened)
    physics = "" if problems else opened.physics
    return StoreVerification(
        store=str(address),
        sound=not problems,
        problems=tuple(map(in_one_line, problems)),
        unverified=tuple(unverified),
        runs=opened.manifest.runs,
        simulated=again.simulated,
        simulation_asked=again.requested_runs,
        traces=opened.manifest.traces,
        traces_left_out=opened.manifest.traces_left_out,
        digest=opened.digest,
        physics=physics,
    )


def _read_share(text: str) -> float:
    """Read a share, such as 1% or 0.01; raise CommandLineError for other text."""
    number = text.removesuffix("%").strip()
    try:
        share = float(number) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = 0.0
    if not 0 < share <= 1:
        raise CommandLineError(f"--sample {text}: write a share above 0 and up to 100%, such as 1%")
    return share
