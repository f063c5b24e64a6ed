"""`contactlab effects`: the effects and parts that a model needs, and the time of each."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.surroundings import say, study_session
from contactlab.command_line.terminal import echo, print_report_json, print_table
from contactlab.errors import ExpectationError, SweepFileError
from contactlab.printable import shell_word, shortened, wrapped
from contactlab.rendering.amounts import format_percent

if TYPE_CHECKING:
    from contactlab.plan.task_options import TaskOptions
    from contactlab.schema.parts_report import PartEffect, PartsReport
    from contactlab.schema.study_reports import EffectFinding, EffectsReport
    from contactlab.schema.time_ratio import TimeRatio

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
        Option(None, "Runs per scenario and effect of a scene or sweep; default 6.", least=1),
    ] = None,
    max_time: opt.MaxTime = "2min",
    metric: Annotated[
        Literal["reality"] | None,
        Option(None, "Find the effects that bring runs closer to recorded runs."),
    ] = None,
    figure: opt.Figure = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "EffectsReport | PartsReport":
    """Measure the influence and the time of each effect or part.

    For a model file, each feature and part is removed alone: in the task, with gravity tilted, and
    with twice the inputs. For a scene or sweep, the smallest set of effects that keeps every result
    is searched. Results go to `results/effects/NAME` unless `output` is given.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep or a setting is wrong.
    """
    from contactlab.scene.scene_source import MODEL_SUFFIXES, is_menagerie
    from contactlab.studies.effects.ablation import find_smallest_set
    from contactlab.studies.effects.effects_request import EffectsRequest

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    asked = opt.task_of(**task)
    folder = opt.study_folder("effects", source, output)
    if is_menagerie(str(source)) or Path(str(source)).suffix in MODEL_SUFFIXES:
        for name, value in (("seeds", seeds), ("metric", metric), ("figure", figure)):
            if value is not None:
                raise SweepFileError(f"--{name} needs a scene or a sweep; leave it out for a model")
        return _of_model(str(source), opt.assigned(set), asked, max_time, folder, workers)
    count = _SEEDS if seeds is None else seeds
    request = EffectsRequest(str(source), opt.assigned(set), count, task=asked, metric=metric)
    with study_session(folder, workers, allow_code=allow_code) as session:
        report = find_smallest_set(request, session)
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
    """Remove one part of a model after the other."""
    from contactlab.commands.tune import seconds_of
    from contactlab.run.worker_pool import worker_count
    from contactlab.studies.search.model_ablation import PartsRequest, ablate_model
    from contactlab.tasks.session import Session

    request = PartsRequest(source, assign, task, seconds_of(max_time))
    return ablate_model(request, Session(folder.resolve(), worker_count(workers), notify=say))


def _print_parts(report: "PartsReport", folder: Path) -> None:
    from contactlab.studies.search.report_text import time_ratio_text

    head = (
        f"{report.model}: each feature and part removed alone, in the task, with gravity tilted by "
        f"{report.tilt:g} degrees, and with twice the controls and pushes"
    )
    echo("\n".join([*wrapped(report.task.line), *wrapped(head)]))
    shown = [part for part in report.parts if part.verdict != "unused"]
    noise_floor = report.noise_floor
    measured = [part for part in shown if part.error is not None or part.time_ratio]
    rows = [_part_row(part, report) for part in measured]
    if noise_floor:
        rows.append(("", "noise floor", "", "", "", time_ratio_text(noise_floor)))
    if rows:
        print_table(("", "removed", "verdict", "error", "worst body", "time without"), rows)
    for line in _unmeasured_lines(shown, report):
        echo("\n".join(wrapped(line)))
    unused = [part for part in report.parts if part.verdict == "unused"]
    for reason in dict.fromkeys(part.reason for part in unused):
        names = ", ".join(part.name for part in unused if part.reason == reason)
        echo("\n".join(wrapped(f"unused, by proof: {names} ({reason})")))
    if unused:
        model = shell_word(report.model)
        echo(f"next: contactlab tune {model} removes the unused parts")
    if report.timed_out:
        echo("The time limit was reached before all parts were measured; raise it with --max-time.")
    echo(f"parts.json in {folder}")


def _unmeasured_lines(shown: "Sequence[PartEffect]", report: "PartsReport") -> Iterator[str]:
    """Yield the parts that have neither an error nor a time, by verdict and kind."""
    names: dict[str, dict[str, list[str]]] = {}
    for part in shown:
        if part.error is None and part.time_ratio is None:
            kind, name, verdict, *_ = _part_row(part, report)
            names.setdefault(str(verdict), {}).setdefault(str(kind), []).append(str(name))
    for verdict, kinds in names.items():
        listed = (f"{kind}{'s' * (len(of) > 1)} {', '.join(of)}" for kind, of in kinds.items())
        yield f"{verdict}: {'; '.join(listed)}"


def _part_row(part: "PartEffect", report: "PartsReport") -> tuple[object, ...]:
    from contactlab.studies.search.report_text import time_ratio_text

    error = "" if part.error is None else format_percent(part.error)
    where = f"{part.body}, {part.phase}" if part.body else ""
    verdict: str = part.verdict
    ratio, noise_floor = part.time_ratio, report.noise_floor
    # The model as written against itself shows the noise.
    saves = bool(ratio and noise_floor and ratio.is_less(min(1.0, noise_floor.low)))
    if part.verdict == "below the tolerance" and not part.reason:
        verdict += (
            f", saves {format_percent(1 - ratio.ratio)}" if saves and ratio else ", saves nothing"
        )
    elif part.reason:
        verdict += f" ({part.reason})"
    time = "" if ratio is None else time_ratio_text(ratio)
    return part.kind, part.name, verdict, error, where, time


def _print_effects(report: "EffectsReport", folder: Path) -> None:
    echo(report.task.line)
    count = len(report.scenarios) * len(report.seeds)
    echo(f"{report.scene}: each effect changed alone, {count} runs of {report.duration:g} s")
    used = [each for each in report.effects if each.verdict != "unused"]
    header = ("effect", "base", "verdict", "time when changed", "reason")
    print_table(header, [_effect_row(each) for each in used])
    unused = [each for each in report.effects if each.verdict == "unused"]
    for reason in dict.fromkeys(each.reason for each in unused):
        names = ", ".join(each.effect for each in unused if each.reason == reason)
        echo(f"unused, by proof: {names} ({reason})")
    for each in (each for each in report.interactions if each.below_tolerance):
        echo(f"needed alone, below the tolerance together: {' and '.join(each.effects)}")
    _print_smallest_set(report, folder)
    echo(f"evidence and effects.json in {folder}")


def _effect_row(finding: "EffectFinding") -> tuple[object, ...]:
    spread = (
        f"; within the spread over seeds: {', '.join(finding.within_spread)}"
        if finding.within_spread
        else ""
    )
    state, why = "on" if finding.on else "off", finding.reason + spread
    return finding.effect, state, finding.verdict, _ratio_text(finding.time_ratio), why


def _ratio_text(ratio: "TimeRatio | None") -> str:
    return "" if ratio is None else f"x{ratio.ratio:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"


def _print_smallest_set(report: "EffectsReport", folder: Path) -> None:
    smallest, verification = report.smallest_set, report.verification
    echo(f"smallest set: {', '.join(smallest.on)}")
    if report.time_ratio is not None:
        echo(f"time of the smallest set: {_ratio_text(report.time_ratio)}")
    if verification.runs:
        held = "holds" if verification.holds else "FAILS"
        how = " as settings, and as the written model" * bool(verification.holds_as_written)
        time = _ratio_text(verification.time_ratio)
        echo(f"{held} in {verification.runs} fresh runs{how}, {time}: {verification.reason}")
    if not verification.holds:
        return
    patch = f"a patch in {folder / 'written-model'}"
    mjcf = (
        [smallest.no_patch_reason]
        if smallest.no_patch_reason
        else shortened(smallest.mjcf, 12, patch)
    )
    for title, lines in (("in the model", mjcf), ("sweep", smallest.sweep)):
        echo("\n  ".join((f"{title}:", *lines)))
