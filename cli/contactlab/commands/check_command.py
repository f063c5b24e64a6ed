"""`contactlab check`: practice's checks of one model, before it is trusted."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import cores, folder_at
from contactlab.commands.stopping import AGAIN, resumable
from contactlab.commands.terminal import Format, FormatOption, print_table
from contactlab.errors import ExpectationError

if TYPE_CHECKING:
    from contactlab.schema import Change, CheckReport, CheckResult, TaskKind

RESULTS = Path("results/check")


class For(StrEnum):
    """The kind of task that a model is for."""

    auto = "auto"
    manipulation = "manipulation"
    locomotion = "locomotion"


def check(  # noqa: PLR0913 - one argument an option
    model: Annotated[
        str, typer.Argument(help="A scene, a folder, an .xml or .urdf file, or menagerie:ROBOT.")
    ],
    assign: Annotated[
        list[str] | None, typer.Option("--set", help="Check it with a setting: impratio=10")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="One check by name; may be repeated.")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("-o", "--output", parser=folder_at, help="Where the evidence goes."),
    ] = None,
    *,
    keyframe: Annotated[
        str | None,
        typer.Option(help="Where runs start, as --set keyframe=; qpos0 is the model's own start."),
    ] = None,
    kind: Annotated[For, typer.Option(help="What the timestep has to suit.")] = For.auto,
    workers: Annotated[int | None, typer.Option(min=0, help="Worker processes.")] = None,
    output: FormatOption = Format.text,
) -> None:
    """Check a model: timestep, free motion, flat contact, hold, repeat, shells."""
    from contactlab.commands.terminal import progress
    from contactlab.studies.check import CheckRequest, check_model

    ask = CheckRequest(
        model=model,
        folder=folder or RESULTS / _name(model),
        assign=[*(assign or ()), *([f"keyframe={keyframe}"] if keyframe else [])],
        only=only or (),
        kind=_task(kind),
        workers=cores() if workers is None else workers,
    )
    with resumable(AGAIN) as stop, progress() as shown:
        report = check_model(ask, shown.begin, shown.advance, stop)
    if output is Format.json:
        typer.echo(report.model_dump_json(indent=2))
    else:
        _print(report, ask.folder)
    if failed := [each.name for each in report.checks if each.verdict == "fail"]:
        raise ExpectationError(f"{model} fails {', '.join(failed)}")


def _task(kind: For) -> "TaskKind | None":
    return None if kind is For.auto else kind.value


def _name(model: str) -> str:
    """Return a folder's name for a model: its file or folder, or what follows the last colon."""
    return Path(model.rpartition(":")[2].rstrip("/")).stem or "model"


def _print(report: "CheckReport", folder: Path) -> None:
    start = f"keyframe {report.keyframe}" if report.keyframe else "its own start"
    typer.echo(f"{report.scene}, from {start}, for {report.kind} ({report.kind_reason})")
    print_table(
        ("check", "verdict", "what came out"),
        [(each.name, each.verdict, each.reason) for each in report.checks],
    )
    for each in report.checks:
        _print_advice(each)
    verdict = "passes" if report.passed else "fails"
    typer.echo(f"{report.model} {verdict}; all numbers and evidence are in {folder / 'check.md'}")


def _print_advice(check: "CheckResult") -> None:
    for note in check.notes:
        typer.echo(f"{check.name}: {note}")
    for change in check.changes:
        _print_change(check.name, change)


def _print_change(name: str, change: "Change") -> None:
    heads = {True: "cures it", False: "does not cure it", None: "to change"}
    typer.echo(f"{name}, {heads[change.cures]}: {change.shown}")
    for line in change.lines:
        typer.echo(f"    {line}")
