"""`contactlab stability`: the catalogue of hard cases, or generic checks of a model."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import cores, folder_at
from contactlab.commands.stopping import RESULTS, MujocoOption, rerun_with_mujoco, resumable
from contactlab.commands.terminal import Format, FormatOption, print_json, print_table, say
from contactlab.errors import ExpectationError

if TYPE_CHECKING:
    from contactlab.studies.stability_cases import CaseResult

_MOST_MISSES = 5
_RESULTS = RESULTS / "stability"
_GOES_ON = "runs the finished cases again and goes on with this one"


def stability(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Cases, or model files; all cases if left out."),
    ] = None,
    results: Annotated[
        Path,
        typer.Option(
            "-o", "--output", parser=folder_at, help="The folder of the stores, one a case."
        ),
    ] = _RESULTS,
    workers: Annotated[int | None, typer.Option(min=0, help="Worker processes.")] = None,
    mujoco: MujocoOption = None,
    output: FormatOption = Format.text,
) -> None:
    """Run hard cases and say what held, what failed, and whether that is what should."""
    from contactlab.commands.terminal import progress
    from contactlab.studies.stability_cases import find_cases, run_case

    rerun_with_mujoco(mujoco, None if results != _RESULTS else results)
    processes = cores() if workers is None else workers
    done: list[CaseResult] = []
    cases = find_cases(names or [])
    for number, case in enumerate(cases, 1):
        with resumable(_GOES_ON) as stop, progress() as shown:
            result = run_case(case, results, processes, shown.begin, shown.advance, stop)
        say(f"{number}/{len(cases)} {case.name}: {_verdict(result)}")
        done += [result] if result.runs else []
    if output is Format.json:
        print_json([{**asdict(each), "store": str(each.store)} for each in done])
    else:
        _print(done)
    unmet = [each.name for each in done if not each.passed]
    if unmet:
        raise ExpectationError(f"{len(unmet)} of {len(done)} cases failed: {', '.join(unmet)}")


def _verdict(result: "CaseResult") -> str:
    left_out = "; left out: " + "; ".join(result.left_out) if result.left_out else ""
    if not result.runs:
        return "skipped" + left_out
    return ("ok" if result.passed else "NOT AS EXPECTED") + left_out


def _print(done: "Sequence[CaseResult]") -> None:
    header = ("case", "runs", "as asked", "controls", "found", "oracle error", "step", "seconds")
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
