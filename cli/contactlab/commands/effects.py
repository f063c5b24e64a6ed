"""`contactlab effects`: which effects a scene needs, and what each costs."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.surroundings import say, study_session
from contactlab.command_line.terminal import echo, print_report_json, print_table
from contactlab.errors import ExpectationError, SweepFileError
from contactlab.printable import percent, shell_word, shortened, wrapped

if TYPE_CHECKING:
    from contactlab.plan.task_options import TaskOptions
    from contactlab.schema.parts_report import PartsReport, PartWorth
    from contactlab.schema.study_reports import EffectFinding, EffectsReport, Ratio

_SEEDS = 6


def _text(report: "EffectsReport | PartsReport", given: Given) -> None:
    from contactlab.schema.parts_report import PartsReport

    folder = opt.study_folder("effects", given["source"], given["output"])
    if isinstance(report, PartsReport):
        _print_parts(report, folder)
    else:
        _print_effects(report, folder)


def _failure(report: "EffectsReport | PartsReport", given: Given) -> ExpectationError | None:
    from contactlab.schema.parts_report import PartsReport

    del given
    if isinstance(report, PartsReport):
        return None
    verified = report.verification
    if verified.holds:
        return None
    return ExpectationError(f"the smallest set fails with fresh seeds: {verified.reason}")


@command(
    "examine",
    examples=("effects grasp_mug",),
    formats={"text": _text, "json": print_report_json},
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
        int | None,
        Option(None, "Of a scene or sweep: runs per scenario and effect, 6 by default.", least=1),
    ] = None,
    max_time: opt.MaxTime = "2min",
    error: Annotated[
        Literal["reality"] | None,
        Option(None, "Find the effects that recorded runs call for."),
    ] = None,
    figure: opt.Figure = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "EffectsReport | PartsReport":
    """Find what the effects and parts of a model are worth.

    Of a model file, each feature and part is left out by itself, in its task, with gravity tilted
    and by twice its inputs: share in the motion and in the time, exercised or not. Of a scene, the
    smallest set of effects that keeps every result is found. Evidence goes to
    `results/effects/NAME` unless `output` names another folder.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep or a setting is wrong.
    """
    from contactlab.scene.scene_source import MODEL_SUFFIXES, is_menagerie
    from contactlab.studies.effects.ablation import run
    from contactlab.studies.effects.effects_request import EffectsRequest

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    asked = opt.task_of(**task)
    folder = opt.study_folder("effects", source, output)
    if is_menagerie(str(source)) or Path(str(source)).suffix in MODEL_SUFFIXES:
        for name, value in (("seeds", seeds), ("error", error), ("figure", figure)):
            if value is not None:
                raise SweepFileError(f"--{name} is of scenes and sweeps; leave it out for a model")
        return _of_model(str(source), opt.assigned(set), asked, max_time, folder, workers)
    count = _SEEDS if seeds is None else seeds
    request = EffectsRequest(str(source), opt.assigned(set), count, task=asked, error=error)
    with study_session(folder, workers, allow_code=allow_code) as session:
        report = run(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.effects.effects_chart import specification

        save_figure(specification(report), Path(figure))
        say(f"drew {figure}")
    return report


def _of_model(
    source: str,
    assign: Sequence[str],
    task: "TaskOptions",
    max_time: float | str,
    folder: Path,
    workers: int | None,
) -> "PartsReport":
    """Leave out one part of a model after the other."""
    from contactlab.commands.tune import seconds_of
    from contactlab.run.worker_pool import worker_count
    from contactlab.studies.search.parts import PartsRequest, run
    from contactlab.studies.session import Session

    request = PartsRequest(source, assign, task, seconds_of(max_time))
    return run(request, Session(folder.resolve(), worker_count(workers), notify=say))


def _print_parts(report: "PartsReport", target: Path) -> None:
    from contactlab.studies.search.wording import price_text

    head = (
        f"{report.model}: each feature and part left out by itself, in its task, with gravity "
        f"tilted by {report.tilt:g} degrees, and by twice its controls and pushes"
    )
    echo("\n".join([*wrapped(report.task.line), *wrapped(head)]))
    shown = [part for part in report.parts if part.worth != "provably unused"]
    twin = report.twin
    looked_at = [part for part in shown if part.share is not None or part.price]
    rows = [_part_row(part, report) for part in looked_at]
    if twin:
        rows.append(("", "the model beside itself", "", "", "", price_text(twin)))
    if rows:
        print_table(("", "left out", "verdict", "share", "in", "time without"), rows)
    for line in _unmeasured(shown, report):
        echo("\n".join(wrapped(line)))
    unused = [part for part in report.parts if part.worth == "provably unused"]
    for reason in dict.fromkeys(part.reason for part in unused):
        names = ", ".join(part.name for part in unused if part.reason == reason)
        echo("\n".join(wrapped(f"provably unused: {names} ({reason})")))
    if unused:
        model = shell_word(report.model)
        echo(f"next: contactlab tune {model}, which leaves out what is provably unused")
    if report.ended:
        echo("the time was over before all was measured; give more with --max-time")
    echo(f"parts.json in {target}")


def _unmeasured(shown: "Sequence[PartWorth]", report: "PartsReport") -> Iterator[str]:
    """Yield the parts that have neither a share nor a time, by verdict and kind."""
    names: dict[str, dict[str, list[str]]] = {}
    for part in shown:
        if part.share is None and part.price is None:
            kind, name, verdict, *_ = _part_row(part, report)
            names.setdefault(str(verdict), {}).setdefault(str(kind), []).append(str(name))
    for verdict, kinds in names.items():
        listed = (f"{kind}{'s' * (len(of) > 1)} {', '.join(of)}" for kind, of in kinds.items())
        yield f"{verdict}: {'; '.join(listed)}"


def _part_row(part: "PartWorth", report: "PartsReport") -> tuple[object, ...]:
    from contactlab.studies.search.wording import is_faster, price_text

    share = "" if part.share is None else percent(part.share)
    where = f"{part.body}, {part.phase}" if part.body else ""
    verdict: str = part.worth
    price, twin = part.price, report.twin
    saves = bool(price and twin and is_faster(price, twin))
    if part.worth == "below the tolerance" and not part.reason:
        verdict += f", saves {percent(1 - price.ratio)}" if saves and price else ", saves nothing"
    elif part.reason:
        verdict += f" ({part.reason})"
    return part.kind, part.name, verdict, share, where, "" if price is None else price_text(price)


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
    if not verification.holds:
        return
    patch = f"a patch in {target / 'written-model'}"
    mjcf = [smallest.unwritten] if smallest.unwritten else shortened(smallest.mjcf, 12, patch)
    for title, lines in (("in the model", mjcf), ("sweep", smallest.sweep)):
        echo("\n  ".join((f"{title}:", *lines)))
