"""Commands that run studies: `check`, `effects` and `fit` of a model, `stability` of hard cases."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import (
    echo,
    echo_commands,
    print_json,
    print_table,
    say,
    study_session,
)
from contactlab.errors import ExpectationError
from contactlab.printable import shortened
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.check_report import CheckReport, StabilityResult
    from contactlab.schema.study_reports import EffectFinding, EffectsReport, Ratio

CheckFormat = Literal["text", "json", "junit", "github"]


def check(
    model: str = typer.Argument(
        ..., help="Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT."
    ),
    assign: list[str] | None = opt.SET,
    only: list[str] | None = opt.option("CHECK", "Make only this check; may be repeated."),
    folder: Path | None = opt.STUDY_FOLDER,
    *,
    keyframe: str | None = opt.option(
        "NAME", "Keyframe to start from; qpos0 is the model's default pose."
    ),
    kind: Literal["auto", "manipulation", "locomotion"] = typer.Option(
        "auto", help="Task that the timestep has to suit."
    ),
    drive: str | None = opt.DRIVE,
    limit: list[str] | None = opt.option(
        "METRIC=VALUE", "Replace a limit: slip=1e-3; may be repeated."
    ),
    accept: Path | None = opt.option("FILE", "File of findings that are accepted, with reasons."),
    remedies: bool = typer.Option(
        True, help="Look for changes that help, by running the model with them."
    ),
    workers: int | None = opt.WORKERS,
    plugin: list[Path] | None = opt.PLUGIN,
    allow_code: bool = opt.ALLOW_CODE,
    output: CheckFormat = opt.FORMAT,
) -> None:
    """Check a model; exit with 1 if there is an error that is not accepted."""
    from contactlab.plan.overrides import drive_option
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.comparison import Acceptances
    from contactlab.studies.check.model_check import CheckRequest, run
    from contactlab.studies.session import model_name

    opt.load_plugins(plugin)
    request = CheckRequest(
        model=model,
        assign=[*(assign or ()), *([f"keyframe={keyframe}"] if keyframe else [])],
        only=only or (),
        kind=None if kind == "auto" else kind,
        drive=drive_option(drive),
        limits=dict(opt.read_limit(text) for text in limit or ()),
        accepted=read_yaml_as(accept, Acceptances).accept if accept else (),
        remedies=remedies,
    )
    target = folder or RESULTS / "check" / model_name(model)
    with study_session(target, workers, "start over", allow_code=allow_code) as session:
        report = run(request, session)
    _print_check(report, target, output)
    if failed := [each.name for each in report.findings if each.outcome == "failed"]:
        raise ExpectationError(f"{model} fails {', '.join(failed)}")


def _print_check(report: "CheckReport", folder: Path, output: CheckFormat) -> None:
    from contactlab.ci_output import annotations, junit, junit_case

    title = f"contactlab check {report.scene}"
    match output:
        case "text":
            _print_findings(report, folder)
        case "json":
            echo(report.model_dump_json(indent=2))
        case "junit":
            cases = [
                junit_case(each, (report.scene, each.check), each.severity)
                for each in report.findings
            ]
            echo(junit(title, cases).rstrip("\n"))
        case "github":
            errors, warnings = (
                [each.full_message for each in report.findings if each.outcome == outcome]
                for outcome in ("failed", "warned")
            )
            echo_commands(annotations(title, errors, warnings).rstrip("\n"))


def _print_findings(report: "CheckReport", folder: Path) -> None:
    from contactlab.studies.check import check_results

    echo(f"{report.scene}, {check_results.conditions(report)}")
    print_table(("", "finding", "result"), list(check_results.summary_rows(report)))
    for each in report.checks:
        for note in shortened(each.notes, 4, "check.md"):
            echo(f"{each.name}: {note}")
    for note in report.notes:
        echo(note)
    if report.remedies:
        echo(check_results.REMEDIES)
    for number, remedy in enumerate(report.remedies, 1):
        echo("\n".join(check_results.remedy_lines(number, remedy)))
    echo(check_results.STABILITY.format(model=report.model))
    verdict = "passes" if report.passed else "fails"
    echo(f"{report.model} {verdict}; all numbers and evidence are in {folder / 'check.md'}")


def effects(
    source: str = typer.Argument(
        ..., metavar="SCENE|SWEEP|MODEL", help="Scene, sweep file or model file."
    ),
    assign: list[str] | None = opt.SET,
    folder: Path | None = opt.STUDY_FOLDER,
    *,
    seeds: int = typer.Option(6, min=1, help="Seeds, and so runs, per scenario and effect."),
    error: Literal["reality"] | None = typer.Option(
        None, help="Find the effects that recorded runs call for."
    ),
    figure: Path | None = opt.FIGURE,
    workers: int | None = opt.WORKERS,
    drive: str | None = opt.DRIVE,
    plugin: list[Path] | None = opt.PLUGIN,
    allow_code: bool = opt.ALLOW_CODE,
    output: opt.Format = opt.FORMAT,
) -> None:
    """Change one effect at a time, and find the smallest set that keeps every result."""
    from contactlab.plan.overrides import drive_option
    from contactlab.studies.effects.ablation import run
    from contactlab.studies.effects.effects_request import EffectsRequest

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    drive_of = drive_option(drive)
    request = EffectsRequest(source, assign or (), seeds, drive=drive_of, error=error)
    target = folder or RESULTS / "effects" / request.setup.scene.name
    with study_session(target, workers, allow_code=allow_code) as session:
        report = run(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.effects.effects_chart import specification

        save_figure(specification(report), figure)
        say(f"drew {figure}")
    if output == "json":
        echo(report.model_dump_json(indent=2))
    else:
        _print_effects(report, target)
    verified = report.verification
    if not verified.holds:
        raise ExpectationError(f"the smallest set fails with fresh seeds: {verified.reason}")


def _print_effects(report: "EffectsReport", target: Path) -> None:
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


def stability(
    names: list[str] | None = typer.Argument(
        None, metavar="NAME", help="Cases or model files; all cases by default."
    ),
    folder: Path | None = opt.STUDY_FOLDER,
    workers: int | None = opt.WORKERS,
    mujoco: str | None = opt.MUJOCO,
    drive: str | None = opt.DRIVE,
    duration: float | None = opt.option("SECONDS", "Simulated time of a model."),
    assign: list[str] | None = opt.SET,
    threshold: list[str] | None = opt.option(
        "NAME=VALUE", "Replace a model's threshold: penetration_steady=1e-3."
    ),
    plugin: list[Path] | None = opt.PLUGIN,
    allow_code: bool = opt.ALLOW_CODE,
    output: opt.Format = opt.FORMAT,
) -> None:
    """Run hard cases; report what held, what failed, and whether that is as expected."""
    from contactlab.plan.overrides import drive_option
    from contactlab.studies.stability_cases import StabilityRequest, find_cases, run

    target = folder or RESULTS / "stability"
    opt.rerun_with_mujoco(mujoco, None if folder else target)
    opt.load_plugins(plugin)
    settings = [*(assign or ()), *(f"thresholds.{each}" for each in threshold or ())]
    settings += [] if duration is None else [f"duration={duration:g}"]
    then = "repeat the finished cases and resume this one"
    with study_session(target, workers, then, allow_code=allow_code) as session:
        report = run(StabilityRequest(names or (), drive_option(drive), settings), session)
    cases = report.cases
    if output == "json":
        print_json(report.model_dump(mode="json"))
    else:
        _print_cases(cases)
        for model in (each.origin for each in find_cases(names or ()) if each.is_generic):
            echo(
                "stability looks at whole runs; what the model is made of, and what to change: "
                f"contactlab check {model}"
            )
    if failed := [each.name for each in cases if not each.passed]:
        raise ExpectationError(f"{len(failed)} of {len(cases)} cases failed: {', '.join(failed)}")


def _print_cases(done: "Sequence[StabilityResult]") -> None:
    rows: list[tuple[object, ...]] = []
    for each in done:
        labels = ", ".join(f"{label} {count}" for label, count in each.labels.items())
        met = f"{each.met}/{each.asked}"
        end = (each.error, each.step, each.seconds)
        rows.append((each.name, each.runs, met, each.controls, labels, *end))
    header = ("case", "runs", "as expected", "controls", "labels", "error", "step", "seconds")
    print_table(header, rows)
    for each in done:
        if each.not_exercised:
            echo(f"{each.name} not exercised: {each.not_exercised}")
        for miss in shortened(each.misses, 5, each.store):
            echo(f"{each.name} {miss}")
    seconds = sum(each.seconds for each in done)
    met = sum(each.passed for each in done)
    echo(f"{met} of {len(done)} cases are as expected, in {seconds:.0f} s")
