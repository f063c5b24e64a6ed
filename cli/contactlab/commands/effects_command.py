"""`contactlab effects`: which effects a scene needs, and what each costs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands import options as opt
from contactlab.commands.stopping import study_session
from contactlab.commands.terminal import echo, print_table, say
from contactlab.errors import ExpectationError
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.effects_report import EffectFinding, EffectsReport, Ratio


def effects(
    source: Annotated[
        str, typer.Argument(metavar="SCENE|SWEEP|MODEL", help="Scene, sweep file or model file.")
    ],
    assign: opt.SetOption = None,
    folder: opt.StudyFolderOption = None,
    *,
    seeds: Annotated[
        int, typer.Option(min=1, help="Seeds, and so runs, per scenario and effect.")
    ] = 6,
    figure: opt.FigureOption = None,
    workers: opt.WorkersOption = None,
    drive: opt.DriveOption = None,
    plugin: opt.PluginOption = None,
    allow_code: opt.AllowCodeOption = False,
    output: opt.FormatOption = "text",
) -> None:
    """Change one effect at a time, and find the smallest set that keeps every result."""
    from contactlab.pareto.drawing import check_figure
    from contactlab.plan.overrides import drive_option
    from contactlab.studies.effects.ablation import run
    from contactlab.studies.effects.effects_request import EffectsRequest

    opt.load_plugins(plugin)
    if figure is not None:
        check_figure(figure)
    request = EffectsRequest(source, assign or (), seeds, drive=drive_option(drive))
    target = folder or RESULTS / "effects" / request.setup.scene.name
    with study_session(target, workers, "start over", allow_code=allow_code) as session:
        report = run(request, session)
    if figure is not None:
        from contactlab.studies.effects.effects_chart import draw

        draw(report, figure)
        say(f"drew {figure}")
    if output == "json":
        echo(report.model_dump_json(indent=2))
    else:
        _print(report, target)
    if not report.verification.holds:
        raise ExpectationError(
            f"the smallest set fails with fresh seeds: {report.verification.reason}"
        )


def _print(report: "EffectsReport", target: Path) -> None:
    count = len(report.scenarios) * len(report.seeds)
    echo(f"{report.scene}: each effect changed alone, over {count} runs of {report.duration:g} s")
    used = [each for each in report.effects if each.need != "unused"]
    header = ("effect", "in base", "verdict", "time when changed", "why")
    print_table(header, [_row(each) for each in used])
    unused = [each for each in report.effects if each.need == "unused"]
    for reason in dict.fromkeys(each.reason for each in unused):
        names = ", ".join(each.effect for each in unused if each.reason == reason)
        echo(f"provably unused: {names} ({reason})")
    for each in (each for each in report.interactions if each.free):
        echo(f"needed one by one, free together: {' and '.join(each.effects)}")
    _print_set(report)
    echo(f"evidence and effects.json in {target}")


def _row(finding: "EffectFinding") -> tuple[object, ...]:
    spread = f"; within spread: {', '.join(finding.within_spread)}" if finding.within_spread else ""
    state, why = "on" if finding.on else "off", finding.reason + spread
    return finding.effect, state, finding.need, _ratio(finding.cost), why


def _ratio(cost: "Ratio | None") -> str:
    return "" if cost is None else f"x{cost.ratio:.2f} ({cost.low:.2f} to {cost.high:.2f})"


def _print_set(report: "EffectsReport") -> None:
    smallest, verification = report.smallest_set, report.verification
    echo(f"smallest set: {', '.join(smallest.on)}")
    if report.saving is not None:
        echo(f"time of the smallest set: {_ratio(report.saving)}")
    if verification.runs:
        held = "holds" if verification.holds else "DOES NOT HOLD"
        echo(
            f"{held} in {verification.runs} fresh runs, {_ratio(verification.cost)}: "
            f"{verification.reason}"
        )
    for title, lines in (("MJCF", smallest.mjcf), ("sweep", smallest.sweep)):
        echo("\n  ".join((f"{title}:", *lines)))
