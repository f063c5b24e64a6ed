"""`contactlab effects`: which effects a scene needs, and what each costs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.surroundings import say, study_session
from contactlab.command_line.terminal import echo, print_table
from contactlab.errors import ExpectationError
from contactlab.printable import shortened

if TYPE_CHECKING:
    from contactlab.schema.study_reports import EffectFinding, EffectsReport, Ratio


def _text(report: "EffectsReport", given: Given) -> None:
    _print_effects(report, opt.study_folder("effects", given["source"], given["output"]))


def _json(report: "EffectsReport", given: Given) -> None:
    del given
    echo(report.model_dump_json(indent=2))


def _failure(report: "EffectsReport", given: Given) -> ExpectationError | None:
    del given
    verified = report.verification
    if verified.holds:
        return None
    return ExpectationError(f"the smallest set fails with fresh seeds: {verified.reason}")


@command(
    "examine",
    examples=("effects grasp_mug",),
    formats={"text": _text, "json": _json},
    failure=_failure,
)
def effects(
    source: Annotated[
        str | Path,
        Argument("SCENE|SWEEP|MODEL", "Scene, sweep file or model file.", kind=str),
    ],
    *,
    set: opt.Set = (),
    output: opt.StudyFolder = None,
    seeds: Annotated[
        int, Option(None, "Seeds, and so runs, per scenario and effect.", least=1)
    ] = 6,
    error: Annotated[
        Literal["reality"] | None,
        Option(None, "Find the effects that recorded runs call for."),
    ] = None,
    figure: opt.Figure = None,
    workers: opt.Workers = None,
    start: opt.Start = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    watch: opt.Watch = (),
    within: opt.Within = (),
    must: opt.Must = (),
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
) -> "EffectsReport":
    """Find the smallest set of effects that keeps every result.

    Settings give the base configuration. Evidence goes to `results/effects/NAME` unless `output`
    names another folder.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep or a setting is wrong.
    """
    from contactlab.studies.effects.ablation import run
    from contactlab.studies.effects.effects_request import EffectsRequest

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    task = opt.task_of(start, drive, duration, watch, within, must)
    request = EffectsRequest(str(source), opt.assigned(set), seeds, task=task, error=error)
    folder = opt.study_folder("effects", source, output)
    with study_session(folder, workers, allow_code=allow_code) as session:
        report = run(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.effects.effects_chart import specification

        save_figure(specification(report), Path(figure))
        say(f"drew {figure}")
    return report


def _print_effects(report: "EffectsReport", target: Path) -> None:
    echo(report.task.line)
    count = len(report.scenarios) * len(report.seeds)
    echo(f"{report.scene}: each effect changed alone, over {count} runs of {report.duration:g} s")
    used = [each for each in report.effects if each.need != "unused"]
    header = ("effect", "in base", "verdict", "time when changed", "why")
    print_table(header, [_effect_row(each) for each in used])
    unused = [each for each in report.effects if each.need == "unused"]
    for reason in dict.fromkeys(each.reason for each in unused):
        names = ", ".join(each.effect for each in unused if each.reason == reason)
        echo(f"provably unused: {names} ({reason})")
    for each in (each for each in report.interactions if each.free):
        echo(f"needed one by one, free together: {' and '.join(each.effects)}")
    _print_smallest_set(report, target)
    echo(f"evidence and effects.json in {target}")


def _effect_row(finding: "EffectFinding") -> tuple[object, ...]:
    spread = f"; within spread: {', '.join(finding.within_spread)}" if finding.within_spread else ""
    state, why = "on" if finding.on else "off", finding.reason + spread
    return finding.effect, state, finding.need, _ratio(finding.cost), why


def _ratio(cost: "Ratio | None") -> str:
    return "" if cost is None else f"x{cost.ratio:.2f} ({cost.low:.2f} to {cost.high:.2f})"


def _print_smallest_set(report: "EffectsReport", target: Path) -> None:
    smallest, verification = report.smallest_set, report.verification
    echo(f"smallest set: {', '.join(smallest.on)}")
    if report.saving is not None:
        echo(f"time of the smallest set: {_ratio(report.saving)}")
    if verification.runs:
        held = "holds" if verification.holds else "DOES NOT HOLD"
        how = " as settings, and as the written model" * bool(verification.pasted)
        echo(
            f"{held} in {verification.runs} fresh runs{how}, {_ratio(verification.cost)}: "
            f"{verification.reason}"
        )
    patch = f"a patch in {target / 'written-model'}"
    mjcf = [smallest.unwritten] if smallest.unwritten else shortened(smallest.mjcf, 12, patch)
    for title, lines in (("in the model", mjcf), ("sweep", smallest.sweep)):
        echo("\n  ".join((f"{title}:", *lines)))
