"""`contactlab stability`: the catalogue of hard cases, or generic checks of a model."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import (
    RESULTS,
    Format,
    FormatOption,
    MujocoOption,
    StudyFolderOption,
    WorkersOption,
    rerun_with_mujoco,
    worker_count,
)
from contactlab.commands.stopping import resumable
from contactlab.commands.terminal import print_json, print_table, progress_display, say
from contactlab.errors import ExpectationError

if TYPE_CHECKING:
    from contactlab.studies.stability_cases import CaseResult

_MOST_MISSES = 5
_THEN = "repeat the finished cases and resume this one"


def stability(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Cases or model files; all cases by default."),
    ] = None,
    folder: StudyFolderOption = None,
    workers: WorkersOption = None,
    mujoco: MujocoOption = None,
    output: FormatOption = Format.text,
) -> None:
    """Run hard cases; report what held, what failed, and whether that is as expected."""
    from contactlab.studies.stability_cases import find_cases, run_case

    target = folder or RESULTS / "stability"
    rerun_with_mujoco(mujoco, None if folder else target)
    done: list[CaseResult] = []
    cases = find_cases(names or [])
    for number, case in enumerate(cases, 1):
        with resumable(_THEN) as stop, progress_display() as display:
            shows = display.begin, display.advance
            result = run_case(case, target, worker_count(workers), *shows, stop)
        say(f"{number}/{len(cases)} {case.name}: {_verdict(result)}")
        done += [result] if result.runs else []
    if output is Format.json:
        print_json([{**asdict(each), "store": str(each.store)} for each in done])
    else:
        _print(done)
    if failed := [each.name for each in done if not each.passed]:
        raise ExpectationError(f"{len(failed)} of {len(done)} cases failed: {', '.join(failed)}")


def _verdict(result: "CaseResult") -> str:
    left_out = "; left out: " + "; ".join(result.left_out) if result.left_out else ""
    if not result.runs:
        return "skipped" + left_out
    return ("ok" if result.passed else "NOT AS EXPECTED") + left_out


def _print(done: "Sequence[CaseResult]") -> None:
    header = (
        "case",
        "runs",
        "as expected",
        "controls",
        "labels",
        "oracle error",
        "step",
        "seconds",
    )
    print_table(
        header,
        [
            (
                each.name,
                each.runs,
                f"{each.met}/{each.asked}",
                each.controls,
                ", ".join(f"{label} {count}" for label, count in each.labels.items()),
                each.error,
                each.step,
                each.seconds,
            )
            for each in done
        ],
    )
    for each in done:
        for miss in each.misses[:_MOST_MISSES]:
            typer.echo(f"{each.name} {miss}")
        if len(each.misses) > _MOST_MISSES:
            typer.echo(f"{each.name} and {len(each.misses) - _MOST_MISSES} more in {each.store}")
    seconds = sum(each.seconds for each in done)
    met = sum(each.passed for each in done)
    typer.echo(f"{met} of {len(done)} cases are as expected, in {seconds:.0f} s")
