"""`contactlab effects`: which effects a scene needs, and what each costs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import cores, folder_at
from contactlab.commands.stopping import AGAIN, RESULTS, resumable
from contactlab.commands.terminal import Format, FormatOption, print_table, say
from contactlab.errors import ExpectationError

if TYPE_CHECKING:
    from contactlab.schema import EffectFinding, EffectsReport, Ratio

_REPORT = "effects.json"


def effects(  # noqa: PLR0913 - one argument an option
    source: Annotated[
        str, typer.Argument(metavar="SCENE|SWEEP|MODEL", help="A scene, a sweep file or a model.")
    ],
    assign: Annotated[
        list[str] | None, typer.Option("--set", help="Set the base configuration: cone=elliptic")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("-o", "--output", parser=folder_at, help="Where report and evidence go."),
    ] = None,
    *,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds to change effects with.")] = 6,
    figure: Annotated[Path | None, typer.Option(help="Draw it: a .png or .svg file.")] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; one for each core if left out.")
    ] = None,
    output: FormatOption = Format.text,
) -> None:
    """Change one effect at a time, and find the smallest set that keeps every result."""
    from contactlab.commands.terminal import progress
    from contactlab.studies.effects import Ablation, ask, draw
    from contactlab.tradeoff import check_figure

    if figure is not None:
        check_figure(figure)
    question = ask(source, assign or (), seeds, Path())
    target = folder or RESULTS / "effects" / question.scene.name
    with resumable(AGAIN) as stop, progress() as shown:
        processes = cores() if workers is None else workers
        shows = shown.begin, shown.advance
        report = Ablation(question, target, processes, *shows, stop=stop).report()
    _write(target / _REPORT, report)
    if figure is not None:
        draw(report, figure)
        say(f"drew {figure}")
    _tell(report, target, output)
    if not report.verification.holds:
        raise ExpectationError(f"from fresh seeds it does not hold: {report.verification.reason}")


def _tell(report: "EffectsReport", target: Path, output: Format) -> None:
    if output is Format.json:
        typer.echo(report.model_dump_json(indent=2))
    else:
        _print(report, target)


def _write(path: Path, report: "EffectsReport") -> None:
    from contactlab.store import write_error

    try:
        path.write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise write_error(path, error) from error


def _print(report: "EffectsReport", target: Path) -> None:
    count = len(report.scenarios) * len(report.seeds)
    typer.echo(
        f"{report.scene}: each effect changed alone, over {count} runs of {report.duration:g} s"
    )
    shown = [each for each in report.effects if each.need != "unused"]
    header = ("effect", "in base", "verdict", "time when changed", "why")
    print_table(header, [_row(each) for each in shown])
    unused = [each for each in report.effects if each.need == "unused"]
    for reason in dict.fromkeys(each.reason for each in unused):
        names = ", ".join(each.effect for each in unused if each.reason == reason)
        typer.echo(f"unused, by proof: {names} ({reason})")
    for each in (each for each in report.interactions if each.free):
        typer.echo(f"needed one by one, free together: {' and '.join(each.effects)}")
    _print_set(report)
    typer.echo(f"evidence and {_REPORT} in {target}")


def _row(finding: "EffectFinding") -> tuple[object, ...]:
    spread = f"; within spread: {', '.join(finding.within_spread)}" if finding.within_spread else ""
    return (
        finding.effect,
        "on" if finding.on else "off",
        finding.need,
        _ratio(finding.cost),
        finding.reason + spread,
    )


def _ratio(cost: "Ratio | None") -> str:
    return "" if cost is None else f"x{cost.ratio:.2f} ({cost.low:.2f} to {cost.high:.2f})"


def _print_set(report: "EffectsReport") -> None:
    smallest, verification = report.smallest_set, report.verification
    typer.echo(f"smallest set: {', '.join(smallest.on)}")
    if report.saving is not None:
        typer.echo(f"time of the smallest set: {_ratio(report.saving)}")
    if verification.runs:
        held = "holds" if verification.holds else "DOES NOT HOLD"
        typer.echo(
            f"{held} in {verification.runs} fresh runs, {_ratio(verification.cost)}: "
            f"{verification.reason}"
        )
    for title, lines in (("MJCF", smallest.mjcf), ("sweep", smallest.sweep)):
        typer.echo(f"{title}:")
        for line in lines:
            typer.echo(f"  {line}")
