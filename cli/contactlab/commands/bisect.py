"""`contactlab bisect`: the release of MuJoCo that changed an outcome."""

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Option, command
from contactlab.command_line.judgements import policy_of
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say
from contactlab.commands.lock import sweep_words
from contactlab.errors import ExpectationError

if TYPE_CHECKING:
    from contactlab.schema.store_reports import Bisection


@command(
    "gate",
    keeps="finished runs",
    examples=(
        "bisect tower.yaml --good 3.11.0 --bad 4.0.0",
        "bisect tests/test_grasp.py::test_held --good 3.11.0 --bad 4.0.0",
    ),
    codes="0 found, 1 both ends agree, 2 bad input, 130 interrupted: run it again to resume",
    formats=report_formats(),
)
def bisect(
    source: Annotated[
        str, Argument("SWEEP|TEST", "Sweep, or a test of pytest: tests/test_a.py::test_b.")
    ],
    *,
    good: Annotated[str, Option("VERSION", "Release that gives the old outcome.")],
    bad: Annotated[str, Option("VERSION", "Release that gives the new outcome.")],
    question: Annotated[
        Sequence[str],
        Option(
            "CHECK",
            "Look at this check of compare: 'slip_distance unchanged'; may be repeated.",
            kind=list[str],
        ),
    ] = (),
    versions: Annotated[
        str | Sequence[str],
        Option("A,B,...", "Releases to try; by default all that pip finds.", kind=str),
    ] = (),
    policy: opt.Policy = None,
    set: opt.Set = (),
    workers: opt.Workers = None,
    output: Annotated[
        str | Path | None,
        Option("FOLDER", "Folder for the results of each release.", kind=Path, short="-o"),
    ] = None,
    allow_code: opt.AllowCode = False,
) -> "Bisection":
    """Find the release of MuJoCo that changed an outcome.

    Raises:
        ExpectationError: both ends give the same.
        EngineError: a release cannot be installed.
    """
    from contactlab.resources import find_sweep
    from contactlab.schema.store_reports import Bisection
    from contactlab.studies.lock import bisection
    from contactlab.studies.lock.versions import find_releases, run_sweep, run_test

    if "::" not in source:
        find_sweep(source)  # before a release is set up
    all_releases = find_releases(
        good, bad, versions.split(",") if isinstance(versions, str) else versions
    )
    is_test = "::" in source
    name = source.rpartition("::")[2] if is_test else Path(source).stem
    place = Path("results", "bisect", name) if output is None else Path(output)
    sweep_options = tuple(sweep_words(opt.write_assignments(set), workers, allow_code=allow_code))
    subject = bisection.SweepOutcomes(
        place,
        cache(partial(run_sweep, source, sweep_options=sweep_options, notify=say)),
        policy_of(policy),
        question,
    )

    def passes(version: str) -> bool:
        run = partial(run_test, source, place / version, version, say)
        return bisection.remember_outcome(source, place / version, run)

    if is_test:
        if passes(good) == passes(bad):
            raise ExpectationError(
                f"{source}: results are the same in {good} and {bad}, so there is no change to "
                f"find; see {place}"
            )
        change = bisection.find_change(
            all_releases, lambda version: passes(version) != passes(good), say
        )
    else:
        subject.begin(good, bad)
        change = bisection.find_change(all_releases, subject.differs, say)
    comparison = None if is_test else subject.report_change(change)
    return Bisection(**dict(change), comparison=comparison, folder=place)
